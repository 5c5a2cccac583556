"""What the two decoders share: whose file it is, what it may cost, and how its errors read."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from contextlib import ExitStack
from typing import BinaryIO

from gesture_core.errors import MediaError
from gesture_core.video.info import Ledger, MediaInfo
from gesture_core.video.limits import Limits
from gesture_core.video.sniff import printable

AGAIN = "copy it again from where it came"
"""Remedy for a damaged file."""


class Source(ABC):
    """The frames of one open file, as stored, with the container's stamps.

    Its first frame is decoded at once, and described in ``info``.

    Parameters
    ----------
    file : binary file
        Open and at its start; the caller closes it.
    path : path
        Named in errors.
    container : str
        FFmpeg's demuxer, from `sniff.container_of`.
    limits : Limits
    ledger : Ledger
        Receives damage and notes.
    """

    def __init__(
        self,
        file: BinaryIO,
        path: str | os.PathLike[str],
        container: str,
        limits: Limits,
        ledger: Ledger,
    ) -> None:
        self._file = file
        self._subject = printable(path)
        self._format = container
        self._limits = limits
        self._ledger = ledger
        self._path = path
        self._opened = ExitStack()
        try:
            self.info = self._start()
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def _start(self) -> MediaInfo:
        """Open the decoder, decode the first frame, describe the video.

        What must be released goes to ``_opened`` as soon as it is there.
        """

    def close(self) -> None:
        """Release the decoder, however far it was opened."""
        self._opened.close()

    def _check_size(self, width: float, height: float) -> None:
        """A MediaError where a picture of ``width`` x ``height`` pixels exceeds the limit."""
        if width * height > self._limits.max_pixels:
            raise self._error(
                f"its frames of {width:g} x {height:g} pixels exceed the limit of {self._limits.max_pixels}",
                "E_MEDIA_LIMIT",
                "--set limits.pixels=… with a larger figure",
            )

    def _no_frame(self) -> MediaError:
        return self._error(
            "holds a video stream, but not one frame of it decodes", "E_MEDIA_NO_FRAMES", AGAIN
        )

    def _error(self, cause: str, code: str, remedy: str) -> MediaError:
        return MediaError(cause, subject=self._subject, remedy=remedy, code=code)
