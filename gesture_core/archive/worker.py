"""A worker process: reads tasks as JSON lines, writes outcomes as JSON lines.

Started as ``python -m gesture_core.archive.worker``. Whatever native code or a plugin prints goes
to standard error, so that it cannot reach the pipe to the parent.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import sys
import threading
from typing import IO, Any, NoReturn

from gesture_core.archive.work import Job, Task


def main() -> NoReturn:
    """Serve tasks until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    header = json.loads(sys.stdin.readline())
    _limit_memory(int(header["memory"]))
    from gesture_core.archive.extractor import Extractor

    extract = Extractor(Job.from_dict(header["job"]))
    tasks: queue.SimpleQueue[Task] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(tasks,), daemon=True).start()
    try:
        _reply(replies, {"ready": True})
        while True:
            task = tasks.get()

            def report(frames: int, number: int = task.number) -> None:
                _reply(replies, {"frames": frames, "number": number})

            _reply(replies, {"outcome": extract(task, report).as_dict()})
    except BrokenPipeError:  # the parent is gone; nobody is left to tell
        os._exit(1)


def _listen(tasks: queue.SimpleQueue[Task]) -> None:
    """Take tasks from the parent; when it is gone, end this process whatever it is doing."""
    for line in sys.stdin:
        tasks.put(Task.from_dict(json.loads(line)))
    os._exit(0)


def _reply(pipe: IO[str], message: dict[str, Any]) -> None:
    pipe.write(json.dumps(message) + "\n")
    pipe.flush()


def _limit_memory(mebibytes: int) -> None:
    """Make one giant allocation fail at once; the parent watches slower growth."""
    if sys.platform == "win32":
        return
    import resource

    limit = 2 * mebibytes << 20
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard == resource.RLIM_INFINITY or limit < hard:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


if __name__ == "__main__":
    main()
