"""The engine ``ray``: Ray places, starts and restarts the actors; here tasks are handed out and given up."""

from __future__ import annotations

import json
import logging
import os
import re
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, PluginError, WorkerError
from gesture_core.files import replacing
from gesture_core.records import Job, Outcome, Task
from gesture_core.run.workers.worker import from_tree
from gesture_core.settings import LimitSettings

OnFrames = Callable[[Task, int], None]
_TICK = 1.0
_START_SECONDS = 120.0
_SECONDS_TO_A_NOTE = 30.0
_STORED = re.compile(r"[0-9a-f]{2}/[0-9a-f]{32}-[0-9a-f]{16}\.parquet")


@dataclass
class RayEngine:
    """``--engine ray --set ray.address=auto`` extracts keypoints on all machines of a cluster.

    An actor is one worker. It has one task at a time, so that an actor or a machine that dies costs that task
    one attempt: it is tried once more, then its outcome has an error. Ray restarts the actor where there is
    room for it.

    Parameters
    ----------
    workers : int
        Actors where Ray is started here; a cluster gets as many as it has room for.
    limits : LimitSettings
        ``seconds`` without a sign of life, after which an actor is ended; ``memory`` that it declares.
    address : str
        ``auto``, ``ray://host:10001`` or another address of a cluster; empty: Ray is started on this machine.
    actors : int
        At most so many; 0 for as many as the cluster's cores allow.
    cpus, gpus : float
        What an actor declares; its network has ``cpus`` threads.
    modules : str
        Wheels or folders of code, separated by commas, that are sent to machines which lack them
        (``py_modules`` of Ray's runtime environment).
    """

    workers: int
    limits: LimitSettings
    address: str = ""
    actors: int = 0
    cpus: float = 1.0
    gpus: float = 0.0
    modules: str = ""
    _job: Job | None = field(default=None, init=False, repr=False)
    _idle: list[Any] = field(default_factory=list, init=False, repr=False)
    _starting: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)
    _places: dict[Any, str] = field(default_factory=dict, init=False, repr=False)
    _own: bool = field(default=False, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.actors < 0 or self.cpus <= 0 or self.gpus < 0:
            raise ConfigError(
                f"ray.actors={self.actors}, ray.cpus={self.cpus:g}, ray.gpus={self.gpus:g}",
                remedy="cpus above zero, the others zero or more",
                code="E_OPTION",
            )

    def run(self, job: Job, tasks: Sequence[Task], on_frames: OnFrames) -> Iterator[Outcome]:
        """Yield one outcome for every task, as they come."""
        if self._job != job:
            self.close()
        self._job = job
        if tasks:
            round_ = _Round(self, job, deque(tasks), on_frames)
            try:
                yield from round_.outcomes()
            finally:
                if round_.busy:  # nobody wants to know any more, and some are at work
                    self.close()

    def close(self) -> None:
        """End the actors, and Ray where it was started here."""
        import ray

        for actor in [*self._idle, *self._starting.values()]:
            ray.kill(actor)
        self._idle, self._starting, self._places, self._job = [], {}, {}, None
        if self._own:
            ray.shutdown()
            self._own = False

    def room(self) -> int:
        """Actors that the cluster has room for, after a connection to it is there."""
        import ray

        if not ray.is_initialized():
            self._connect()
        cores = ray.cluster_resources().get("CPU", 0.0)
        room = int(cores // self.cpus)
        if self.gpus:
            room = min(room, int(ray.cluster_resources().get("GPU", 0.0) // self.gpus))
        if not room:
            raise PluginError(
                f"the Ray cluster has no room for an actor of {self.cpus:g} cores and {self.gpus:g} GPUs",
                remedy="smaller ray.cpus or ray.gpus",
            )
        return min(room, self.actors or room)

    def start(self, job: Job) -> None:
        """Ask Ray for a further actor."""
        import ray

        from gesture_engine_ray.actor import FLAGS, PLACES, Performer

        declared = ray.remote(
            num_cpus=self.cpus,
            num_gpus=self.gpus,
            memory=self.limits.memory << 20,
            max_restarts=-1,
            concurrency_groups={"watch": 1},
        )
        threads = max(1, int(self.cpus))
        environment = {name: os.environ[name] for name in (*FLAGS, *PLACES) if name in os.environ}
        known = json.dumps(asdict(replace(job, threads=threads)))
        actor = declared(Performer).remote(known, str(Path.cwd()), environment)
        self.await_start(actor)

    def await_start(self, actor: Any) -> None:
        """Give ``actor`` nothing to do until it answers."""
        self._starting[actor.ready.options(max_task_retries=-1).remote()] = actor

    def _connect(self) -> None:
        import ray

        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is told to anybody
        modules = [name.strip() for name in self.modules.split(",") if name.strip()]
        known: dict[str, Any] = {"runtime_env": {"py_modules": modules}} if modules else {}
        known |= {"address": self.address} if self.address else {"num_cpus": self.workers, "address": "local"}
        try:
            ray.init(
                log_to_driver=False,
                logging_level=logging.WARNING,
                include_dashboard=None if self.address else False,
                **known,
            )
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise PluginError(
                f"no Ray cluster at {self.address or 'this machine'}: {error}",
                remedy="ray start --head on its first machine, or ray.address of a cluster that runs",
            ) from error
        self._own = True


class _Round:
    """The tasks of one call of `RayEngine.run`."""

    def __init__(self, engine: RayEngine, job: Job, waiting: deque[Task], on_frames: OnFrames) -> None:
        self.busy: dict[Any, tuple[Any, Task]] = {}
        self._engine, self._job, self._waiting, self._on_frames = engine, job, waiting, on_frames
        self._watched: dict[Any, tuple[Any, Task]] = {}
        self._since: dict[Any, tuple[float, bool]] = {}
        self._tried: set[int] = set()
        self._unlucky: set[int] = set()
        self._hung: set[int] = set()

    def outcomes(self) -> Iterator[Outcome]:
        """One for each task."""
        import ray

        engine, room, begun = self._engine, self._engine.room(), time.monotonic()
        while self._waiting or self.busy:
            actors = len(engine._idle) + len(engine._starting) + len(self.busy)
            for _ in range(actors, min(room, len(self._waiting) + len(self.busy))):
                engine.start(self._job)
            while engine._idle and self._waiting:  # no actor has a second task: the rest waits here
                self._give(engine._idle.pop(), self._waiting.popleft())
            if not self.busy and begun and time.monotonic() - begun > _SECONDS_TO_A_NOTE:
                logging.getLogger("gesture_core").warning(
                    "waiting for the Ray cluster to have room for an actor of %g cores, %g GPUs and %d MiB",
                    engine.cpus, engine.gpus, engine.limits.memory,
                )  # fmt: skip
                begun = 0.0
            references = [*self.busy, *self._watched, *engine._starting]
            done, _ = ray.wait(references, num_returns=1, timeout=_TICK)
            for reference in done:
                if reference in engine._starting:
                    self._take_start(reference)
                elif reference in self._watched:
                    self._take_signs(reference)
                else:
                    yield from self._take_outcome(reference)
            self._end_hung()

    def _give(self, actor: Any, task: Task) -> None:
        reference = actor.perform.remote(task.function, json.dumps(dict(task.arguments)))
        self.busy[reference] = actor, task
        self._since[reference] = time.monotonic(), False
        self._watch(actor, task)

    def _watch(self, actor: Any, task: Task) -> None:
        self._watched[actor.signs.options(concurrency_group="watch").remote()] = actor, task

    def _take_start(self, reference: Any) -> None:
        import ray

        actor = self._engine._starting.pop(reference)
        try:
            self._engine._places[actor] = ray.get(reference)
        except ray.exceptions.RayError as error:
            raise PluginError(
                f"an actor cannot be started: {_line(error)}",
                remedy="the same gesture-core and plugins on every machine, or ray.modules",
            ) from error
        self._engine._idle.append(actor)

    def _take_signs(self, reference: Any) -> None:
        import ray

        actor, task = self._watched.pop(reference)
        try:
            frames, alive, slow, notes = ray.get(reference)
        except ray.exceptions.RayError:  # what it works on says the same
            return
        _log(notes)
        working = next((ref for ref, (_, one) in self.busy.items() if one is task), None)
        if working is None:
            return
        if alive:
            self._since[working] = time.monotonic(), slow
            self._on_frames(task, frames)
        self._watch(actor, task)

    def _take_outcome(self, reference: Any) -> Iterator[Outcome]:
        import ray

        actor, task = self.busy.pop(reference)
        del self._since[reference]
        again = task.number in self._tried
        try:
            text, data, (frames, alive, _, notes) = ray.get(reference)
        except ray.exceptions.RayTaskError as error:
            self._engine._idle.append(actor)
            yield Outcome(task.number, error=PluginError(_line(error), code="E_PLUGIN_CONTRACT"))
            return
        except ray.exceptions.RayError as error:
            self._engine.await_start(actor)  # Ray starts it again, here or on another machine
            if not _stands(self._engine._places.get(actor, "")):
                self._unlucky.add(task.number)  # which is no attempt of the input's
            code = "E_WORKER_HANG" if task.number in self._hung else "E_WORKER_CRASH"
            yield from self._failed(task, WorkerError(_cause(error, code), kept="nothing", code=code,
                                                      remedy="--retry-errors"))  # fmt: skip
            return
        self._engine._idle.append(actor)
        if alive:
            self._on_frames(task, frames)
        _log(notes)
        tree = json.loads(text)
        print(tree["traceback"], end="", file=sys.stderr, flush=True)
        failed = tree["error"] and from_tree(tree["error"])
        if failed and failed.code == "E_WORKER_MEMORY":
            yield from self._failed(task, failed)
            return
        if data:
            value = tree["value"]
            _keep(Path(self._job.store), str(value["stored"]), data, fresh=not value["cached"])
        attempts = 1 + (again and task.number not in self._unlucky)
        yield Outcome(task.number, tree["value"], failed, attempts=attempts)

    def _failed(self, task: Task, error: Any) -> Iterator[Outcome]:
        """Once more, or that was it."""
        if task.number in self._tried:
            yield Outcome(task.number, error=error, attempts=2)
        else:
            self._tried.add(task.number)
            self._waiting.append(task)

    def _end_hung(self) -> None:
        import ray

        seconds = self._engine.limits.seconds
        for reference, (actor, task) in self.busy.items():
            since, slow = self._since[reference]
            allowed = max(seconds, _START_SECONDS) if slow else seconds
            if time.monotonic() - since > allowed:
                self._hung.add(task.number)
                self._since[reference] = time.monotonic(), True
                ray.kill(actor, no_restart=False)


def _stands(node: str) -> bool:
    """Whether a machine is there: Ray itself may take some time to notice that it has gone."""
    import ray

    found = [one for one in ray.nodes() if one["NodeID"] == node and one["Alive"]]
    for one in found:
        place = one["NodeManagerAddress"], one["NodeManagerPort"]
        with suppress(OSError), socket.create_connection(place, timeout=2):
            return True
    return False


def _keep(store: Path, stored: str, data: bytes, *, fresh: bool) -> None:
    """Keypoints from another machine into the store of this one; ``fresh`` ones replace those of before."""
    if _STORED.fullmatch(stored) and (fresh or not (store / stored).is_file()):
        with replacing(store / stored) as temporary:
            temporary.write_bytes(data)


def _log(notes: Sequence[str]) -> None:
    for note in notes:
        logging.getLogger("gesture_core").warning(note)


def _cause(error: Exception, code: str) -> str:
    if code == "E_WORKER_HANG":
        return "no progress for longer than limits.seconds"
    return f"the Ray actor or its machine ended ({_line(error)})"


def _line(error: Exception) -> str:
    """The first line of one of Ray's long messages."""
    return " ".join(str(error).split())[:200]
