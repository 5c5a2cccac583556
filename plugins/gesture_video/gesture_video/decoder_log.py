"""What FFmpeg raises and logs while PyAV decodes, as counts of damage."""

from __future__ import annotations

import errno
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from gesture_core.errors import GestureError, MediaError
from gesture_core.video import DamageLog

_MAX_MESSAGE = 200


@dataclass
class Call:
    """One call into FFmpeg: whether it failed, and the first sign of damage."""

    failed: bool = False
    damage: str = ""


class DecoderLog:
    """What FFmpeg raises and logs, call by call: one count of damage for each call that shows any.

    Parameters
    ----------
    error : callable
        Makes a MediaError of a cause, a code and a remedy; `VideoDecoder.error`.
    log : DamageLog
        Receives the damage.
    """

    def __init__(self, error: Callable[..., MediaError], log: DamageLog) -> None:
        self._error = error
        self._log = log
        self._ignored: frozenset[str] = frozenset()
        self._early: list[tuple[int, str, str]] | None = []

    def ignore(self, names: Iterable[str]) -> None:
        """Leave out what the named codecs log: those of streams that are not decoded.

        Messages are kept until this is called, since a container must be opened to know its streams.
        """
        self._ignored = frozenset(names)
        early, self._early = self._early or [], None
        self._count(Call(), early)

    @contextmanager
    def call(self, fatal: bool = False) -> Iterator[Call]:
        """Run one call into FFmpeg.

        Raises
        ------
        MediaError
            `E_MEDIA_CODEC`, `E_MEDIA_UNREADABLE`, `E_MEDIA_MEMORY` in any case; with ``fatal``,
            `E_MEDIA_BROKEN` for whatever else FFmpeg raises.
        """
        import av

        call = Call()
        with av.logging.Capture() as messages:
            try:
                yield call
            except GestureError:
                raise
            except av.error.DecoderNotFoundError as error:
                raise self._error("no decoder for its codec", "E_MEDIA_CODEC", "re-encode it") from error
            except (av.error.FFmpegError, ValueError, OverflowError, ArithmeticError, OSError) as error:
                cause = (getattr(error, "strerror", None) or str(error) or type(error).__name__).rstrip(".")
                disk = isinstance(error, OSError) and not isinstance(error, av.error.FFmpegError)
                # A broken header sends the demuxer to a place before the file's beginning: that is EINVAL,
                # and the fault of what was read, not of the disk.
                if disk and getattr(error, "errno", None) != errno.EINVAL:
                    raise self._error(
                        f"cannot be read: {cause}", "E_MEDIA_UNREADABLE", "check the disk"
                    ) from error
                if fatal:
                    raise self._error(f"cannot be decoded: {cause}", "E_MEDIA_BROKEN") from error
                call.failed = True
                call.damage = call.damage or cause
            except MemoryError as error:
                raise self._error(
                    "not enough memory to decode it", "E_MEDIA_MEMORY", "a smaller video"
                ) from error
        if self._early is not None:
            self._early += messages
            messages = []
        self._count(call, messages)

    def _count(self, call: Call, messages: Iterable[tuple[int, str, str]]) -> None:
        """Note the first sign of damage of a call, which may be an error among the messages."""
        import av

        for level, name, message in messages:
            if level <= av.logging.ERROR and name not in self._ignored:
                call.damage = call.damage or _clause(message)
        if call.damage:
            self._log.damage(call.damage)


def _clause(message: str) -> str:
    """A message that may quote the file, as a clause that is fit for a terminal."""
    text = " ".join(message.split()).rstrip(".")[:_MAX_MESSAGE]
    return "".join(letter if letter.isprintable() else "?" for letter in text)


_levels: list[int | None] = []
_lock = threading.Lock()


@contextmanager
def errors_are_logged() -> Iterator[None]:
    """Have FFmpeg log errors while any video is open, and restore its level after the last one."""
    import av

    with _lock:
        _levels.append(av.logging.get_level())
        if _levels[-1] is None or _levels[-1] < av.logging.ERROR:
            av.logging.set_level(av.logging.ERROR)
    try:
        yield
    finally:
        with _lock:
            first = _levels[0]
            _levels.pop()
            if not _levels:
                av.logging.set_level(first)
