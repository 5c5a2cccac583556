"""A worker: performs tasks one after the other, by the functions of the table.

``python -m gesture_core.run.workers.worker`` is a process of `engines.WorkerProcess`: it takes JSON lines
on standard input and answers on standard output. Whatever native code or a plugin prints goes to standard
error, so that it cannot reach the pipe to the parent.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core import errors
from gesture_core.errors import GestureError, InputError, PluginError, described
from gesture_core.plugin.registry import watch
from gesture_core.records import Job, Outcome, Task

if TYPE_CHECKING:
    from gesture_core.settings import Settings
    from gesture_core.types import PoseSequence

FUNCTIONS: Mapping[str, str] = {
    **dict.fromkeys(
        ("try_model", "extract", "lasts", "accepts", "refusal", "members"),
        "workers.keypoints:KeypointExtractor",
    ),
    **dict.fromkeys(
        ("open_classifier", "add_example", "fit", "open_fitted", "decide", "spot", "keep_distances"),
        "workers.decision:Decider",
    ),
    **dict.fromkeys(("open_query", "find"), "find:Searcher"),
    "cut": "workers.clips",
    "draw_previews": "workers.previews",
    "suffix": "export",
    "write_rows": "export",
}
"""Where each function that a task may name is, below `gesture_core.run`.

That is a class of which a worker makes one and keeps it, or a module whose function takes the `Worker` first.
All of them may run a third party's code. Arguments and values are plain, fit for JSON; paths travel as
`records.encoded`.
"""
_RESERVED = 1024
"""MiB of addresses that libraries reserve and hardly use: allocators' arenas, stacks of threads."""


class Worker:
    """What performs tasks, and what it keeps from one to the next: the network, the examples.

    Parameters
    ----------
    job : Job
    report : callable
        Takes messages for whoever watches: ``{"frames": n}``, ``{"slow": True}``.
    """

    def __init__(self, job: Job, report: Callable[[dict[str, Any]], None]) -> None:
        self.job = job
        self.report = report
        self._kept: dict[str, Any] = {}

    @cached_property
    def settings(self) -> Settings:
        """Those of the job."""
        from gesture_core.settings import settings_from_dict

        return settings_from_dict(self.job.settings)

    def alive(self) -> None:
        """A sign of progress."""
        self.report({"frames": 0})

    def slow(self) -> None:
        """A sign that what follows may take as long as a start."""
        self.report({"slow": True})

    def people(self, stored: str, name: str) -> Sequence[PoseSequence]:
        """Everybody in an input, from the keypoint store."""
        from gesture_core.run.store import read_keypoints

        return read_keypoints(Path(self.job.store) / stored, name).sequences

    def perform(self, task: Task) -> Outcome:
        """Call the function that ``task`` names; whatever goes wrong becomes the outcome's error."""
        failed: GestureError
        try:
            return Outcome(task.number, self._function(task.function)(**task.arguments))
        except GestureError as error:
            failed = error
        except OSError as error:
            cause = f"the system refused {error.filename or 'a file'}: {error.strerror or error}"
            failed = InputError(cause, remedy="check its permissions, and free space", code="E_READ")
        except MemoryError:
            remedy = "--set limits.memory=… with a larger figure, and --retry-errors"
            failed = PluginError("out of memory", remedy=remedy, code="E_WORKER_MEMORY")
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a run goes on without this task
            cause = f"worker function {task.function!r} raised {described(error)}"
            failed = PluginError(cause, remedy="report it", code="E_PLUGIN_RAISED")
        return Outcome(task.number, error=failed)

    def _function(self, name: str) -> Callable[..., Any]:
        module, _, owner = FUNCTIONS[name].partition(":")
        found = import_module(f"gesture_core.run.{module}")
        if not owner:
            return partial(getattr(found, name), self)
        if owner not in self._kept:
            self._kept[owner] = getattr(found, owner)(self)
        return getattr(self._kept[owner], name)  # type: ignore[no-any-return]


def main() -> None:
    """Perform tasks until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def report(message: dict[str, Any]) -> None:
        text = json.dumps(message) + "\n"
        try:
            answers.write(text)
            answers.flush()
        except BrokenPipeError:  # the parent is gone; nobody is left to be answered
            os._exit(1)

    logging.getLogger("gesture_core").addHandler(Notes(report))
    header = json.loads(sys.stdin.readline())
    _limit_memory(int(header["memory"]))
    worker = Worker(Job(**header["job"]), report)
    watch(lambda plugin: report({"plugin": plugin}))
    messages: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_take_messages, args=(messages,), daemon=True).start()
    if worker.job.keys:  # it is going to extract; a start may take its time
        import_module("gesture_core.run.workers.keypoints")
        import_module("pyarrow.parquet")
    report({"ready": True})
    forgotten: GestureError | None = None  # why this process does not know what the one before it knew
    for first in header["first"]:
        forgotten = forgotten or worker.perform(Task(0, **first)).error
        worker.alive()
    while True:
        task = Task(0, **messages.get())
        outcome = Outcome(0, error=forgotten) if forgotten else worker.perform(task)
        try:
            report({"value": outcome.value, "error": outcome.error and as_tree(outcome.error)})
        except (TypeError, ValueError) as error:
            cause = f"worker function {task.function!r} has a value that is no plain one: {error}"
            report({"value": None, "error": as_tree(PluginError(cause, code="E_PLUGIN_CONTRACT"))})


class Notes(logging.Handler):
    """What the package and its plugins log, as messages to the parent."""

    def __init__(self, report: Callable[[dict[str, Any]], None]) -> None:
        super().__init__(logging.WARNING)
        self._report = report

    def emit(self, record: logging.LogRecord) -> None:
        self._report({"note": record.getMessage()})


def as_tree(error: GestureError) -> dict[str, str]:
    """An error as plain values, on its way to the parent."""
    known = next(kind.__name__ for kind in type(error).__mro__ if kind.__module__ == errors.__name__)
    parts = {"cause": error.cause, "subject": error.subject, "kept": error.kept, "remedy": error.remedy}
    return {**parts, "kind": known, "code": error.code}


def from_tree(tree: dict[str, str]) -> GestureError:
    """The inverse of `as_tree`."""
    kind: type[GestureError] = getattr(errors, tree.pop("kind"), PluginError)
    return kind(tree.pop("cause"), **tree)


def _take_messages(messages: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Take messages from the parent; when it is gone, end this process whatever it is doing."""
    for line in sys.stdin:
        messages.put(json.loads(line))
    os._exit(0)


def _limit_memory(mebibytes: int) -> None:
    """Make one giant allocation fail at once; the parent watches slower growth."""
    if sys.platform == "win32":
        return
    import resource

    limit = 2 * mebibytes + _RESERVED << 20
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard == resource.RLIM_INFINITY or limit < hard:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


if __name__ == "__main__":
    main()
