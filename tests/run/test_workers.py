"""Worker processes: what one that ended must not cost, and what a new one must know."""

from __future__ import annotations

import pytest

from gesture_core.errors import GestureError, KeypointError
from gesture_core.run.workers.engines import Assistant, ProcessEngine
from gesture_core.settings import LimitSettings, load_settings
from gesture_core.types import Job, Outcome, Task

SUFFIX = Task(0, "suffix", {"format": "csv"})


def perform(engine: ProcessEngine, task: Task) -> Outcome:
    (outcome,) = engine.run(Job({}, ""), [task], lambda task, frames: None, retry=False)
    return outcome


def test_a_process_that_ended_while_it_was_idle_costs_no_task() -> None:
    engine = ProcessEngine(1, LimitSettings())
    try:
        assert perform(engine, SUFFIX).value == ".csv"
        (process,) = engine._processes
        process._process.kill()
        process._process.wait()
        assert perform(engine, SUFFIX).value == ".csv"
    finally:
        engine.close()


def test_what_a_new_process_cannot_learn_again_is_an_error() -> None:
    """It answered with what it did not know: other labels, without a word."""
    engine = ProcessEngine(1, LimitSettings())
    engine.first.append(Task(0, "add_example", {"name": "a", "label": "wave", "stored": "gone.parquet"}))
    job = Job(load_settings("paper", environment={}, classify__kernel="numpy").as_dict(), "/nowhere")
    try:
        (outcome,) = engine.run(job, [SUFFIX], lambda task, frames: None)
        assert isinstance(outcome.error, KeypointError) and outcome.error.code == "E_STORE"
    finally:
        engine.close()


@pytest.mark.parametrize("inline", [True, False])
def test_an_unknown_plugin_is_the_same_error_wherever_it_is_asked_for(inline: bool) -> None:
    with (
        Assistant(Job({}, ""), LimitSettings(), inline=inline) as assistant,
        pytest.raises(GestureError, match="no result writer 'nonsense'") as caught,
    ):
        assistant.ask("suffix", {"format": "nonsense"})
    assert caught.value.code == "E_PLUGIN_UNKNOWN"
