"""Where third-party plugins do what is otherwise done in this process: in one that may die of them."""

from __future__ import annotations

import queue
from collections.abc import Mapping
from typing import Any

from gesture_core import errors
from gesture_core.errors import GestureError, PluginError
from gesture_core.run.child import Child, Inbox, messages
from gesture_core.settings import LimitSettings

_SLOW = frozenset({"open", "example", "fit"})
"""Questions that may take as long as a start: plugins import with them what they need."""


class SandboxDeath(PluginError):
    """The process of the sandbox has ended, or had to be ended, before it gave an answer."""


class Sandbox:
    """A process that is started when it is first asked something, and again after its death.

    Parameters
    ----------
    limits : LimitSettings
        ``seconds`` without a sign of progress and ``memory``, beyond which it is ended.

    Attributes
    ----------
    started : int
        Processes so far; whoever has left something in one must do so again after the next.
    """

    def __init__(self, limits: LimitSettings) -> None:
        self.started = 0
        self._limits = limits
        self._inbox: Inbox = queue.Queue()
        self._child: Child | None = None

    def ask(self, what: str, **arguments: Any) -> Any:
        """The answer to a question of `sandboxed`, plain values both ways.

        Raises
        ------
        SandboxDeath
            Where the process died of it; its code says how.
        GestureError
            What the plugin raised, with the class that it had.
        """
        child = self.start()
        child.give(what, {"ask": what, "arguments": arguments}, slow=what in _SLOW)
        while True:
            for sender, message in messages(self._inbox):
                if sender is not child:
                    continue
                if "answer" in message:
                    child.work = None
                    return message["answer"]
                if "error" in message:
                    child.work = None
                    raise _rebuilt(message["error"])
            death = child.failure()
            if death:
                self.close()
                cause = death.cause + child.last_words()
                raise SandboxDeath(cause, remedy=death.remedy, code=death.code)

    def start(self) -> Child:
        """The process, started where it does not run."""
        if self._child is not None and not self._child.failure():
            return self._child
        self.close()
        self.started += 1
        self._child = Child("gesture_core.run.sandboxed", {}, 1, self._limits, self._inbox)
        return self._child

    def close(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.kill()
        self._child = None

    def ask_twice(self, what: str, **arguments: Any) -> Any:
        """`ask`, once more where the process dies of it the first time."""
        try:
            return self.ask(what, **arguments)
        except SandboxDeath:
            return self.ask(what, **arguments)

    def __enter__(self) -> Sandbox:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def told(error: GestureError) -> dict[str, str]:
    """An error as plain values, on its way to the parent."""
    known = next(kind.__name__ for kind in type(error).__mro__ if kind.__module__ == errors.__name__)
    parts = {"cause": error.cause, "subject": error.subject, "kept": error.kept, "remedy": error.remedy}
    return {**parts, "kind": known, "code": error.code}


def _rebuilt(tree: Mapping[str, str]) -> GestureError:
    parts = {name: tree[name] for name in ("subject", "kept", "remedy", "code")}
    error: GestureError = getattr(errors, tree["kind"])(tree["cause"], **parts)
    return error
