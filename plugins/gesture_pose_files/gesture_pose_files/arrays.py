"""Keypoints in ``.npy`` and ``.npz``: plain arrays, archives of one sequence, and archives of many."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.joint_names import joint_named
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import Skeleton
from gesture_core.types import PoseSequence
from gesture_pose_files.files import head_of, open_keypoints, suffix_of
from gesture_pose_files.layout import sequence, skeleton_called
from gesture_pose_files.named import joints_among, order_of, people_of
from gesture_pose_files.npy import MAX_FILE_BYTES, read_array, read_header
from gesture_pose_files.npz import Members, array_in, members_of, opened, shape_of
from gesture_pose_files.numbering import number_in
from gesture_pose_files.reader import Reader, clip_called
from gesture_pose_files.whole_body import is_known, is_one_frame, is_one_person, people_in

_PICKLES = (".pkl", ".pickle", ".joblib")
_NPY_MAGIC = b"\x93NUMPY"
_ZIP_MAGIC = b"PK\x03\x04"
_MAX_NAME_CHARS = 64
KEYPOINTS = ("keypoints", "keypoint", "pose", "poses", "pose_landmarks", "body")
_SCORES = (
    "scores", "score", "keypoint_scores", "keypoint_score", "keypoints_score", "confidence", "conf",
    "visibility", "pose_scores",
)  # fmt: skip
RATES = ("fps", "frame_rate", "framerate")
_TIMES = ("times", "timestamps", "timestamp", "time", "t")
_NAMES = ("joint_names", "keypoint_names", "landmark_names", "node_names", "joints", "names")
_PICTURES = {"frame_size": False, "img_shape": True, "original_shape": True, "image_shape": True}
"""Whether the height stands first, as in MMPose's and OpenCV's shapes of images."""
_FEWEST_JOINTS = 3
# Joints of a hand, and of a face as dlib, MediaPipe, and MediaPipe with irises have them.
_HAND_AND_FACE = (21, 68, 70, 468, 478)


class ArrayReader(Reader):
    """Reads keypoint arrays.

    - ``.npy``: (T, J, 2|3|4) or (T, 2J|3J|4J); J of 15 (MPI), 17 (COCO), 18 (OpenPose COCO), 25
      (BODY_25), 26 (Halpe) or 33 (MediaPipe); of 133, 136 and 137 (whole body) and 543, 1629 and 1662
      (MediaPipe holistic) the part that is the body. Axes of one are left out; four axes are people, too.
    - ``.npz`` with ``keypoints`` and, if present, ``scores``, ``times``, ``skeleton``, ``frame_size``.
    - ``.npz`` with one array of a body beside arrays of scores, hands, face or boxes.
    - ``.npz`` with one such array for each sequence, its key the sequence's name.

    Our own archives name their joints, and say x first.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.npy`` or ``.npz`` and begins like one; one frame is no sequence."""
        suffix = suffix_of(path)
        if suffix == ".npy":
            return head_of(path, 6) == _NPY_MAGIC and not self._is_one_frame(path)
        return path.suffix.lower() == ".npz" and head_of(path, 4) == _ZIP_MAGIC

    def refusal(self, path: Path) -> str:
        """That pickles are not opened, or that the file is none of NumPy's."""
        if path.suffix.lower() in _PICKLES:
            return (
                "pickles are not opened, for they can run any code; save what it holds once, with "
                "np.savez('clip.npz', keypoints=…, scores=…), or a folder of such files"
            )
        if self._is_one_frame(path):
            return "it is one frame, and a clip is a folder of them, numbered as 0.npy, 1.npy, …"
        return f"it does not begin as NumPy's files do, but with {head_of(path, 12)!r}"

    def _is_one_frame(self, path: Path) -> bool:
        """By its header, and by a number in its name where it has an axis for one person."""
        try:
            with open_keypoints(path, MAX_FILE_BYTES) as file:
                shape = read_header(file, printable(path))[0]
        except KeypointError:
            return False
        alone = is_one_person(shape) and number_in(path.name) is not None
        return alone or is_one_frame(shape, self.options)

    def members(self, path: Path) -> list[str]:
        """Names of the sequences in ``path``; ``[""]`` where it holds one."""
        if head_of(path, 4) != _ZIP_MAGIC:
            return [""]
        with opened(path) as archive:
            shapes = _shapes(archive, members_of(archive, path), path)
        names = [] if _by_joint(shapes) else _sequence_names(shapes, self.options)
        return names if len(names) > 1 else [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The one sequence called ``member``, or the only one.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_BROKEN`, `E_KEYPOINTS_SHAPE`, `E_KEYPOINTS_VALUE`,
            `E_KEYPOINTS_LIMIT`, `E_KEYPOINTS_MEMBER`, and those of `files.open_keypoints`.
        """
        source = printable(path) + (f"::{member}" if member else "")
        if head_of(path, 4) == _ZIP_MAGIC:
            with opened(path) as archive:
                return self._from_archive(archive, path, member, source)
        if member:
            raise KeypointError(
                f"is one array, it has no member {member!r}", subject=source, code="E_KEYPOINTS_MEMBER"
            )
        with open_keypoints(path, MAX_FILE_BYTES) as file:
            return self._sequences(read_array(file, source), self.options, source)

    def _from_archive(
        self, archive: zipfile.ZipFile, path: Path, member: str, source: str
    ) -> list[PoseSequence]:
        keys = members_of(archive, path)
        options = _with_rate(archive, keys, self.options, source)
        if member in keys:
            return self._sequences(array_in(archive, keys[member], source), options, source)
        shapes = {} if member else _shapes(archive, keys, path)
        if separate := _by_joint(shapes):
            return self._named(archive, keys, separate, options, source)
        names = _sequence_names(shapes, options)
        name = clip_called(member, {name: name for name in names}, path, "arrays of keypoints")
        points = array_in(archive, keys[name], source)
        if scores := next((key for key in _SCORES if key in keys and key != name), ""):
            points = _with_scores(points, array_in(archive, keys[scores], source), source)
        times, clock = _times(archive, keys, points.shape, source)
        body: Skeleton | None = None
        if "skeleton" in keys:
            text = array_in(archive, keys["skeleton"], source, kinds="U")
            body = skeleton_called(
                str(text.reshape(-1)[0])[:_MAX_NAME_CHARS] if text.size == 1 else "?", source
            )
        joints: dict[str, tuple[str, ...]] = {}
        if body is None and not options.order:
            joints = _joints(archive, keys, points.shape, source)
        for order in joints.values():
            options = replace(options, order=order)
        size, picture = _picture(archive, keys, source)
        used = {name, scores, clock, "skeleton", picture, *joints, *RATES}
        others = [key for key in keys if key not in used]
        more = ", …" if others[5:] else ""
        notes = (f"arrays that are not used: {', '.join(others[:5])}{more}",) if others else ()
        return self._sequences(points, options, source, times, body, size, notes)

    def _named(
        self, archive: zipfile.ZipFile, keys: Members, joints: list[str], options: ReadOptions, source: str
    ) -> list[PoseSequence]:
        """The person of whom each array is a joint."""
        values = np.stack([array_in(archive, keys[name], source) for name in joints], axis=1)
        times, clock = _times(archive, keys, (len(values), 1, 1), source)
        others = [key for key in keys if key not in (*joints, clock, *RATES)]
        return people_of(
            joints_among(joints, options, source),
            values[None, ..., :2],
            values[None, ..., 2] if values.shape[2] == 3 else None,
            options,
            source=source,
            reader="arrays",
            times=times,
            notes=(f"arrays that are not used: {', '.join(others[:5])}",) if others else (),
        )

    def _sequences(
        self,
        array: np.ndarray,
        options: ReadOptions,
        source: str,
        times: np.ndarray | None = None,
        body: Skeleton | None = None,
        size: tuple[int, int] | None = None,
        notes: tuple[str, ...] = (),
    ) -> list[PoseSequence]:
        people, left_out = ([array], ()) if body else people_in(array, options, source)
        found = [
            sequence(
                one,
                options,
                source=source,
                reader="arrays",
                times=times,
                body=body,
                axes="xy" if body else None,
                own=body is not None,
                frame_size=size,
                notes=(*left_out, *notes),
            )
            for one in people
        ]
        return found if len(found) == 1 else self.best(found, source)


def _with_rate(archive: zipfile.ZipFile, keys: Members, options: ReadOptions, source: str) -> ReadOptions:
    """The options with the rate that the archive itself says."""
    name = next((key for key in RATES if key in keys), None)
    if name is None or options.fps is not None:
        return options
    rate = array_in(archive, keys[name], source).reshape(-1)
    known = len(rate) == 1 and 0.001 <= rate[0] <= 100_000
    return replace(options, fps=float(rate[0])) if known else options


def _times(
    archive: zipfile.ZipFile, keys: Members, shape: tuple[int, ...], source: str
) -> tuple[np.ndarray | None, str]:
    """Seconds of the frames and the name of the array that holds them, where there is one."""
    for name in _TIMES:
        if name in keys:
            times = array_in(archive, keys[name], source)
            if times.ndim == 1 and len(times) in shape[: max(1, len(shape) - 2)]:
                return times, name
            if name == _TIMES[0]:
                raise KeypointError(
                    f"times {times.shape} do not fit keypoints {shape}",
                    subject=source,
                    code="E_KEYPOINTS_SHAPE",
                )
    return None, ""


def _joints(
    archive: zipfile.ZipFile, keys: Members, shape: tuple[int, ...], source: str
) -> dict[str, tuple[str, ...]]:
    """The order of the joints, by the name of the array that tells it, where there is one."""
    for key in _NAMES:
        held = array_in(archive, keys[key], source, kinds="USfiu") if key in keys else np.zeros(0)
        text = held.ndim == 1 and held.dtype.kind in "US" and len(held) in shape[1:]
        if text and (order := order_of([str(name) for name in held.astype("U")])):
            return {key: order}
    return {}


def _picture(archive: zipfile.ZipFile, keys: Members, source: str) -> tuple[tuple[int, int] | None, str]:
    """Width and height of the picture and the name of the array that tells them, where there is one."""
    for key, turned in _PICTURES.items():
        if key in keys:
            sides = array_in(archive, keys[key], source).reshape(-1)
            if len(sides) in (2, 2 + turned) and (sides >= 1).all() and (sides < 1 << 20).all():
                width, height = (sides[1], sides[0]) if turned else sides
                return (int(width), int(height)), key
    return None, ""


def _with_scores(points: np.ndarray, scores: np.ndarray, source: str) -> np.ndarray:
    if scores.shape == (*points.shape[:-1], 1):
        scores = scores[..., 0]
    if scores.shape != points.shape[:-1]:
        raise KeypointError(
            f"scores {scores.shape} do not fit keypoints {points.shape}",
            subject=source,
            code="E_KEYPOINTS_SHAPE",
        )
    kept = points if points.shape[-1] < 4 else points[..., :3]
    return np.concatenate([kept, scores[..., None]], axis=-1)


def _shapes(archive: zipfile.ZipFile, keys: Members, path: Path) -> Mapping[str, tuple[int, ...]]:
    main = [key for key in KEYPOINTS if key in keys]
    return {
        key: shape_of(archive, info, printable(path), objects=bool(main) and key not in main)
        for key, info in keys.items()
    }


def _sequence_names(shapes: Mapping[str, tuple[int, ...]], options: ReadOptions) -> list[str]:
    """Keys of the arrays that are sequences, in the archive's order; the others describe them.

    One array called ``keypoints``, or the only one of a body beside scores, hands, faces and boxes, is the
    sequence; otherwise every array with two or three axes is one.
    """
    if "keypoints" in shapes:
        return ["keypoints"]
    bodies = [key for key, shape in shapes.items() if is_known(shape, options)]
    named = [key for key in KEYPOINTS if key in bodies]
    main = named[0] if named else bodies[0] if len(bodies) == 1 else ""
    if main and all(_describes(shapes[key], shapes[main]) for key in shapes if key != main):
        return [main]
    return [key for key, shape in shapes.items() if len(shape) >= 2]


def _by_joint(shapes: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Keys of arrays that are one joint each, (T, 2|3), by their names; none where there are few."""
    named = [key for key, shape in shapes.items() if shape[1:] in ((2,), (3,)) and joint_named(key)]
    alike = len({shapes[key] for key in named}) == 1
    return named if alike and len(named) >= _FEWEST_JOINTS else []


def _describes(shape: tuple[int, ...], main: tuple[int, ...]) -> bool:
    """Whether an array of ``shape`` may belong to the sequence ``main``, being no body itself."""
    if len(shape) < 2 or shape == main[:-1] or shape == (*main[:-1], 1):
        return True
    joints = shape[-2] if len(shape) >= 3 else 0
    hands_or_face = joints in _HAND_AND_FACE or (len(shape) == 2 and shape[1] // 3 in _HAND_AND_FACE)
    return shape[0] in main[:2] and (hands_or_face or shape[-1] in (4, 5))
