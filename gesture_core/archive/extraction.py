"""Keypoints of many inputs through an execution engine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from gesture_core.archive.discovery import Input
from gesture_core.archive.fingerprint import fingerprint, pose_identity
from gesture_core.archive.probe import require_model
from gesture_core.archive.run import default_workers, keypoint_store, threads_for
from gesture_core.archive.work import Job, Outcome, Task
from gesture_core.plugin import registry
from gesture_core.settings import Settings


def extract_all(
    items: Sequence[Input],
    settings: Settings,
    *,
    pose_key: str = "",
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
    pose_key : str
        Hash of what decides the keypoints; computed where it is not given.
    workers : int
        0 for one for each core.
    engine : str
        Name of an execution engine.
    on_frames : callable
        Told the input's name and the number of further frames that are done.
    """
    if not items:
        return
    if not pose_key:
        videos = any(item.kind == "video" for item in items)
        identity = pose_identity(settings, videos)
        pose_key = fingerprint(identity)
        if videos:
            require_model(settings, identity, engine)
    tasks = [Task(n, item.path, item.kind, item.member, item.reader) for n, item in enumerate(items)]
    workers = min(workers or default_workers(len(tasks)), len(tasks))
    runner = registry().make(
        "engine", engine, settings.plugin_options(engine), workers=workers, limits=settings.limits
    )
    job = Job(settings, keypoint_store(), pose_key, threads_for(workers))
    yield from runner.run(job, tasks, lambda task, count: on_frames(items[task.number].name, count))
