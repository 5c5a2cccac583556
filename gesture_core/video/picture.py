"""A picture as a video of one frame: JPEG and PNG, whose size is known before they are decoded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Self

from gesture_core.errors import MediaError
from gesture_core.files import open_regular, printable
from gesture_core.records import VideoInfo, VideoLimits, VideoReport

if TYPE_CHECKING:
    import numpy as np

_MOST_BYTES = 256 << 20
_PNG = b"\x89PNG\r\n\x1a\n"
_FRAMES = frozenset((*range(0xC0, 0xD0),)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG after which width and height stand."""
_ALONE = frozenset((0x00, 0x01, *range(0xD0, 0xDA)))
"""Markers without a length, and the first pixels: no picture has one before its size."""
_CODES = ("E_MEDIA_MISSING", "E_MEDIA_UNREADABLE", "E_MEDIA_LIMIT")


class Still:
    """A decoded picture, upright as its EXIF says, in the form of a video.

    Raises
    ------
    MediaError
        `E_MEDIA_FORMAT` for no JPEG or PNG, `E_MEDIA_LIMIT`, `E_MEDIA_BROKEN`, and those of opening a file.
    """

    def __init__(self, path: Path, limits: VideoLimits) -> None:
        import cv2
        import numpy as np

        source = printable(path)
        with open_regular(path, _MOST_BYTES, MediaError, _CODES) as file:
            data = file.read(_MOST_BYTES)
        if not data:
            raise MediaError(
                "is empty, 0 bytes", subject=source, remedy="copy it again", code="E_MEDIA_EMPTY"
            )
        size = _size(data)
        if size is None:
            raise MediaError(
                f"its first bytes ({data[:8].hex(' ')}) are of no JPEG or PNG, or it is damaged",
                subject=source,
                remedy="a picture in JPEG or PNG",
                code="E_MEDIA_FORMAT",
            )
        if size[0] * size[1] > limits.max_pixels:
            raise MediaError(
                f"claims {size[0]} x {size[1]} pixels, more than {limits.max_pixels}",
                subject=source,
                remedy="a larger --set limits.pixels=…",
                code="E_MEDIA_LIMIT",
            )
        frame = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        if frame is None:
            raise MediaError(
                "cannot be decoded", subject=source, remedy="copy it again", code="E_MEDIA_BROKEN"
            )
        self._frame: np.ndarray = frame
        kind = "png" if data.startswith(_PNG) else "jpeg"
        high, wide = frame.shape[:2]
        self.info = VideoInfo(wide, high, 1, None, 0, kind, kind, "picture")
        self.report = VideoReport(1, 1, 0, complete=True, reader="picture")

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        yield 0.0, self._frame

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return None


def _size(data: bytes) -> tuple[int, int] | None:
    """Width and height by the header of a PNG or JPEG; None where it has none."""
    if data.startswith(_PNG) and data[12:16] == b"IHDR":
        return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    place = 2 if data.startswith(b"\xff\xd8\xff") else len(data)
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker, length = data[place + 1], int.from_bytes(data[place + 2 : place + 4], "big")
        if marker in _ALONE:  # behind such a one the length would be that of something else
            return None
        if marker in _FRAMES:
            high, wide = data[place + 5 : place + 7], data[place + 7 : place + 9]
            return int.from_bytes(wide, "big"), int.from_bytes(high, "big")
        place += 1 if marker == 0xFF else 2 + length
    return None
