"""Marker files of motion captures (``.c3d``), as Vicon, Qualisys, OptiTrack and others write them."""

from __future__ import annotations

import re
import struct
import warnings
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joint_named, words_of
from gesture_core.types import PoseSequence
from gesture_pose_files.files import COPY_AGAIN, MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.in_front import seen_from_in_front
from gesture_pose_files.reader import OneClipReader, noted

if TYPE_CHECKING:
    import c3d

_MARK = 80
"""The second byte of every file."""
_MOST_LISTS = 10
_SUBJECT = re.compile(r"(?:(?P<subject>.*):)?(?P<name>.*)", re.DOTALL)
# Markers lie around a joint: the middle of those that do is one. Names of Plug-in Gait and its forerunners.
_AROUND = {
    "sho": "shoulder", "elb": "elbow", "wra": "wrist", "wrb": "wrist", "asi": "hip", "psi": "hip",
    "fwt": "hip", "bwt": "hip", "kne": "knee", "ank": "ankle", "hee": "heel",
    "toe": "big_toe",
}  # fmt: skip
_CENTRES = {"sjc": "shoulder", "ejc": "elbow", "wjc": "wrist", "hjc": "hip", "kjc": "knee", "ajc": "ankle"}
_MIDDLE = {
    "c7": "neck", "cv7": "neck", "clav": "neck",
    "lfhd": "head", "rfhd": "head", "lbhd": "head", "rbhd": "head",
}  # fmt: skip
_WHERE = frozenset(("out", "outer", "in", "inner", "top", "front", "back", "lat", "lateral", "med", "medial"))


class C3dReader(OneClipReader):
    """Reads ``.c3d``, seen from in front. Of several subjects the one that is seen most, or everybody.

    Joints are the middles of the markers around them, by their names in Plug-in Gait and in OptiTrack's
    sets, or have names of their own. Forces and other analog channels are not read. The option ``order`` is
    for markers of your own.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.c3d`` and has the mark of one."""
        return path.suffix.lower() == ".c3d" and head_of(path, 2)[1:] == bytes([_MARK])

    def refusal(self, path: Path) -> str:
        """What it begins with."""
        return f"it has no mark of C3D, it begins with {head_of(path, 8)!r}"

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The subjects in the file, which says names, rate and unit."""
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            try:
                names, points, rate, unit, announced = _markers(file)
            except (
                ValueError, TypeError, IndexError, KeyError, AttributeError, AssertionError, OverflowError,
                EOFError, MemoryError, ZeroDivisionError, struct.error,
            ) as error:  # fmt: skip
                raise KeypointError(
                    f"is no C3D: {error or type(error).__name__}",
                    subject=source,
                    remedy=COPY_AGAIN,
                    code="E_KEYPOINTS_BROKEN",
                ) from error
        if len(points) > MAX_FRAMES:
            cause = f"holds more than {MAX_FRAMES} frames"
            raise KeypointError(cause, subject=source, remedy="split it", code="E_KEYPOINTS_LIMIT")
        if not len(points) or not names:
            raise KeypointError("holds no markers", subject=source, code="E_KEYPOINTS_EMPTY")
        if not 0 < rate < 1e5:
            raise KeypointError(f"has {rate:g} frames a second", subject=source, code="E_KEYPOINTS_TIMES")
        subjects: dict[str, list[int]] = {}
        split = [_SUBJECT.fullmatch(name).group("subject", "name") for name in names]  # type: ignore[union-attr]
        for column, (subject, _) in enumerate(split):
            subjects.setdefault(subject or "", []).append(column)
        found, who, faults = [], [], []
        for subject, columns in subjects.items():
            own, places = [split[column][1] for column in columns], points[:, columns]
            order = self.options.skeleton
            if order is None or len(order.joints) != len(own):
                own, places = joined(own, places)
            try:
                pose = seen_from_in_front(
                    own,
                    places,
                    np.arange(len(points)) / rate,
                    unit,
                    self.options,
                    source=source,
                    reader="c3d",
                    announced=announced,
                )
            except KeypointError as error:
                faults.append((subject, error))
                continue
            found.append(pose)
            who.append(subject)
        if not found:
            raise faults[0][1]
        best = self.best(found, source, who)
        lacking = ", ".join(subject or "markers of nobody" for subject, _ in faults)
        return [noted(pose, f"no person: {lacking[:80]}") for pose in best] if faults else best


def joined(names: Sequence[str], points: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Names and (T, N, 3) places of joints in the place of the markers around them, then of all the rest.

    A joint that a model has computed goes before its markers. It is missing where one of them is, as the
    middle of others would jump; a marker that is never seen does not count.

    >>> import numpy as np
    >>> joined(["LWRA", "LWRB", "RSHO", "Tail"], np.arange(12.0).reshape(1, 4, 3))[0]
    ['left_wrist', 'right_shoulder', 'Tail']
    """
    around: dict[str, list[int]] = {}
    centres: dict[str, list[int]] = {}
    rest = []
    for number, name in enumerate(names):
        joint, centre = _joint(name)
        if joint:
            (centres if centre else around).setdefault(joint, []).append(number)
        else:
            rest.append(number)
    seen = np.isfinite(points).all(axis=2).any(axis=0)
    members = around | {
        joint: own for joint, own in centres.items() if joint not in around or seen[own].any()
    }
    places = [points[:, [n for n in own if seen[n]] or own].mean(axis=1) for own in members.values()]
    every = [*places, *(points[:, number] for number in rest)]
    return [*members, *(names[number] for number in rest)], np.stack(every, axis=1)


def _joint(name: str) -> tuple[str, bool]:
    """The joint that a marker belongs to, empty for none, and whether it is its centre."""
    plain = name.strip().lower()
    if plain in _MIDDLE:
        return _MIDDLE[plain], False
    side = {"l": "left", "r": "right"}.get(plain[:1], "")
    if side and plain[1:] in _AROUND:
        return f"{side}_{_AROUND[plain[1:]]}", False
    if side and plain[1:] in _CENTRES:
        return f"{side}_{_CENTRES[plain[1:]]}", True
    words = [word for word in words_of(name) if word not in _WHERE]
    return joint_named("_".join("hip" if word == "waist" else word for word in words)) or "", False


def _markers(file: BinaryIO) -> tuple[list[str], np.ndarray, float, str, int]:
    """Names, (T, N, 3) places, NaN where missing, frames a second, unit, and frames that are announced."""
    import c3d

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of metadata that nobody needs; an end too soon is counted
        reader = c3d.Reader(file)
        count = int(reader.point_used)
        names = [name.strip() for name in _labels(reader)][:count]
        unit = reader.get("POINT:UNITS")
        frames = [
            np.where((p[:, 3] < 0) | (p[:, :3] == 0).all(axis=1), np.nan, p[:, :3].T).T[: len(names)]
            for _, p, _ in islice(reader.read_frames(copy=False, analog_transform=False), MAX_FRAMES + 1)
        ]
        return (
            names,
            np.array(frames, np.float32).reshape(len(frames), len(names), 3),
            float(reader.point_rate),
            unit.string_value.strip().lower() if unit is not None else "",
            int(reader.frame_count),
        )


def _labels(reader: c3d.Reader) -> Iterator[str]:
    """Of all points: a parameter holds 255 of them."""
    for number in range(1, _MOST_LISTS):
        more = reader.get(f"POINT:LABELS{number if number > 1 else ''}")
        if more is None:
            return
        yield from more.string_array
