"""Keypoints of many inputs through an execution engine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gesture_core.errors import GestureError, PluginError
from gesture_core.plugin import registry
from gesture_core.run.discovery import Input
from gesture_core.run.extractor import plugin_of
from gesture_core.run.fingerprint import pose_identity, pose_keys
from gesture_core.run.probe import require_model
from gesture_core.run.pruning import prune
from gesture_core.run.run import default_workers, keypoint_store, threads_for
from gesture_core.run.work import Job, Outcome, Task
from gesture_core.settings import Settings

OnFrames = Callable[[str, int], None]


class Extraction:
    """An open execution engine; as a context manager, so that its workers live as long as it does.

    Parameters
    ----------
    settings : Settings
    identity : mapping
        From `fingerprint.pose_identity`.
    most : int
        Inputs in the largest call.
    workers : int
        0 for one for each core.
    engine : str
        Name of an execution engine.
    on_frames : callable
        Told the input's name and the number of further frames that are done.
    """

    def __init__(
        self,
        settings: Settings,
        identity: Mapping[str, Any],
        *,
        most: int,
        workers: int = 0,
        engine: str = "processes",
        on_frames: OnFrames = lambda name, count: None,
    ) -> None:
        workers = max(1, min(workers or default_workers(most), most))
        self._job = Job(settings, keypoint_store(), pose_keys(identity), threads_for(workers))
        self._entry = registry().find("engine", engine)
        options = settings.plugin_options(engine)
        self._engine = registry().make("engine", engine, options, workers=workers, limits=settings.limits)
        self._on_frames = on_frames

    def __enter__(self) -> Extraction:
        return self

    def __exit__(self, *_: object) -> None:
        close = getattr(self._engine, "close", None)  # engines need not have one
        if close is not None:
            close()

    def __call__(self, items: Sequence[Input]) -> Iterator[Outcome]:
        """One outcome for each of ``items``, as they come; its ``number`` is the item's position."""
        tasks = [Task(n, item.path, item.kind, item.member, item.reader) for n, item in enumerate(items)]
        waiting = set(range(len(tasks)))
        if not tasks:
            return
        try:
            for outcome in self._engine.run(
                self._job, tasks, lambda task, count: self._on_frames(items[task.number].name, count)
            ):
                if outcome.number in waiting:
                    waiting.remove(outcome.number)
                    plugin = outcome.plugin or plugin_of(tasks[outcome.number], self._job.settings)
                    yield replace(outcome, plugin=plugin)
        except GestureError:
            raise
        except Exception as error:
            raise PluginError(
                f"{self._title} raised {type(error).__name__}: {error}",
                kept="every committed row",
                remedy="--engine processes, or report it",
                code="E_PLUGIN_RAISED",
            ) from error
        for number in sorted(waiting):
            message = f"{self._title} gave no outcome; try: --engine processes, or report it"
            yield Outcome(number, code="E_PLUGIN_CONTRACT", message=message)

    @property
    def _title(self) -> str:
        return f"{self._entry.title} of {self._entry.origin}"


def extract_all(
    items: Sequence[Input],
    settings: Settings,
    *,
    identity: Mapping[str, Any] | None = None,
    workers: int = 0,
    engine: str = "processes",
    on_frames: OnFrames = lambda name, count: None,
) -> Iterator[Outcome]:
    """One outcome for each of ``items``, videos and keypoint files, from an engine of their own.

    The parameters are those of `Extraction`; without ``identity``, it is found and the model is tried
    first. As after a run, the keypoint store is then brought below its limit.
    """
    if not items:
        return
    if identity is None:
        videos = any(item.kind == "video" for item in items)
        identity = pose_identity(settings, videos)
        if videos:
            require_model(settings, identity, engine)
    with Extraction(
        settings, identity, most=len(items), workers=workers, engine=engine, on_frames=on_frames
    ) as extraction:
        added = False
        for outcome in extraction(items):
            added |= bool(outcome.stored) and not outcome.cached
            yield outcome
    if added:
        prune(keypoint_store(), settings.limits.cache)
