"""Opens a media file safely and tells its container from its first bytes.

FFmpeg chooses a demuxer by content, and some demuxers (concat, HLS, DASH, image sequences) open other
files. Only containers on the list below are ever handed to it, and by name.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from gesture_core.errors import MediaError

HEAD_BYTES = 4096
_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot", b"moof", b"styp", b"sidx", b"uuid")
_MAGIC: tuple[tuple[bytes, str], ...] = (
    (b"\x1a\x45\xdf\xa3", "matroska"),
    (b"FLV\x01", "flv"),
    (b"OggS", "ogg"),
    (b"GIF87a", "gif"),
    (b"GIF89a", "gif"),
    (b"\x30\x26\xb2\x75\x8e\x66\xcf\x11", "asf"),
    (b"\x00\x00\x01\xba", "mpeg"),
    (b"\x00\x00\x01\xb3", "mpegvideo"),
    (b"YUV4MPEG2", "yuv4mpegpipe"),
    (b"DKIF", "ivf"),
    (b"\x06\x0e\x2b\x34\x02\x05\x01\x01", "mxf"),
)
_RAW_SUFFIXES = {
    ".h264": "h264", ".264": "h264", ".avc": "h264",
    ".h265": "hevc", ".265": "hevc", ".hevc": "hevc",
}  # fmt: skip
CONTAINERS: tuple[str, ...] = (
    "mov", "avi", "mpegts", "mjpeg", "h264", "hevc", *dict.fromkeys(name for _, name in _MAGIC),
)  # fmt: skip
_PLAYLISTS: tuple[bytes, ...] = (b"ffconcat", b"#EXTM3U", b"[playlist]", b"<?xml", b"<MPD", b"<smil", b"v=0")


def open_file(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading; nothing else (a pipe, a device, a folder) is ever opened.

    Raises
    ------
    MediaError
        `E_MEDIA_MISSING`, `E_MEDIA_UNREADABLE`, or `E_MEDIA_EMPTY` for a file of no bytes.
    """
    name = printable(path)
    try:
        # Without O_NONBLOCK a named pipe would hang the process before it could be refused.
        fd = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise MediaError(
            "no such file", subject=name, remedy="check the path", code="E_MEDIA_MISSING"
        ) from None
    except (OSError, ValueError) as error:
        cause = getattr(error, "strerror", None) or str(error)
        raise MediaError(
            f"cannot be opened: {cause}",
            subject=name,
            remedy="check its permissions",
            code="E_MEDIA_UNREADABLE",
        ) from error
    status = os.fstat(fd)
    if not stat.S_ISREG(status.st_mode):
        os.close(fd)
        raise MediaError(
            "is not a regular file", subject=name, remedy="leave it out", code="E_MEDIA_UNREADABLE"
        )
    if status.st_size == 0:
        os.close(fd)
        raise MediaError("is empty, 0 bytes", subject=name, remedy="copy it again", code="E_MEDIA_EMPTY")
    return os.fdopen(fd, "rb", buffering=0)


def printable(path: str | os.PathLike[str]) -> str:
    """``path`` as text that can be encoded, whatever bytes the file name holds."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def container_of(file: BinaryIO, path: str | os.PathLike[str]) -> str:
    """FFmpeg's name of the container that ``file`` begins with; the file is left at its start.

    Raises
    ------
    MediaError
        `E_MEDIA_FORMAT` where the first bytes are of no known video container; a playlist is named
        as such.
    """
    head = file.read(HEAD_BYTES) or b""
    file.seek(0)
    found = _sniff(head, Path(os.fsdecode(path)).suffix.lower())
    if found is not None:
        return found
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text.startswith(_PLAYLISTS):
        cause = "is a playlist, a text that would make the decoder open other files"
    else:
        cause = f"its first bytes ({head[:8].hex(' ')}) are of no video container known here"
    raise MediaError(
        cause,
        subject=printable(path),
        remedy="a video in mp4, mov, mkv, webm, avi, flv, ts or gif",
        code="E_MEDIA_FORMAT",
    )


def _sniff(head: bytes, suffix: str) -> str | None:
    if head[4:8] in _BOXES:
        return "mov"
    if head.startswith(b"RIFF") and head[8:12] in (b"AVI ", b"AVIX", b"AMV "):
        return "avi"
    for magic, name in _MAGIC:
        if head.startswith(magic):
            return name
    for start, step in ((0, 188), (4, 192)):
        marks = [head[at : at + 1] for at in range(start, min(len(head), start + 5 * step), step)]
        if len(marks) >= 2 and all(mark == b"\x47" for mark in marks):
            return "mpegts"
    if head.startswith((b"\x00\x00\x00\x01", b"\x00\x00\x01")) and suffix in _RAW_SUFFIXES:
        return _RAW_SUFFIXES[suffix]
    if head.startswith(b"\xff\xd8\xff") and suffix in (".mjpeg", ".mjpg"):
        return "mjpeg"
    return None
