"""Folders of OpenPose JSON, one file a frame: ``<name>_<12 digits>_keypoints.json``."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.interfaces import Person
from gesture_core.skeletons import BODY25, skeleton
from gesture_core.types import PoseSequence
from gesture_pose_files.files import MAX_FRAMES, check_options, check_size
from gesture_pose_files.json_frame import read_frame
from gesture_pose_files.layout import are_shares, assumed_picture, assumed_rate
from gesture_pose_files.people import tracks

_NAME = re.compile(r"(.*)_(\d{12})_keypoints\.json", re.DOTALL)


@dataclass(frozen=True)
class OpenPoseJsonReader:
    """Reads a folder of OpenPose JSON; frames of several videos may lie in one folder.

    A single JSON file is one frame, not a sequence: give the folder.

    Attributes
    ----------
    fps : float
        Frames a second of the video; the files do not say. A frame's time is its number over this, so
        that frames that were left out stay gaps in time.
    people : "single" or "multi"
        One sequence with the most persistent person, or one for each person.
    frame_size : (width, height)
        The picture that x and y are multiplied with where they are shares of its width and height
        (OpenPose's ``--keypoint_scale 3`` and ``4``). The files do not say; only the ratio of the two
        changes a gesture, 4:3 by default.
    """

    fps: float = 30.0
    people: str = "single"
    frame_size: tuple[int, int] = (640, 480)

    def __post_init__(self) -> None:
        check_options(self.fps, self.people)
        object.__setattr__(self, "frame_size", check_size(self.frame_size))

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is a folder that holds at least one frame."""
        try:
            with os.scandir(path) as entries:
                return any(_NAME.fullmatch(entry.name) for entry in entries)
        except OSError:
            return False

    def members(self, path: Path) -> list[str]:
        """Names of the sequences in the folder; ``[""]`` where there is only one."""
        names = list(_sequences(path))
        return names if len(names) > 1 else [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The people of one sequence.

        Parameters
        ----------
        path : Path
            The folder.
        member : str
            Name of the sequence; may be empty where the folder holds one.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_MEMBER`, `E_KEYPOINTS_LIMIT`, `E_KEYPOINTS_MISSING`, and
            those of `json_frame.read_frame`, which name the file.
        """
        numbered = _choose(path, member)
        source = printable(path) + (f"::{member}" if member else "")
        frames: list[list[Person]] = []
        kind: str | None = None
        for _, file in numbered:
            people, frame_kind = read_frame(file)
            if kind and frame_kind and frame_kind != kind:
                raise KeypointError(
                    f"is {frame_kind}, frames before it are {kind}",
                    subject=printable(file),
                    code="E_KEYPOINTS_FORMAT",
                )
            kind = kind or frame_kind
            frames.append(people)
        body = skeleton(kind or BODY25.name)
        times = np.array([number for number, _ in numbered], np.float64) / self.fps
        provenance = {
            "reader": "openpose-json",
            "times": f"frame numbers at {self.fps:g} frames/s",
            "assumed": assumed_rate(self.fps),
        }
        every = [one.keypoints for frame in frames for one in frame]
        if every and are_shares(np.stack(every)):
            size = np.array(self.frame_size, np.float32)
            frames = [[Person(one.keypoints * size, one.scores) for one in frame] for frame in frames]
            provenance["scaled"] = f"shares of {self.frame_size[0]} x {self.frame_size[1]} pixels"
            provenance["assumed"] += f", {assumed_picture(self.frame_size)}"
        return [
            PoseSequence(points, scores, times, body.name, None, person, source, provenance)
            for person, (points, scores) in enumerate(tracks(frames, len(body.joints), self.people))
        ]


def _choose(folder: Path, member: str) -> list[tuple[int, Path]]:
    found = _sequences(folder)
    if not found:
        raise KeypointError(
            "holds no file named <name>_<12 digits>_keypoints.json",
            subject=printable(folder),
            code="E_KEYPOINTS_EMPTY",
        )
    if not member and len(found) == 1:
        return next(iter(found.values()))
    if member not in found:
        names = ", ".join(list(found)[:5]) + (", …" if len(found) > 5 else "")
        raise KeypointError(
            f"holds {len(found)} sequences, and {member!r} is none of them",
            subject=printable(folder),
            remedy=f"one of {names}",
            code="E_KEYPOINTS_MEMBER",
        )
    return found[member]


def _sequences(folder: Path) -> dict[str, list[tuple[int, Path]]]:
    """Name -> numbered files, both in order."""
    found: dict[str, list[tuple[int, Path]]] = {}
    count = 0
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                match = _NAME.fullmatch(entry.name)
                if match is None:
                    continue
                count += 1
                if count > MAX_FRAMES:
                    raise KeypointError(
                        f"holds more than {MAX_FRAMES} frames",
                        subject=printable(folder),
                        remedy="split it",
                        code="E_KEYPOINTS_LIMIT",
                    )
                found.setdefault(match[1], []).append((int(match[2]), Path(entry.path)))
    except OSError as error:
        raise KeypointError(
            f"cannot be listed: {error.strerror}", subject=printable(folder), code="E_KEYPOINTS_UNREADABLE"
        ) from error
    return {name: sorted(found[name]) for name in sorted(found)}
