"""Plain values that travel: a video and what became of it, what was decided, rows, and the tasks of a run."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, GestureError, Status
from gesture_core.files import printable


@dataclass(frozen=True)
class VideoLimits:
    """What one video may cost at most.

    Attributes
    ----------
    max_pixels : int
        Width times height of a frame; the default is that of the setting ``limits.pixels``.
    max_frames : int
        Frames that are decoded; the default is that of the setting ``limits.frames``.
    max_seconds : float
        Time stamp of the last frame, in seconds; the default is six hours.
    max_streams : int
        Streams that a container may announce.
    """

    max_pixels: int = 64_000_000
    max_frames: int = 650_000
    max_seconds: float = 6 * 3600.0
    max_streams: int = 64

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ConfigError(f"{name} is {value!r}, it must be above zero", code="E_OPTION")


@dataclass(frozen=True)
class VideoInfo:
    """What the container says of its video stream.

    Attributes
    ----------
    width, height : int
        Pixels of the upright picture.
    frames_declared : int or None
        Number of frames that the header claims, None where it claims none or nonsense. Never
        used to allocate anything.
    fps : float or None
        Average frames a second, None where the container does not say.
    rotation : int
        Degrees clockwise by which stored pictures are turned to stand upright: 0, 90, 180, 270.
    codec : str
        FFmpeg's name of the codec, or its four-character code.
    container : str
        FFmpeg's name of the container format.
    reader : str
        Name of the video reader.
    mirrored : bool
        The stored pictures are also flipped left to right, after the rotation.
    """

    width: int
    height: int
    frames_declared: int | None
    fps: float | None
    rotation: int
    codec: str
    container: str
    reader: str
    mirrored: bool = False


@dataclass(frozen=True)
class VideoReport:
    """What became of a video.

    Attributes
    ----------
    frames_declared : int or None
        As in `VideoInfo`.
    frames_read : int
        Frames that were decoded, whether anybody looked at them or not.
    damaged : int
        Corrupt packets and frames, decoding errors, and frames that are known to be lost.
    complete : bool
        The video was read to its end and nothing was found damaged or missing.
    notes : tuple of str
        What was found, one clause each.
    reader : str
        Name of the video reader.
    assumed : str
        What the file does not say and was assumed, such as the frame rate of a stream without times, with
        the setting that says otherwise.
    """

    frames_declared: int | None
    frames_read: int
    damaged: int
    complete: bool
    notes: tuple[str, ...] = ()
    reader: str = ""
    assumed: str = ""


@dataclass(frozen=True)
class Prediction:
    """What was decided about one person in one input.

    Attributes
    ----------
    label : str or None
        None unless the status carries a label.
    status : str
        `ok`, `degraded`, `rejected`, `skipped` or `error`.
    distance : float or None
        Warping distance to the nearest example of the winning class.
    margin : float or None
        Distance to the nearest example of any other class minus `distance`, as the vote's winner
        sees it; the lead of the winner's score, 0 to about 1, where all examples decide
        (``classify.neighbors = 0``). None with only one class.
    confidence : float or None
        Probability that the winner is right, calibrated on the examples; only where `classify.confidence`
        asks for it.
    score : float or None
        The winner's score, highest of all classes; only where `classify.min_score` asks for it.
    neighbors : tuple of (example, label, distance)
        The k nearest examples, nearest first; where all examples decide, the nearest one of each of
        the three best classes, best class first.
    selected : tuple of str
        Salient channels of the query.
    code, message : str
        Empty when there is nothing to say.
    note : str
        What was done with the input and is worth knowing; mostly empty.
    """

    label: str | None
    status: Status
    distance: float | None = None
    margin: float | None = None
    neighbors: tuple[tuple[str, str, float], ...] = ()
    selected: tuple[str, ...] = ()
    code: str = ""
    message: str = ""
    note: str = ""
    confidence: float | None = None
    score: float | None = None


@dataclass(frozen=True)
class Event:
    """One gesture in a long recording or a stream.

    Attributes
    ----------
    input : str
        The recording, as the user named it.
    person : int
        Track number; 0 for the first or only one.
    start, end : float
        Seconds in the recording's own time.
    label : str
    score : float
        0 to 1: how far the distance is below the threshold of its class, as a share of it.
    distance : float
        Of the event to the example: mean squared difference over the geometric mean of both variances.
    example : str
        The nearest one.
    """

    input: str
    person: int
    start: float
    end: float
    label: str
    score: float
    distance: float
    example: str


_LONGEST = 10_000


@dataclass(frozen=True)
class Row:
    """One row of the result.

    Attributes
    ----------
    input : str
        The path as the user named it, ``path::member`` for a sequence inside a file.
    sha256 : str
        Of the content; empty where it could not be read.
    person : int
        Track number; 0 for the first or only one.
    label : str or None
        The gesture; only rows with the status ``ok`` or ``degraded`` have one.
    distance : float or None
    margin, confidence : float or None
    neighbors : tuple of (example, label, distance)
        As in `Prediction`.
    status : str
        ``ok``, ``degraded``, ``rejected``, ``skipped`` or ``error``.
    code, message : str
        Why, where the status is not ``ok``.
    note : str
        What the input does not say and was assumed, or what was done with it that its file name does not
        tell: clauses, joined by semicolons; empty where there was nothing.
    start, end : float or None
        Seconds of the first and the last frame in which the person was found; of an event, of the event.
    box : tuple of four floats, or empty
        Left, top, right and bottom of where the person was in all that time, in pixels of the upright picture
        (or in the unit of the keypoint file).
    frames_declared : int or None
        What the container claims.
    frames_read : int
        All that were decoded.
    frames_looked_at : int
        Those of them in which people were looked for (``pose.rate``).
    frames_with_pose : int
        Those of them in which this person was found.
    seconds : float
        Length of what was read.
    selected : tuple of str
        Salient channels.
    attempts : int
    plugin : str
        What found the keypoints: distribution and version.
    fingerprint : str
        Of everything that produced the row.
    event : int
        Number of the event in a long recording, from 1; 0 where a row is about the whole input.
    score : float or None
        That of an `Event`, where the row is about one; otherwise that of a `Prediction`.
    """

    input: str
    sha256: str = ""
    person: int = 0
    label: str | None = None
    distance: float | None = None
    margin: float | None = None
    neighbors: tuple[tuple[str, str, float], ...] = ()
    status: Status = "error"
    code: str = ""
    message: str = ""
    note: str = ""
    start: float | None = None
    end: float | None = None
    box: tuple[float, ...] = ()
    frames_declared: int | None = None
    frames_read: int = 0
    frames_looked_at: int = 0
    frames_with_pose: int = 0
    seconds: float = 0.0
    selected: tuple[str, ...] = ()
    attempts: int = 1
    plugin: str = ""
    fingerprint: str = ""
    event: int = 0
    score: float | None = None
    confidence: float | None = None

    def as_record(self) -> dict[str, Any]:
        """The row as scalars: ``neighbors`` as JSON, ``selected`` joined by spaces, all text valid UTF-8."""
        record = asdict(self)
        record["neighbors"] = json.dumps(self.neighbors, ensure_ascii=False)
        record["selected"] = " ".join(self.selected)
        record["box"] = " ".join(map("{:g}".format, self.box))
        if len(self.message) > _LONGEST:  # a plugin's error may be of any length
            record["message"] = f"{self.message[:_LONGEST]}…"
        return {name: printable(value) if isinstance(value, str) else value for name, value in record.items()}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Row:
        """The inverse of `as_record`."""
        values = {name: record[name] for name in COLUMNS}
        values["neighbors"] = tuple((e, label, d) for e, label, d in json.loads(record["neighbors"]))
        values["selected"] = tuple(record["selected"].split())
        values["box"] = tuple(map(float, record["box"].split()))
        return cls(**values)


COLUMNS: tuple[str, ...] = tuple(f.name for f in fields(Row))
INTEGERS = frozenset(f.name for f in fields(Row) if f.type in ("int", "int | None"))
REALS = frozenset(f.name for f in fields(Row) if f.type in ("float", "float | None"))
"""Those of the columns that hold numbers; the others hold text."""


@dataclass(frozen=True)
class Job:
    """What is the same for every task of a run, as plain values: it goes through a pipe as JSON.

    Attributes
    ----------
    settings : mapping
        From `Settings.as_dict`.
    store : str
        Folder of the keypoint store.
    keys : mapping
        Hashes of what decides the keypoints, parts of names in the store.
    spot : bool
        Examples are looked for in long recordings, instead of compared with whole inputs.
    threads : int
        Of one worker's numeric libraries.
    """

    settings: Mapping[str, Any]
    store: str
    keys: Mapping[str, str] = field(default_factory=dict)
    threads: int = 1
    spot: bool = False


@dataclass(frozen=True)
class Task:
    """One call of a worker function (`gesture_core.run.workers.worker.FUNCTIONS`), by its name.

    Attributes
    ----------
    number : int
        Position among the tasks that were handed over together.
    function : str
    arguments : mapping
        Plain values, fit for JSON.
    """

    number: int
    function: str
    arguments: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """What came of a task: a value, or an error.

    Attributes
    ----------
    number : int
        The task's.
    value : object
        Plain values, fit for JSON.
    error : GestureError or None
    attempts : int
        2 where the first attempt ended its process.
    """

    number: int
    value: Any = None
    error: GestureError | None = None
    attempts: int = 1


def encoded(path: str | os.PathLike[str]) -> str:
    """The exact bytes of a path, as text: so it travels in a task."""
    return os.fsencode(path).hex()


def decoded(text: str) -> Path:
    """The inverse of `encoded`."""
    return Path(os.fsdecode(bytes.fromhex(text)))
