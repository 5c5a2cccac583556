"""Keypoints of many inputs through an execution engine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gesture_core.errors import (
    Code,
    ConfigError,
    InputError,
    ModelError,
    PluginError,
    RunFolderError,
    WorkerError,
)
from gesture_core.files import cache_dir, tree_sha256, usable_cores
from gesture_core.plugin.abilities import Closeable
from gesture_core.plugin.registry import calling, registry
from gesture_core.pose.models import choose_pose, described
from gesture_core.records import Job, Outcome, Row, Task, encoded
from gesture_core.run.fingerprint import pose_identity, pose_keys
from gesture_core.run.inputs import Input
from gesture_core.run.store import Extracted, keypoint_store, prune, read_keypoints
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import ExecutionEngine


class Listener:
    """Told about work as it goes on; override what is of interest."""

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        """Work is known: all inputs, those that still wait, the examples, the kernel; stages of it add up."""

    def stage(self, name: str) -> None:
        """What is done from now on: ``keypoints``, ``fitting``, ``comparing`` or ``writing``."""

    def network(self, text: str) -> None:
        """What finds people in videos, and where, in words: before it does, maybe more than once."""

    def frames(self, name: str, count: int) -> None:
        """``count`` further frames of an input are done."""

    def extracted(self, name: str, cached: bool) -> None:
        """The keypoints of an input or example are there, or it has failed."""

    def example_failed(self, row: Row) -> None:
        """An example cannot be used."""

    def row(self, row: Row) -> None:
        """A row has been committed."""


class OpenEngine:
    """An execution engine with its job; as a context manager, so that its workers live as long as it does.

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
    listener : Listener, optional
        Told about frames, and inputs whose keypoints are there.
    """

    def __init__(
        self,
        settings: Settings,
        identity: Mapping[str, Any],
        *,
        most: int,
        workers: int = 0,
        engine: str = "processes",
        listener: Listener | None = None,
    ) -> None:
        workers = max(1, min(workers or usable_cores(), most))
        threads = max(1, usable_cores() // workers)
        self._settings, self._identity = settings, identity
        self._job = Job(settings.as_dict(), str(keypoint_store()), pose_keys(identity), threads)
        self._entry = registry().find("engine", engine)
        options = settings.options.get(engine, {})
        self._engine: ExecutionEngine = registry().make(
            "engine", engine, options, workers=workers, limits=settings.limits
        )
        self._listener = listener or Listener()
        self._looks = False

    def __enter__(self) -> OpenEngine:
        return self

    def __exit__(self, *_: object) -> None:
        if isinstance(self._engine, Closeable):
            with calling(self._entry):
                self._engine.close()

    def extract(self, items: Sequence[Input]) -> Iterator[tuple[Input, Extracted]]:
        """What came of each of ``items``, as they come.

        Raises
        ------
        RunFolderError
            ``E_STORE_WRITE`` where the keypoint store cannot be written.
        PluginError
            Where the engine raises.
        """
        plugins, tasks = registry(), []
        for number, item in enumerate(items):
            asked = {"path": encoded(item.path), "member": item.member, "reader": item.reader}
            asked |= {"address": item.address} if item.address else {}
            tasks.append(Task(number, "extract", asked))

        def frames(task: Task, count: int) -> None:
            if count and not self._looks and items[task.number].kind == "video":
                self._looks = True
                self._listener.network(described(self._settings))
            self._listener.frames(items[task.number].name, count)

        for outcome in self._run(tasks, frames):
            item = items[outcome.number]
            if item.kind == "video":
                entry = plugins.find("pose", self._settings.pose.backend)
            else:
                entry = plugins.find("reader", item.reader)
            if outcome.error is None:
                found = Extracted.from_tree(outcome.value)
            elif isinstance(outcome.error, RunFolderError):
                outcome.error.kept = "every committed row"
                raise outcome.error
            else:
                crashed = isinstance(outcome.error, WorkerError) and outcome.error.code == "E_WORKER_CRASH"
                if crashed and item.kind == "video":
                    outcome.error.remedy = (
                        "repair the file, or --set pose.reader=… with the other video reader"
                    )
                found = Extracted(complete=False).failed(outcome.error)
            self._listener.extracted(item.name, found.cached)
            yield item, replace(found, plugin=str(entry.origin), attempts=outcome.attempts)

    def require_model(self) -> None:
        """Try the network that the settings name on a known picture; what passed once is not tried again.

        Raises
        ------
        ModelError
            Where it cannot be loaded, ends its process, or answers with anything but keypoints.
        PoseError
            ``E_POSE_PEOPLE`` where it cannot tell people apart and the settings ask for that.
        RunFolderError
            ``E_STORE_WRITE`` where the cache cannot be written.
        """
        mark = cache_dir() / "probed" / tree_sha256(self._identity["video"])[:32]
        if mark.exists():
            return
        try:
            mark.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunFolderError(
                f"the cache cannot be written: {error.strerror or error}",
                subject=str(cache_dir()),
                remedy="its permissions, or another folder in GESTURE_CACHE",
                code="E_STORE_WRITE",
            ) from error
        for outcome in self._run([Task(0, "try_model")], lambda task, count: None):
            if isinstance(outcome.error, ConfigError):  # of the backend's options, not of the network
                raise outcome.error
            if outcome.error and outcome.error.code == Code.POSE_PEOPLE:
                outcome.error.subject = self._settings.pose.model
                raise outcome.error
            if outcome.error:
                raise ModelError(
                    f"fails on a known picture: {outcome.error}",
                    subject=self._settings.pose.model,
                    remedy="another --model or --pose; 'gesture models' lists them",
                    code="E_MODEL_PROBE",
                )
        mark.touch()

    def _run(self, tasks: Sequence[Task], on_frames: Callable[[Task, int], None]) -> Iterator[Outcome]:
        """One outcome for each task, whatever the engine yields."""
        waiting = {task.number for task in tasks}
        if not tasks:
            return
        instead = "--engine processes, or report it"
        outcomes: Iterator[Outcome] = iter(())
        with calling(self._entry, kept="every committed row", remedy=instead):
            outcomes = iter(self._engine.run(self._job, tasks, on_frames))
        while True:
            with calling(self._entry, kept="every committed row", remedy=instead):
                outcome = next(outcomes, None)
            if outcome is None:
                break
            if outcome.number in waiting:
                waiting.remove(outcome.number)
                yield outcome
        for number in sorted(waiting):
            cause = f"{self._entry} gave no outcome"
            yield Outcome(number, error=PluginError(cause, remedy=instead, code="E_PLUGIN_CONTRACT"))


def extract_all(
    items: Sequence[Input],
    settings: Settings,
    *,
    identity: Mapping[str, Any] | None = None,
    workers: int = 0,
    listener: Listener | None = None,
    inputs: int = 0,
) -> Iterator[tuple[Input, Extracted]]:
    """What came of each of ``items``, from the keypoint store or extracted in worker processes.

    The parameters are those of `OpenEngine`; without ``identity``, it is found. With ``inputs``, the items
    are examples for so many others. The model is tried first where there are videos; as after a run, the
    keypoint store is then brought below its limit.
    """
    listener = listener or Listener()
    listener.planned(inputs or len(items), inputs or len(items), len(items) if inputs else 0, "")
    if not items:
        return
    videos = any(item.kind == "video" for item in items)
    if videos:
        settings = choose_pose(settings)
    identity = pose_identity(settings, items) if identity is None else identity
    added = False
    with OpenEngine(settings, identity, most=len(items), workers=workers, listener=listener) as opened:
        if videos:
            opened.require_model()
        for item, found in opened.extract(items):
            added |= bool(found.stored) and not found.cached
            yield item, found
    if added:
        prune(keypoint_store(), settings.limits.cache)


def people_of(
    items: Sequence[Input], settings: Settings, **options: Any
) -> Iterator[tuple[Input, Extracted, list[PoseSequence]]]:
    """Everybody in each of ``items``; the parameters are those of `extract_all`.

    Yields
    ------
    (Input, Extracted, list of PoseSequence)
        As they come, in any order. The list is empty where there is an error, or nobody was found.
    """
    for item, found in extract_all(items, settings, **options):
        stored = None if found.code else read_keypoints(keypoint_store() / found.stored, item.name)
        yield item, found, stored.sequences if stored else []


def first_person(item: Input, settings: Settings, **options: Any) -> tuple[Extracted, PoseSequence]:
    """The first person in one clip; an error says why there is none. Options as in `extract_all`."""
    ((_, found, people),) = people_of([item], settings, workers=1, **options)
    if found.code:
        raise found.error(item.name)
    if not people:
        raise InputError("nobody is in it", subject=item.name, remedy="another clip", code="E_NO_PERSON")
    return found, people[0]
