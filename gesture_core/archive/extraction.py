"""Keypoints of many inputs through an execution engine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from gesture_core.archive.discovery import Input
from gesture_core.archive.fingerprint import pose_identity, pose_keys
from gesture_core.archive.probe import require_model
from gesture_core.archive.run import default_workers, keypoint_store, threads_for
from gesture_core.archive.work import Job, Outcome, Task
from gesture_core.errors import GestureError, PluginError
from gesture_core.plugin import registry
from gesture_core.settings import Settings


def extract_all(
    items: Sequence[Input],
    settings: Settings,
    *,
    identity: Mapping[str, Any] | None = None,
    workers: int = 0,
    engine: str = "processes",
    on_frames: Callable[[str, int], None] = lambda name, count: None,
) -> Iterator[Outcome]:
    """One outcome for each of ``items``, as they come; its ``number`` is the item's position.

    Parameters
    ----------
    items : sequence of Input
        Videos and keypoint files.
    settings : Settings
    identity : mapping, optional
        From `fingerprint.pose_identity`; without it, it is found and the model is tried first.
    workers : int
        0 for one for each core.
    engine : str
        Name of an execution engine.
    on_frames : callable
        Told the input's name and the number of further frames that are done.
    """
    if not items:
        return
    if identity is None:
        videos = any(item.kind == "video" for item in items)
        identity = pose_identity(settings, videos)
        if videos:
            require_model(settings, identity, engine)
    tasks = [Task(n, item.path, item.kind, item.member, item.reader) for n, item in enumerate(items)]
    workers = min(workers or default_workers(len(tasks)), len(tasks))
    runner = registry().make(
        "engine", engine, settings.plugin_options(engine), workers=workers, limits=settings.limits
    )
    job = Job(settings, keypoint_store(), pose_keys(identity), threads_for(workers))
    waiting = set(range(len(tasks)))
    try:
        for outcome in runner.run(job, tasks, lambda task, count: on_frames(items[task.number].name, count)):
            if outcome.number in waiting:
                waiting.remove(outcome.number)
                yield outcome
    except GestureError:
        raise
    except Exception as error:
        raise PluginError(
            f"{_engine(engine)} raised {type(error).__name__}: {error}",
            kept="every committed row",
            remedy="--engine processes, or report it",
            code="E_PLUGIN_RAISED",
        ) from error
    for number in sorted(waiting):
        message = f"{_engine(engine)} gave no outcome; try: --engine processes, or report it"
        yield Outcome(number, code="E_PLUGIN_CONTRACT", message=message)


def _engine(name: str) -> str:
    entry = registry().find("engine", name)
    return f"{entry.title} of {entry.origin}"
