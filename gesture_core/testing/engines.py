"""The suite of execution engines. Each check takes an engine, made with ``workers`` and ``limits``.

>>> import pytest
>>> from gesture_core.settings import LimitSettings
>>> from gesture_core.testing import ENGINE_CHECKS
>>> @pytest.mark.parametrize("check", ENGINE_CHECKS)
... def test_my_engine(check):
...     check(MyEngine(workers=2, limits=LimitSettings()))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from gesture_core.errors import GestureError
from gesture_core.plugin.abilities import Closeable
from gesture_core.plugin.interfaces import ExecutionEngine
from gesture_core.records import Job, Outcome, Task, encoded
from gesture_core.settings import load_settings

_FORMATS = {"csv": ".csv", "jsonl": ".jsonl", "parquet": ".parquet"}
_SUFFIXES = tuple(Task(n, "suffix", {"format": name}) for n, name in enumerate(_FORMATS))
"""Tasks whose values are known: the suffix of a result writer."""


def check_engine_outcomes(engine: ExecutionEngine) -> None:
    """One outcome for every task, with its number and its value; none where there is no task."""
    assert isinstance(engine, ExecutionEngine), f"{type(engine).__name__} has no method run"
    with _closing(engine):
        _check_values(engine, _SUFFIXES)
        _check_values(engine, [replace(_SUFFIXES[n % 3], number=n) for n in range(20)])
        _check_values(engine, [])


def check_engine_errors(engine: ExecutionEngine) -> None:
    """A task that fails has an outcome with its error, and costs the others nothing."""
    name = type(engine).__name__
    wrong = [Task(7, "suffix", {"format": "no-such-format"}), Task(8, "no_such_function")]
    with _closing(engine):
        outcomes = _run(engine, [wrong[0], *_SUFFIXES, wrong[1]])
    for task in wrong:
        errors = [outcome.error for outcome in outcomes if outcome.number == task.number]
        assert len(errors) == 1 and isinstance(errors[0], GestureError), (
            f"{name}.run: the outcomes of a task that fails ({task.function}) have the errors {errors}, "
            "expected one, the GestureError that its function raised"
        )
    rest = [outcome for outcome in outcomes if outcome.number < len(_SUFFIXES)]
    _check_outcomes(engine, _SUFFIXES, rest)


def check_engine_runs(engine: ExecutionEngine) -> None:
    """Runs again: with the same job and another one, after it was left in the middle, after `close`."""
    with _closing(engine):
        for preset in ("paper", "modern", "modern"):
            job = Job(load_settings(preset).as_dict(), "")
            for _ in engine.run(job, _SUFFIXES, _ignore):
                break
            _check_values(engine, _SUFFIXES, job)
    with _closing(engine):
        _check_values(engine, _SUFFIXES)


def check_engine_progress(engine: ExecutionEngine) -> None:
    """``on_frames`` is called with a task and its further frames; with none, as a sign of life, as well."""
    name, path = type(engine).__name__, encoded(__file__)
    tasks = [Task(n, "accepts", {"reader": "store", "paths": [path, path]}) for n in range(3)]
    seen: list[tuple[Task, int]] = []
    with _closing(engine):
        outcomes = _run(engine, tasks, on_frames=lambda task, count: seen.append((task, count)))
    for outcome in outcomes:
        assert outcome.value == [False, False], f"{name}.run: {outcome.error or outcome.value}"
    assert all(task in tasks and count == 0 for task, count in seen), (
        f"{name}.run calls on_frames with {seen[0]}, expected a task and the frames that it reported"
    )
    assert all(any(task == one for one, _ in seen) for task in tasks), (
        f"{name}.run does not call on_frames for every task that reports frames"
    )


def _ignore(task: Task, frames: int) -> None:
    """Nobody watches."""


def _run(
    engine: ExecutionEngine,
    tasks: Sequence[Task],
    job: Job | None = None,
    on_frames: Callable[[Task, int], None] = _ignore,
) -> list[Outcome]:
    """All outcomes of ``tasks``."""
    job = job or Job(load_settings("modern").as_dict(), "")
    try:
        return list(engine.run(job, tasks, on_frames))
    except Exception as error:
        raise AssertionError(
            f"{type(engine).__name__}.run raises {type(error).__name__}: {error}; a task that fails has an "
            "outcome that says so"
        ) from error


def _check_values(engine: ExecutionEngine, tasks: Sequence[Task], job: Job | None = None) -> None:
    """Perform ``tasks`` of `_SUFFIXES` and look at what came of them."""
    _check_outcomes(engine, tasks, _run(engine, tasks, job))


def _check_outcomes(engine: ExecutionEngine, tasks: Sequence[Task], outcomes: Sequence[Outcome]) -> None:
    """Every one of ``tasks`` has one outcome, and that the right one."""
    name, wanted = type(engine).__name__, {task.number: _FORMATS[task.arguments["format"]] for task in tasks}
    numbers = sorted(outcome.number for outcome in outcomes)
    assert numbers == sorted(wanted), (
        f"{name}.run yields outcomes of the tasks {numbers}, expected one of each of {sorted(wanted)}"
    )
    for outcome in outcomes:
        assert outcome.error is None, f"{name}.run: a task that can be performed fails: {outcome.error}"
        assert outcome.value == wanted[outcome.number], (
            f"{name}.run: the outcome of task {outcome.number} has the value {outcome.value!r}, expected "
            f"{wanted[outcome.number]!r}, that of its own task"
        )


@contextmanager
def _closing(engine: ExecutionEngine) -> Iterator[None]:
    """Close the engine at the end, if it can be closed."""
    try:
        yield
    finally:
        if isinstance(engine, Closeable):
            engine.close()


ENGINE_CHECKS: tuple[Callable[[ExecutionEngine], None], ...] = (
    check_engine_outcomes,
    check_engine_errors,
    check_engine_runs,
    check_engine_progress,
)
"""The suite of execution engines."""
