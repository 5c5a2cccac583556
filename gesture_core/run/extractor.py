"""One input to keypoints in the store: what a worker does for each task."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import GestureError, InputError, KeypointError, RunFolderError
from gesture_core.files import content_sha256, stamp, tree_sha256
from gesture_core.plugin import registry
from gesture_core.plugin.interfaces import VideoLimits
from gesture_core.run.probe import probe
from gesture_core.run.pruning import mark_used
from gesture_core.run.store import read_keypoints, write_keypoints
from gesture_core.run.work import Job, Outcome, Task
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.plugin.interfaces import PoseBackend

STORE_FAILED = "E_STORE_WRITE"
"""Code of an outcome after which no other input can succeed either."""
_REPORT_SECONDS = 0.5


class Extractor:
    """Extracts keypoints; opens the pose network once, when the first video comes.

    Parameters
    ----------
    job : Job
    on_opening : callable
        Called before the pose network is loaded, which may take as long as a start.
    """

    def __init__(self, job: Job, on_opening: Callable[[], None] = lambda: None) -> None:
        self._job = job
        self._on_opening = on_opening
        self._hashed: tuple[Path, str, str] = (Path(), "", "")

    def __call__(self, task: Task, on_frames: Callable[[int], None]) -> Outcome:
        """The outcome of ``task``; whatever goes wrong becomes its code and message.

        ``on_frames`` is called with the number of further frames that are done.
        """
        started = time.perf_counter()
        plugin = plugin_of(task, self._job.settings)
        outcome = Outcome(task.number, plugin=plugin, complete=False)
        try:
            if task.kind == "probe":
                probe(self._backend)
                return replace(outcome, complete=True)
            before = stamp(task.path)
            outcome = replace(outcome, sha256=self._sha256(task, before, on_frames), stamp=before)
            outcome = self._from_store(task, outcome) or self._extract(task, outcome, on_frames)
        except GestureError as error:
            outcome = replace(outcome, code=error.code, message=message_without_subject(error))
        except MemoryError:
            message = "out of memory; try: --set limits.memory=… with a larger figure and --retry-errors"
            outcome = replace(outcome, code="E_WORKER_MEMORY", message=message)
        except OSError as error:
            message = f"cannot be read: {error.strerror or error}; try: check its permissions"
            outcome = replace(outcome, code="E_READ", message=message)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
            text = f"{plugin} raised {type(error).__name__}: {error}; try: another plugin, or report it"
            outcome = replace(outcome, code="E_PLUGIN_RAISED", message=text)
        return replace(outcome, elapsed=time.perf_counter() - started)

    def _sha256(self, task: Task, now: str, on_frames: Callable[[int], None]) -> str:
        """The content hash; that of a container is computed once for all sequences inside it."""
        if self._hashed[:2] != (task.path, now):
            self._hashed = (task.path, now, content_sha256(task.path, lambda: on_frames(0)))
        return self._hashed[2]

    def _name(self, task: Task, sha256: str) -> str:
        """File name in the store: content, then what decides the keypoints."""
        maker = "video" if task.kind == "video" else f"reader {task.reader}"
        key = tree_sha256([self._job.keys[maker], task.member])
        return f"{sha256[:2]}/{sha256[:32]}-{key[:16]}.parquet"

    def _from_store(self, task: Task, outcome: Outcome) -> Outcome | None:
        name = self._name(task, outcome.sha256)
        path = self._job.store / name
        if not path.is_file():
            return None
        try:
            stored = read_keypoints(path)
        except KeypointError:  # damaged on disk: extract again, which replaces the file
            return None
        mark_used(path)
        return replace(outcome, stored=name, cached=True, **_facts(stored.facts))

    def _extract(self, task: Task, outcome: Outcome, on_frames: Callable[[int], None]) -> Outcome:
        if task.kind == "video":
            sequences, facts = self._video(task, on_frames)
        else:
            sequences, facts = self._keypoints(task)
        facts["people"] = len(sequences)
        if stamp(task.path) != outcome.stamp:
            raise InputError(
                "was written while it was read",
                remedy="--retry-errors",
                code="E_CHANGED",
            )
        name = self._name(task, outcome.sha256)
        try:
            write_keypoints(self._job.store / name, sequences, facts)
        except OSError as error:
            raise RunFolderError(
                f"keypoints cannot be written to {self._job.store}: {error.strerror or error}",
                remedy="free space there, or name another folder in GESTURE_CACHE",
                code=STORE_FAILED,
            ) from error
        return replace(outcome, stored=name, **_facts(facts))

    def _video(
        self, task: Task, on_frames: Callable[[int], None]
    ) -> tuple[list[PoseSequence], dict[str, Any]]:
        backend = self._backend
        on_frames(0)
        from gesture_core.pose.extract import extract_poses
        from gesture_core.video import open_video

        settings = self._job.settings
        limits = VideoLimits(settings.limits.pixels, settings.limits.frames)
        with open_video(task.path, settings.pose.reader, limits, settings.options) as video:
            frames = _Counted(video, on_frames)
            sequences = extract_poses(
                frames, backend, settings.pose.people, follow=settings.pose.follow, source=str(task.path)
            )
            report = video.report
        frames.flush()
        found = [sequence for sequence in sequences if sequence.frames_with_pose]
        return found, {
            "frames_declared": report.frames_declared,
            "frames_read": report.frames_read,
            "complete": report.complete,
            "notes": list(report.notes),
            "seconds": frames.seconds,
        }

    def _keypoints(self, task: Task) -> tuple[list[PoseSequence], dict[str, Any]]:
        settings, known = self._job.settings, {}
        sequences: list[PoseSequence]
        if task.reader == "store":
            stored = read_keypoints(task.path)
            sequences, known = stored.sequences, dict(stored.facts)
        else:
            reader = registry().make("reader", task.reader, _reader_options(settings, task.reader))
            sequences = reader.read(task.path, task.member)
        if settings.pose.score is not None:
            sequences = [_above(sequence, settings.pose.score) for sequence in sequences]
        if settings.pose.people == "single" and len(sequences) > 1:
            best = max(sequences, key=lambda s: (float(s.scores.sum()), -s.person))
            sequences = [replace(best, person=0)]
        if len({sequence.person for sequence in sequences}) < len(sequences):
            # Rows and files tell people apart by their numbers.
            sequences = [replace(sequence, person=n) for n, sequence in enumerate(sequences)]
        frames = max((len(sequence) for sequence in sequences), default=0)
        if frames > settings.limits.frames:
            raise KeypointError(
                f"holds {frames} frames, at most {settings.limits.frames}",
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
            "assumed": sequences[0].provenance.get("assumed", "") if sequences else "",
        }
        return [s for s in sequences if s.frames_with_pose], facts | known

    @cached_property
    def _backend(self) -> PoseBackend:
        self._on_opening()
        from gesture_core.pose.extract import open_backend
        from gesture_core.video import reader_name

        # What decoding needs is loaded now, so that the first video does not seem to stand still.
        settings = self._job.settings
        reader = reader_name(settings.pose.reader, settings.options)
        for module in ("cv2", *registry().find("video", reader).needs):
            import_module(module)
        return open_backend(settings, self._job.threads)


def plugin_of(task: Task, settings: Settings) -> str:
    """Distribution and version of what finds the keypoints of ``task``."""
    if task.kind in ("video", "probe"):
        return str(registry().find("pose", settings.pose.backend).origin)
    return str(registry().find("reader", task.reader).origin)


def _reader_options(settings: Settings, name: str) -> dict[str, Any]:
    """Options of a keypoint reader: ``fps`` and ``people`` of [pose] where it takes them, then its own."""
    taken = signature(registry().load("reader", name)).parameters
    shared = {"fps": settings.pose.fps, "people": settings.pose.people}
    return {key: value for key, value in shared.items() if key in taken} | settings.plugin_options(name)


def _above(sequence: PoseSequence, score: float) -> PoseSequence:
    """``sequence`` without the joints whose score is below ``score``."""
    import numpy as np

    unsure = sequence.scores < score
    return replace(sequence, keypoints=np.where(unsure[..., None], np.nan, sequence.keypoints))


def message_without_subject(error: GestureError) -> str:
    """The message without its subject, which the row names already."""
    return error.message.removeprefix(f"{error.subject}: ") if error.subject else error.message


def _facts(facts: Any) -> dict[str, Any]:
    names = ("people", "frames_declared", "frames_read", "complete", "seconds")
    notes, assumed = tuple(facts["notes"]), facts.get("assumed", "")
    return {name: facts[name] for name in names} | {"notes": notes, "assumed": assumed}


class _Counted:
    """Frames on their way to the network, counted for the progress report."""

    def __init__(self, frames: Iterable[tuple[float, np.ndarray]], on_frames: Callable[[int], None]) -> None:
        self._frames = frames
        self._on_frames = on_frames
        self._unreported = 0
        self._first = self._last = 0.0

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        reported = time.monotonic()
        for number, (at, frame) in enumerate(self._frames):
            if number == 0:
                self._first = at
            self._last = at
            yield at, frame
            self._unreported += 1
            if time.monotonic() - reported > _REPORT_SECONDS:
                self.flush()
                reported = time.monotonic()

    def flush(self) -> None:
        """Report what has not been reported."""
        if self._unreported:
            self._on_frames(self._unreported)
            self._unreported = 0

    @property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return self._last - self._first
