"""One input to keypoints in the store."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import GestureError, InputError, KeypointError, RunFolderError
from gesture_core.files import content_sha256, stamp, tree_sha256, without_cache
from gesture_core.plugin.interfaces import VideoLimits
from gesture_core.plugin.registry import calling, registry
from gesture_core.run.store import mark_used, read_keypoints, write_keypoints
from gesture_core.settings import Settings
from gesture_core.types import Job, PoseSequence

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.plugin.interfaces import PoseBackend

_REPORT_SECONDS = 0.5


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
    people : tuple of (int, int)
        Number of each person, and their frames with a pose.
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
    people: tuple[tuple[int, int], ...] = ()
    frames_declared: int | None = None
    frames_read: int = 0
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
        people = tuple((person, frames) for person, frames in tree["people"])
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
        if without_cache() or not path.is_file():
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
            sequences, facts = self._from_video(path)
        sequences = [sequence for sequence in sequences if sequence.frames_with_pose]
        if stamp(path) != found.stamp:
            raise InputError("was written while it was read", remedy="--retry-errors", code="E_CHANGED")
        try:
            write_keypoints(Path(self._job.store) / name, sequences, facts)
        except OSError as error:
            raise RunFolderError(
                f"keypoints cannot be written to {self._job.store}: {error.strerror or error}",
                remedy="free space there, or name another folder in GESTURE_CACHE",
                code="E_STORE_WRITE",
            ) from error
        return _with_facts(replace(found, stored=name), sequences, facts)

    def _from_video(self, path: Path) -> tuple[list[PoseSequence], dict[str, Any]]:
        backend, settings = self.backend, self._settings
        self._report({"frames": 0})
        from gesture_core.pose.extract import extract_poses
        from gesture_core.video import open_video

        limits = VideoLimits(settings.limits.pixels, settings.limits.frames)
        with open_video(path, settings.pose.reader, limits, settings.options) as video:
            frames = _Counted(video, self._report)
            with calling(registry().find("pose", settings.pose.backend), passing=(OSError,)):
                sequences = extract_poses(
                    frames, backend, settings.pose.people, follow=settings.pose.follow, source=str(path)
                )
            report = video.report
        frames.flush()
        return sequences, {
            "frames_declared": None if report.frames_declared is None else int(report.frames_declared),
            "frames_read": int(report.frames_read),
            "complete": bool(report.complete),
            "notes": [str(note) for note in report.notes],
            "seconds": frames.seconds,
        }

    def _from_reader(self, path: Path, member: str, name: str) -> tuple[list[PoseSequence], dict[str, Any]]:
        pose, known = self._settings.pose, {}
        sequences: list[PoseSequence]
        if name == "store":
            stored = read_keypoints(path)
            sequences, known = stored.sequences, dict(stored.facts)
        else:
            shared = {"fps": pose.fps, "people": pose.people}
            options = {key: one for key, one in shared.items() if registry().takes("reader", name, key)}
            reader = registry().make("reader", name, options | self._settings.plugin_options(name))
            with calling(registry().find("reader", name), passing=(OSError,)):
                sequences = [_checked(sequence) for sequence in reader.read(path, member)]
        if pose.score is not None:
            sequences = [_above(sequence, pose.score) for sequence in sequences]
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
        facts: dict[str, Any] = {
            "frames_declared": None,
            "frames_read": frames,
            "complete": True,
            "notes": [],
            "seconds": seconds,
            "assumed": str(sequences[0].provenance.get("assumed", "")) if sequences else "",
        }
        return sequences, facts | known

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


def _checked(sequence: object) -> PoseSequence:
    if not isinstance(sequence, PoseSequence):
        raise TypeError(f"{type(sequence).__name__} instead of a PoseSequence")
    return sequence


def _above(sequence: PoseSequence, score: float) -> PoseSequence:
    """``sequence`` without the joints whose score is below ``score``."""
    import numpy as np

    unsure = sequence.scores < score
    return replace(sequence, keypoints=np.where(unsure[..., None], np.nan, sequence.keypoints))


def _with_facts(found: Extracted, sequences: list[PoseSequence], facts: Mapping[str, Any]) -> Extracted:
    names = ("frames_declared", "frames_read", "complete", "seconds")
    return replace(
        found,
        people=tuple((int(sequence.person), sequence.frames_with_pose) for sequence in sequences),
        notes=tuple(facts["notes"]),
        assumed=facts.get("assumed", ""),
        **{name: facts[name] for name in names},
    )


class _Counted:
    """Frames on their way to the network, counted for the progress report."""

    def __init__(
        self, frames: Iterable[tuple[float, np.ndarray]], report: Callable[[dict[str, Any]], None]
    ) -> None:
        self._frames = frames
        self._report = report
        self._unreported = 0
        self.seconds = 0.0

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        reported, first = time.monotonic(), None
        for at, frame in self._frames:
            first = at if first is None else first
            self.seconds = float(at - first)
            yield at, frame
            self._unreported += 1
            if time.monotonic() - reported > _REPORT_SECONDS:
                self.flush()
                reported = time.monotonic()

    def flush(self) -> None:
        """Report what has not been reported."""
        if self._unreported:
            self._report({"frames": self._unreported})
            self._unreported = 0
