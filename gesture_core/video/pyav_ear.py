"""Listens to FFmpeg through PyAV: what a call raises and what it logs becomes one count of damage."""

from __future__ import annotations

import errno
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from gesture_core.errors import GestureError, MediaError
from gesture_core.video.info import Ledger
from gesture_core.video.source import AGAIN

_MAX_MESSAGE = 200
_levels: list[Any] = []
_lock = threading.Lock()


class Step:
    """One call into FFmpeg: whether it failed, and the first sign of damage."""

    def __init__(self) -> None:
        self.failed = False
        self.clause = ""

    def damage(self, clause: str) -> None:
        """Note a sign of damage; the first one is told."""
        self.clause = self.clause or clause


class Ear:
    """Hears FFmpeg's errors from its making until it is closed.

    Parameters
    ----------
    subject : str
        The file, for errors.
    ledger : Ledger
        Receives the damage.
    """

    def __init__(self, subject: str, ledger: Ledger) -> None:
        self._subject = subject
        self._ledger = ledger
        self._open = True
        self._deaf: frozenset[str] = frozenset()
        self._early: list[tuple[int, str, str]] | None = []
        _raise_level()

    def ignore(self, names: Iterable[str]) -> None:
        """Leave out what the named codecs log: those of streams that are not decoded.

        Logs are kept until this is called, since a container must be opened to know its streams.
        """
        self._deaf = frozenset(names)
        early, self._early = self._early or [], None
        step = Step()
        self._judge(early, step)

    def close(self) -> None:
        """Restore FFmpeg's log level once nobody listens any more."""
        if self._open:
            self._open = False
            _restore_level()

    @contextmanager
    def hear(self, fatal: bool = False) -> Iterator[Step]:
        """Run one call into FFmpeg.

        Raises
        ------
        MediaError
            `E_MEDIA_CODEC`, `E_MEDIA_UNREADABLE`, `E_MEDIA_MEMORY` in any case; with ``fatal``,
            `E_MEDIA_BROKEN` for whatever else FFmpeg raises.
        """
        import av

        step = Step()
        with av.logging.Capture() as logs:
            try:
                yield step
            except GestureError:
                raise
            except av.error.DecoderNotFoundError as error:
                raise self._error("no decoder for its codec", "E_MEDIA_CODEC", "re-encode it") from error
            except (av.error.FFmpegError, ValueError, OverflowError, ArithmeticError, OSError) as error:
                if _from_the_disk(error):
                    raise self._error(
                        f"cannot be read: {_cause(error)}", "E_MEDIA_UNREADABLE", "check the disk"
                    ) from error
                if fatal:
                    raise self._error(
                        f"cannot be decoded: {_cause(error)}", "E_MEDIA_BROKEN", AGAIN
                    ) from error
                step.failed = True
                step.damage(_cause(error))
            except MemoryError as error:
                raise self._error(
                    "not enough memory to decode it", "E_MEDIA_MEMORY", "a smaller video"
                ) from error
        if self._early is not None:
            self._early += logs
            logs = []
        self._judge(logs, step)

    def _judge(self, logs: Iterable[tuple[int, str, str]], step: Step) -> None:
        import av

        for level, name, message in logs:
            if level <= av.logging.ERROR and name not in self._deaf:
                step.damage(_plain(message))
        if step.clause:
            self._ledger.damage(step.clause)

    def _error(self, cause: str, code: str, remedy: str) -> MediaError:
        return MediaError(cause, subject=self._subject, remedy=remedy, code=code)


def _plain(message: str) -> str:
    """A log line that may quote the file, as a clause that is fit for a terminal."""
    text = " ".join(message.split()).rstrip(".")[:_MAX_MESSAGE]
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _from_the_disk(error: Exception) -> bool:
    """Whether reading failed, as opposed to what was read.

    A broken header sends the demuxer to a place before the file's beginning: EINVAL is its fault.
    """
    import av

    return (
        isinstance(error, OSError)
        and not isinstance(error, av.error.FFmpegError)
        and error.errno != errno.EINVAL
    )


def refuse(url: str, flags: int, options: Any) -> NoReturn:
    """What FFmpeg is given to open further files with."""
    raise ValueError(f"a media file may not open {url!r}")


def _cause(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error) or type(error).__name__).rstrip(".")


def _raise_level() -> None:
    import av

    with _lock:
        _levels.append(av.logging.get_level())
        if _levels[-1] is None or _levels[-1] < av.logging.ERROR:
            av.logging.set_level(av.logging.ERROR)


def _restore_level() -> None:
    import av

    with _lock:
        first = _levels[0]
        _levels.pop()
        if not _levels:
            av.logging.set_level(first)
