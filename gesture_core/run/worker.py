"""A worker process: extracts keypoints, one task after the other.

Started as ``python -m gesture_core.run.worker``.
"""

from __future__ import annotations

from collections.abc import Callable

from gesture_core.run.serving import Message, Reply, serve
from gesture_core.run.work import Job, Task


def make(header: Message) -> Callable[[Message, Reply], None]:
    """What answers each task of the header's job with its outcome."""
    import pyarrow.parquet  # noqa: F401 - every task needs it, and a start may take its time

    from gesture_core.run.extractor import Extractor

    say: list[Reply] = []
    extract = Extractor(Job.from_dict(header["job"]), on_opening=lambda: say[0]({"slow": True}))

    def handle(message: Message, reply: Reply) -> None:
        say[:] = [reply]
        task = Task.from_dict(message)
        outcome = extract(task, lambda frames: reply({"frames": frames, "number": task.number}))
        reply({"outcome": outcome.as_dict()})

    return handle


if __name__ == "__main__":
    serve(make)
