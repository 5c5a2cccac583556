"""One input to keypoints in the store."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gesture_core.errors import GestureError, InputError, KeypointError, RunFolderError
from gesture_core.files import content_sha256, stamp, switched_on, tree_sha256
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import Job, VideoLimits
from gesture_core.run.store import mark_used, read_keypoints, storing, write_keypoints
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.plugin.interfaces import KeypointReader, PoseBackend, Video
    from gesture_core.video.reader import Picture

_REPORT_SECONDS = 0.5
_LONG = 1000
"""Frames up to which a video that was interrupted is begun again."""
_OFTEN = 1 / 3
"""Share of the frames from which other people are worth a note."""
_OTHERS = (
    "other people are visible in a third of the frames or more; the one who is seen best is taken "
    "(--set pose.people=multi takes all)"
)


class Seen(NamedTuple):
    """A person in an input: number, frames with a pose, seconds of the first and last of them, and where."""

    person: int
    frames: int
    start: float
    end: float
    box: tuple[float, ...]

    @classmethod
    def of(cls, sequence: PoseSequence) -> Seen:
        """The facts of a sequence with a pose."""
        times = sequence.times[sequence.seen.any(axis=1)]
        frames, first, last = len(times), float(times[0]), float(times[-1])
        return cls(int(sequence.person), frames, first, last, sequence.box)


@dataclass(frozen=True)
class Extracted:
    """What came of the extraction of one input: keypoints in the store, or an error.

    Attributes
    ----------
    sha256 : str
        Of the content; empty where it could not be read.
    stamp : str
        Of the file as it was read, from `files.stamp`.
    stored : str
        File name in the keypoint store; empty after an error.
    cached : bool
        The keypoints were already there.
    people : tuple of Seen
    frames_declared : int or None
        What the container claims.
    frames_read : int
        All of them, decoded.
    frames_looked_at : int
        Those of them in which people were looked for.
    complete : bool
        No frame is known to be lost.
    notes : tuple of str
        What was wrong with the input, or is worth knowing of it.
    assumed : str
        What the input does not say and its reader assumed, where anything was.
    seconds : float
        Length of what was read.
    plugin : str
        Distribution and version of the backend or reader.
    code, message : str
        Of the error; empty after success.
    attempts : int
    """

    sha256: str = ""
    stamp: str = ""
    stored: str = ""
    cached: bool = False
    people: tuple[Seen, ...] = ()
    frames_declared: int | None = None
    frames_read: int = 0
    frames_looked_at: int = 0
    complete: bool = True
    notes: tuple[str, ...] = ()
    assumed: str = ""
    seconds: float = 0.0
    plugin: str = ""
    code: str = ""
    message: str = ""
    attempts: int = 1

    @classmethod
    def from_tree(cls, tree: Mapping[str, Any]) -> Extracted:
        """The inverse of `asdict`, after JSON."""
        people = tuple(Seen._make([*facts, tuple(box)]) for *facts, box in tree["people"])
        return cls(**{**tree, "notes": tuple(tree["notes"]), "people": people})

    def failed(self, error: GestureError, **changes: Any) -> Extracted:
        """The same input without keypoints: ``error`` is why, without a subject, which the row names."""
        message = error.message.removeprefix(f"{error.subject}: ") if error.subject else error.message
        return replace(self, stored="", code=error.code, message=message, **changes)


class KeypointExtractor:
    """Extracts keypoints; opens the pose network once, when the first video comes.

    Parameters
    ----------
    job : Job
    settings : Settings
    report : callable
        Takes ``{"frames": n}`` for further frames that are done, and ``{"slow": True}`` before the pose
        network is loaded, which may take as long as a start.
    """

    def __init__(self, job: Job, settings: Settings, report: Callable[[dict[str, Any]], None]) -> None:
        self._job = job
        self._settings = settings
        self._report = report
        self._hashed: tuple[Path, str, str] = (Path(), "", "")
        self._readers: dict[str, KeypointReader] = {}

    def __call__(self, path: Path, member: str, reader: str) -> Extracted:
        """What came of an input; ``reader`` names its keypoint reader, and is empty for a video.

        An error of the input becomes its code and message, as the hash that was found is worth keeping.

        Raises
        ------
        RunFolderError
            ``E_STORE_WRITE``, after which no other input can succeed either.
        """
        found = Extracted(complete=False)
        try:
            found = replace(found, stamp=stamp(path))
            if self._hashed[:2] != (path, found.stamp):  # once for all sequences in one file
                sha256 = content_sha256(path, lambda: self._report({"frames": 0}))
                self._hashed = (path, found.stamp, sha256)
            found = replace(found, sha256=self._hashed[2])
            key = tree_sha256([self._job.keys[f"reader {reader}" if reader else "video"], member])
            name = f"{found.sha256[:2]}/{found.sha256[:32]}-{key[:16]}.parquet"
            return self._from_store(name, found) or self._extract(path, member, reader, name, found)
        except OSError as error:
            cause = f"cannot be read: {error.strerror or error}"
            return found.failed(InputError(cause, remedy="check its permissions", code="E_READ"))
        except GestureError as error:
            if isinstance(error, RunFolderError) or error.code == "E_WORKER_MEMORY":
                raise  # the first is everybody's, the second is tried again
            return found.failed(error)

    def _from_store(self, name: str, found: Extracted) -> Extracted | None:
        path = Path(self._job.store) / name
        if switched_on("GESTURE_NO_CACHE") or not path.is_file():
            return None
        try:
            stored = read_keypoints(path)
        except KeypointError:  # damaged on disk: extract again, which replaces the file
            return None
        mark_used(path)
        return _with_facts(replace(found, stored=name, cached=True), stored.sequences, stored.facts)

    def _extract(self, path: Path, member: str, reader: str, name: str, found: Extracted) -> Extracted:
        if reader:
            sequences, facts = self._from_reader(path, member, reader)
        else:
            sequences, facts = self._from_video(path, Path(self._job.store) / name)
        sequences = [sequence for sequence in sequences if sequence.frames_with_pose]
        if stamp(path) != found.stamp:
            raise InputError("was written while it was read", remedy="--retry-errors", code="E_CHANGED")
        with storing(self._job.store):
            write_keypoints(Path(self._job.store) / name, sequences, facts)
        return _with_facts(replace(found, stored=name), sequences, facts)

    def _from_video(self, path: Path, stored: Path) -> tuple[list[PoseSequence], dict[str, Any]]:
        backend, settings = self.backend, self._settings
        self._report({"frames": 0})
        from gesture_core.pose.extract import extract_poses
        from gesture_core.video import open_video

        limits = VideoLimits(settings.limits.pixels, settings.limits.frames)
        with open_video(path, settings.pose.reader, limits, settings.options, settings.video) as video:
            frames = _Looked(video, settings.pose.rate, self._report)
            entry = registry().find("pose", settings.pose.backend)
            with _journal(backend, video, stored) as asked, calling(entry, passing=(OSError,)):
                sequences = extract_poses(
                    frames, asked, settings.pose.people, follow=settings.pose.follow, source=str(path)
                )
            report = video.report
        others = sum(int(sequence.provenance.get("others", 0)) for sequence in sequences)
        frames.flush()
        return sequences, {
            "frames_declared": None if report.frames_declared is None else int(report.frames_declared),
            "frames_read": int(report.frames_read),
            "frames_looked_at": frames.count,
            "complete": bool(report.complete),
            "notes": [
                *map(str, report.notes),
                *([_OTHERS] if others >= max(1, frames.count * _OFTEN) else []),
                *([frames.coarse] if frames.repeated >= max(1, report.frames_read * _OFTEN) else []),
            ],
            "seconds": frames.seconds,
            "assumed": str(report.assumed),
        }

    def _from_reader(self, path: Path, member: str, name: str) -> tuple[list[PoseSequence], dict[str, Any]]:
        from gesture_core.pose.plausible import check_plausible

        pose, known = self._settings.pose, {}
        sequences: list[PoseSequence]
        odd: list[str] = []
        if name == "store":
            stored = read_keypoints(path)
            sequences, known = stored.sequences, dict(stored.facts)
        else:
            reader = self.reader(name)
            with calling(registry().find("reader", name), passing=(OSError,)):
                sequences = [_checked(sequence) for sequence in reader.read(path, member)]
        if pose.score is not None:
            sequences = [_above(sequence, pose.score) for sequence in sequences]
        if name != "store":
            stated = self._settings.keypoints.axes is not None
            odd = [note for one in sequences for note in check_plausible(one, axes_stated=stated)]
        if pose.people == "single" and len(sequences) > 1:
            best = max(sequences, key=lambda s: (float(s.scores.sum()), -s.person))
            sequences = [replace(best, person=0)]
        if len({sequence.person for sequence in sequences}) < len(sequences):
            # Rows and files tell people apart by their numbers.
            sequences = [replace(sequence, person=n) for n, sequence in enumerate(sequences)]
        frames = max((len(sequence) for sequence in sequences), default=0)
        if frames > self._settings.limits.frames:
            raise KeypointError(
                f"holds {frames} frames, at most {self._settings.limits.frames}",
                remedy="a larger --set limits.frames=…",
                code="E_KEYPOINTS_LIMIT",
            )
        seconds = max((float(s.times[-1] - s.times[0]) for s in sequences if len(s)), default=0.0)
        lost = sorted({s.provenance["lost"] for s in sequences if "lost" in s.provenance})
        unread = max((int(s.provenance.get("lost_frames", 0)) for s in sequences), default=0)
        facts: dict[str, Any] = {
            "frames_declared": None,
            "frames_read": frames - unread,
            "frames_looked_at": frames - unread,
            "complete": not lost,
            "notes": list(dict.fromkeys([*lost, *(note for one in sequences for note in _notes(one)), *odd])),
            "seconds": seconds,
            "assumed": str(sequences[0].provenance.get("assumed", "")) if sequences else "",
        }
        return sequences, facts | known

    def reader(self, name: str) -> KeypointReader:
        """A keypoint reader with what the settings say of its files, constructed once."""
        if name not in self._readers:
            offered = {"options": self._settings.keypoints, "people": self._settings.pose.people}
            taken = {key: one for key, one in offered.items() if registry().takes("reader", name, key)}
            self._readers[name] = registry().make(
                "reader", name, self._settings.plugin_options(name), **taken
            )
        return self._readers[name]

    @cached_property
    def backend(self) -> PoseBackend:
        """The pose backend of the settings, its network loaded, and what decoding needs, too."""
        self._report({"slow": True})
        from gesture_core.pose.extract import open_backend
        from gesture_core.video import reader_name

        reader = reader_name(self._settings.pose.reader, self._settings.options)
        for module in ("cv2", *registry().find("video", reader).needs):
            import_module(module)  # now, so that the first video does not seem to stand still
        return open_backend(self._settings, self._job.threads)


def _journal(backend: PoseBackend, video: Video, stored: Path) -> AbstractContextManager[PoseBackend]:
    """``backend``, which remembers its answers where the video is long."""
    frames = video.info.frames_declared
    if frames is not None and frames <= _LONG:
        return nullcontext(backend)
    from gesture_core.run.workers.journal import remembering

    return remembering(backend, stored)


def _checked(sequence: object) -> PoseSequence:
    if not isinstance(sequence, PoseSequence):
        raise TypeError(f"{type(sequence).__name__} instead of a PoseSequence")
    return sequence


def _notes(sequence: PoseSequence) -> list[str]:
    """The clauses of what its reader noted."""
    return [note for note in sequence.provenance.get("notes", "").split("; ") if note]


def _above(sequence: PoseSequence, score: float) -> PoseSequence:
    """``sequence`` without the joints whose score is below ``score``."""
    import numpy as np

    unsure = sequence.scores < score
    return replace(sequence, keypoints=np.where(unsure[..., None], np.nan, sequence.keypoints))


def _with_facts(found: Extracted, sequences: list[PoseSequence], facts: Mapping[str, Any]) -> Extracted:
    names = ("frames_declared", "frames_read", "frames_looked_at", "complete", "seconds")
    return replace(
        found,
        people=tuple(map(Seen.of, sequences)),
        notes=tuple(facts["notes"]),
        assumed=facts.get("assumed", ""),
        **{name: facts[name] for name in names},
    )


class _Looked:
    """The frames of a video that are looked at, and what passes on the way, for the progress report.

    Attributes
    ----------
    seconds : float
        From the first frame to the latest.
    count : int
        Frames that were looked at.
    repeated : int
        Frames at the time of the one before.
    """

    def __init__(self, video: Video, rate: float | None, report: Callable[[dict[str, Any]], None]) -> None:
        self._video = video
        self._rate = rate
        self._report = report
        self._unreported = 0
        self.seconds = 0.0
        self.count = 0
        self.repeated = 0

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        from gesture_core.video import at_rate

        for frame in at_rate(self._passing(), self._rate):
            self.count += 1
            yield frame

    def _passing(self) -> Iterator[Picture]:
        from gesture_core.video import pictures

        reported, first, before = time.monotonic(), None, None
        for at, convert in pictures(self._video):
            first = at if first is None else first
            self.repeated += at == before
            before = at
            self.seconds = float(at - first)
            yield at, convert
            self._unreported += 1
            if time.monotonic() - reported > _REPORT_SECONDS:
                self.flush()
                reported = time.monotonic()

    @property
    def coarse(self) -> str:
        """What a clock that stands still means for what is looked at."""
        return (
            f"{self.repeated} frames have the time of the one before, and pose.rate looks at one of them; "
            "try: --set video.retime=RATE, or --set pose.rate=none"
        )

    def flush(self) -> None:
        """Report what has not been reported."""
        if self._unreported:
            self._report({"frames": self._unreported})
            self._unreported = 0
