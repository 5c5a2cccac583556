"""Keypoint arrays in MATLAB's files, of version 5 to 7.2, and of 7.3, which is HDF5 (h5py)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.arrays import KEYPOINTS, RATES
from gesture_pose_files.files import MAX_LIST_BYTES, head_of, open_keypoints
from gesture_pose_files.hdf5 import Loaders, arrays_in
from gesture_pose_files.layout import sequence
from gesture_pose_files.mat5 import variables_in
from gesture_pose_files.reader import OneClipReader
from gesture_pose_files.whole_body import is_known, people_in

_ORDERS = ((0, 1, 2), (2, 0, 1), (2, 1, 0), (1, 0, 2))
"""Of the axes: frames, joints, values; and where MATLAB's users put the frames last."""


class MatlabReader(OneClipReader):
    """Reads ``.mat`` with one array of keypoints: (frames, joints, 2|3), (joints, 2|3, frames), or flat.

    A variable ``fps`` is the rate. Structures and cells are not looked into.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.mat`` and begins like one."""
        return path.suffix.lower() == ".mat" and head_of(path, 6) == b"MATLAB"

    def refusal(self, path: Path) -> str:
        """That it is none of MATLAB's, or of its fourth version."""
        return (
            f"it does not begin as MATLAB's files do since version 5, but with {head_of(path, 8)!r}; "
            "save it once more with save(…, '-v7')"
        )

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The people in the one array that is keypoints."""
        with _variables(path, source) as held:
            found = {name: order for name in held if (order := _order(held[name][0], self.options))}
            name = next((name for name in KEYPOINTS if name in found), None)
            if name is None and len(found) == 1:
                name = next(iter(found))
            if name is None:
                shown = ", ".join(f"{key} {shape}" for key, (shape, _) in list(held.items())[:6]) or "nothing"
                raise KeypointError(
                    f"holds {shown}: {'no' if not found else 'more than one'} array of keypoints",
                    subject=source,
                    remedy="save one array of frames, joints, x and y (and score) as keypoints; "
                    "--set keypoints.order=… for other joints",
                    code="E_KEYPOINTS_FORMAT",
                )
            array = held[name][1]()
            options = self.options
            for rate in RATES:
                if rate in held and held[rate][0] in ((1, 1), (1,), ()) and options.fps is None:
                    fps = float(held[rate][1]().reshape(-1)[0])
                    options = replace(options, fps=fps) if 0.001 <= fps <= 100_000 else options
        others = [key for key in held if key not in (name, *RATES)]
        notes = (f"arrays that are not used: {', '.join(others[:5])}",) if others else ()
        people, left_out = people_in(array.transpose(found[name]), options, source)
        notes = (*left_out, *notes)
        poses = [sequence(one, options, source=source, reader="matlab", notes=notes) for one in people]
        return poses if len(poses) == 1 else self.best(poses, source)


def _order(shape: tuple[int, ...], options: ReadOptions) -> tuple[int, ...]:
    """How to turn an array so that it is keypoints; empty where it cannot be any."""
    orders = _ORDERS if len(shape) == 3 else ((0, 1), (1, 0)) if len(shape) == 2 else ()
    for order in orders:
        if is_known(tuple(shape[axis] for axis in order), options):
            return order
    return ()


@contextmanager
def _variables(path: Path, source: str) -> Iterator[Loaders]:
    """The arrays of numbers in a file by name; what is broken in it is an E_KEYPOINTS_BROKEN."""
    if b"\x89HDF" in head_of(path, 1024):
        with arrays_in(path, source) as held:
            yield held
        return
    with open_keypoints(path, MAX_LIST_BYTES) as file:
        data = file.read(MAX_LIST_BYTES + 1)
    yield {name: (one.shape, one.array) for name, one in variables_in(data, source).items()}
