"""The other end of `child.Child`: a process that takes JSON lines, one after the other, and answers them.

Whatever native code or a plugin prints goes to standard error, so that it cannot reach the pipe to
the parent.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any, NoReturn

_RESERVED = 1024
"""MiB of addresses that libraries reserve and hardly use: allocators' arenas, stacks of threads."""

Message = dict[str, Any]
Reply = Callable[[Message], None]


def serve(make: Callable[[Message], Callable[[Message, Reply], None]]) -> NoReturn:
    """Answer messages until standard input ends.

    Parameters
    ----------
    make : callable
        Given the first message, the header, it returns what is called with each further message and
        with the function that sends an answer.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def reply(message: Message) -> None:
        replies.write(json.dumps(message) + "\n")
        replies.flush()

    header = json.loads(sys.stdin.readline())
    _limit_memory(int(header["memory"]))
    handle = make(header)
    messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(messages,), daemon=True).start()
    try:
        reply({"ready": True})
        while True:
            handle(messages.get(), reply)
    except BrokenPipeError:  # the parent is gone; nobody is left to tell
        os._exit(1)


def _listen(messages: queue.SimpleQueue[Message]) -> None:
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
