"""Folders of OpenPose JSON, one numbered file a frame: ``wave_000000000000_keypoints.json``, ``1.json``."""

from __future__ import annotations

from pathlib import Path

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.clip import Clip
from gesture_pose_files.files import MAX_JSON_BYTES
from gesture_pose_files.json_people import Found, is_one, landmarks_of, people_in
from gesture_pose_files.json_text import kind_of, load
from gesture_pose_files.numbering import clip_in, clips_in, some_files
from gesture_pose_files.reader import Reader

_LOOKED_AT = 3
_ONE_FRAME_BYTES = 1 << 16
# Of OpenPose's own networks; of 17, 26 and 133 joints in its frame, the order is what other tools use.
_SAID = (15, 18, 25, 127, 130, 137)
_EXPECTED = "frames such as wave_000000000000_keypoints.json or 0001.json, each with a list 'people'"


class OpenPoseJsonReader(Reader):
    """Reads a folder of OpenPose JSON; frames of several videos may lie in one folder.

    A frame's number is the last one in its file's name, however it is padded; what comes before it tells
    videos apart. Files that cannot be read cost their frame. A single JSON file is one frame, not a
    sequence: give the folder. AlphaPose's ``sep-json`` and the frames of MMPose are read as well.

    A frame's time is its number over the rate, so that frames that were left out stay gaps in time. Shares
    (OpenPose's ``--keypoint_scale 3`` and ``4``) are told from pixels. Of several people the most persistent
    one is used, or each.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is a folder that holds a numbered JSON file that looks like a frame."""
        return any(map(_looks_like_frame, some_files(path, ".json", _LOOKED_AT)))

    def refusal(self, path: Path) -> str:
        """That a file is one frame, where it is; empty otherwise."""
        if kind_of(path) != "frame":
            return ""
        return "it is one frame, and a clip is a folder of them, numbered as wave_000000000012_keypoints.json"

    def members(self, path: Path) -> list[str]:
        """Names of the sequences in the folder; ``[""]`` where there is only one."""
        names = list(clips_in(path, ".json"))
        return names if len(names) > 1 else [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The people of one sequence, which may be left unnamed where the folder holds one.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_MEMBER`, `E_KEYPOINTS_LIMIT`, and those of `clip.Clip`; where no frame can be
            read, those of the first.
        """
        clip = Clip(printable(path) + (f"::{member}" if member else ""), "openpose-json", said=_SAID)
        for number, file in clip_in(path, member, ".json", _EXPECTED):
            clip.add(number, _frame(file, self.options))
        return clip.sequences(self.options, self.people)


def _looks_like_frame(path: Path) -> bool:
    """By its first bytes; a file that is cut short, or cannot be read, by its name."""
    try:
        kind = kind_of(path)
    except KeypointError:
        return True
    if kind == "frame" or (kind == "other" and path.name.lower().endswith("_keypoints.json")):
        return True
    try:
        tree = load(path, _ONE_FRAME_BYTES) if kind == "other" else None
        return (bool(tree) and landmarks_of(tree) is not None) or is_one(tree)
    except KeypointError:
        return False


def _frame(file: Path, options: ReadOptions) -> Found | KeypointError:
    try:
        return people_in(load(file, MAX_JSON_BYTES), printable(file), options)
    except KeypointError as error:  # a new one: the traceback of this would keep what was read
        return KeypointError(error.cause, subject=error.subject, remedy=error.remedy, code=error.code)
