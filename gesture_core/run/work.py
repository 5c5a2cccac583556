"""What travels between the parent and a worker: the job, one task of it, and what came of the task.

All of it goes through a pipe as JSON, so nothing that a worker says is ever unpickled.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from gesture_core.settings import Settings, settings_from_dict


@dataclass(frozen=True)
class Job:
    """What is the same for every task of a run.

    Attributes
    ----------
    settings : Settings
    store : Path
        Folder of the keypoint store.
    keys : mapping
        From `fingerprint.pose_keys`: hashes of what decides the keypoints, parts of names in the store.
    threads : int
        Of one worker's pose network.
    """

    settings: Settings
    store: Path
    keys: Mapping[str, str]
    threads: int = 1

    def as_dict(self) -> dict[str, Any]:
        return {
            "settings": self.settings.as_dict(),
            "store": os.fspath(self.store),
            "keys": dict(self.keys),
            "threads": self.threads,
        }

    @classmethod
    def from_dict(cls, tree: Mapping[str, Any]) -> Job:
        return cls(
            settings_from_dict(tree["settings"]), Path(tree["store"]), dict(tree["keys"]), tree["threads"]
        )


@dataclass(frozen=True)
class Task:
    """One input to extract keypoints from.

    Attributes
    ----------
    number : int
        Position in the run.
    path : Path
    kind : "video", "keypoints" or "probe"
        A probe tries the pose network on a known picture; its path is the model file.
    member : str
        The sequence inside a file or folder that holds several.
    reader : str
        Name of the keypoint reader; empty for a video.
    """

    number: int
    path: Path
    kind: str
    member: str = ""
    reader: str = ""

    def as_dict(self) -> dict[str, Any]:
        return {**asdict(self), "path": os.fsencode(self.path).hex()}

    @classmethod
    def from_dict(cls, tree: Mapping[str, Any]) -> Task:
        return cls(**{**tree, "path": Path(os.fsdecode(bytes.fromhex(tree["path"])))})


@dataclass(frozen=True)
class Outcome:
    """What came of a task: keypoints in the store, or an error.

    Attributes
    ----------
    number : int
        The task's.
    sha256 : str
        Of the content; empty where it could not be read.
    stamp : str
        Of the file as it was read, from `hashing.stamp`.
    stored : str
        File name in the keypoint store; empty after an error.
    cached : bool
        The keypoints were already there.
    people : int
        Sequences found.
    frames_declared : int or None
        What the container claims.
    frames_read : int
    complete : bool
        No frame is known to be lost.
    notes : tuple of str
        What was wrong with the input, where anything was.
    assumed : str
        What the input does not say and its reader assumed, where anything was.
    seconds : float
        Length of what was read.
    elapsed : float
        Seconds of work.
    plugin : str
        Distribution and version of the backend or reader.
    code, message : str
        Of the error; empty after success.
    attempts : int
    """

    number: int
    sha256: str = ""
    stamp: str = ""
    stored: str = ""
    cached: bool = False
    people: int = 0
    frames_declared: int | None = None
    frames_read: int = 0
    complete: bool = True
    notes: tuple[str, ...] = field(default_factory=tuple)
    assumed: str = ""
    seconds: float = 0.0
    elapsed: float = 0.0
    plugin: str = ""
    code: str = ""
    message: str = ""
    attempts: int = 1

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, tree: Mapping[str, Any]) -> Outcome:
        return cls(**{**tree, "notes": tuple(tree["notes"])})
