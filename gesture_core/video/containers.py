"""Opens a video file safely and recognises its container by its first bytes.

FFmpeg chooses a demuxer by content, and some demuxers (concat, HLS, DASH, image sequences) open other
files. Only containers on the list below are ever handed to it, and by name.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import BinaryIO, cast

from gesture_core.errors import MediaError
from gesture_core.files import open_regular, printable

PICTURES = frozenset((".jpg", ".jpeg", ".png"))
"""What the name of a picture ends in, which may be a video of one frame."""
_HEAD_BYTES = 4096
_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot", b"moof", b"styp", b"sidx", b"uuid")
_MAGIC: dict[bytes, str] = {
    b"\x1a\x45\xdf\xa3": "matroska", b"FLV\x01": "flv", b"OggS": "ogg", b"GIF87a": "gif", b"GIF89a": "gif",
    b"\x30\x26\xb2\x75\x8e\x66\xcf\x11": "asf", b"\x00\x00\x01\xba": "mpeg",
    b"\x00\x00\x01\xb3": "mpegvideo", b"YUV4MPEG2": "yuv4mpegpipe", b"DKIF": "ivf",
    b"\x06\x0e\x2b\x34\x02\x05\x01\x01": "mxf", b"\x1f\x07\x00\x3f": "dv", b"\x1f\x07\x00\xbf": "dv",
}  # fmt: skip
_RAW_SUFFIXES = {
    ".h264": "h264", ".264": "h264", ".avc": "h264",
    ".h265": "hevc", ".265": "hevc", ".hevc": "hevc",
}  # fmt: skip
_BROADCAST = (".ts", ".mts", ".m2ts")
# What a stream without a container begins with: a parameter set, or the mark of a picture's beginning.
_FIRST_UNITS = {
    "h264": (b"\x67", b"\x47", b"\x27", b"\x09\x10", b"\x09\x30", b"\x09\x50", b"\x09\xf0"),
    "hevc": (b"\x40\x01", b"\x46\x01"),
    "m4v": (b"\xb0", b"\x00\x00\x00\x01\x20"),
}
# Still pictures and sound in the container of videos.
_OTHER_BRANDS = (b"heic", b"heix", b"mif1", b"avif", b"crx ", b"m4a ", b"m4b ", b"f4a ", b"f4b ", b"jp2 ")
# What the header of a video has and that of sound has not.
_MARKED = {
    "ogg": (b"\x80theora", b"BBCD\0", b"OVP80"),
    "asf": (bytes.fromhex("c0ef19bc4d5bcf11a8fd00805f5c442b"),),
}
CONTAINERS: tuple[str, ...] = (
    "mov", "avi", "mpegts", "mjpeg", "apng", *_FIRST_UNITS, *dict.fromkeys(_MAGIC.values()),
)  # fmt: skip
"""FFmpeg's names of the containers that are read."""
UNTIMED = frozenset({*_FIRST_UNITS, "mpegvideo", "mjpeg"})
"""Those of them that are none: a stream as the encoder wrote it, without times."""
_PLAYLISTS: tuple[bytes, ...] = (b"ffconcat", b"#EXTM3U", b"[playlist]", b"<?xml", b"<MPD", b"<smil", b"v=0")


def open_container(path: Path) -> tuple[BinaryIO, str]:
    """Open a video file at its start, unbuffered; with FFmpeg's name of its container.

    Raises
    ------
    MediaError
        `E_MEDIA_MISSING`; `E_MEDIA_UNREADABLE`, also for what is no regular file (a pipe, a device, a
        folder), which is never opened; `E_MEDIA_EMPTY` for a file of no bytes; `E_MEDIA_FORMAT` where
        the first bytes are of no known container, a playlist among them.
    """
    codes = ("E_MEDIA_MISSING", "E_MEDIA_UNREADABLE", "E_MEDIA_LIMIT")
    buffered = open_regular(path, sys.maxsize, MediaError, codes)
    # A decoder that is given the descriptor must find the file where Python left it.
    file = cast(io.FileIO, cast(io.BufferedReader, buffered).detach())
    try:
        head = file.read(_HEAD_BYTES)
        file.seek(0)
        container = _container_of(head, path.suffix.lower())
        if container:
            return file, container
        code, remedy = "E_MEDIA_FORMAT", "a video in mp4, mov, mkv, webm, avi, flv, ts or gif"
        if not head:
            cause, code, remedy = "is empty, 0 bytes", "E_MEDIA_EMPTY", "copy it again"
        elif head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_PLAYLISTS):
            cause = "is a playlist, a text that would make the decoder open other files"
        else:
            cause = f"its first bytes ({head[:8].hex(' ')}) are of no video container known here"
        raise MediaError(cause, subject=printable(path), remedy=remedy, code=code)
    except BaseException:
        file.close()
        raise


def begins_as_video(path: Path) -> bool:
    """Whether a file is a video by its first bytes, whatever its name ends in.

    Stricter than `open_container`, which is asked about what somebody calls a video: not for pictures and
    sound in a container of videos, nor for a text that happens to begin as one.
    """
    try:
        file, container = open_container(path)
    except (MediaError, OSError):
        return False
    with file:
        head = file.read(_HEAD_BYTES)
        size = file.seek(0, 2)
    if container == "mov":
        length = int.from_bytes(head[:4], "big")
        brand = head[8:12] if head[4:8] == b"ftyp" else b""
        return (length in (0, 1) or 8 <= length <= size) and brand.lower() not in _OTHER_BRANDS
    if container == "mpegts":
        return size >= 5 * 192  # so that five packets began as they should
    if container in _MARKED:
        return any(mark in head for mark in _MARKED[container])
    return True


def _container_of(head: bytes, suffix: str) -> str:
    """The container of a file that begins with ``head``; empty for none that is known."""
    if head[4:8] in _BOXES:
        return "mov"
    if head.startswith(b"RIFF") and head[8:12] in (b"AVI ", b"AVIX", b"AMV "):
        return "avi"
    if head.startswith(b"RIFF") and head[8:12] == b"CDXA":  # a file of a video CD, sectors and all
        return "mpeg"
    for magic, name in _MAGIC.items():
        if head.startswith(magic):
            return name
    if head.startswith(b"\x89PNG") and b"acTL" in head.partition(b"IDAT")[0]:
        return "apng"
    half = len(head) // 2
    for start, step in ((0, 188), (4, 192)):
        marks = [head[at : at + 1] for at in range(start, min(len(head), start + 5 * step), step)]
        if len(marks) >= 2 and all(mark == b"\x47" for mark in marks):
            return "mpegts"
        # A recording that begins amid a packet, or behind remains: the later half keeps step.
        if suffix in _BROADCAST and any(
            head[half + phase :: step].count(0x47) >= (len(head) - half) // step > 5 for phase in range(step)
        ):
            return "mpegts"
    if head.startswith((b"\x00\x00\x00\x01", b"\x00\x00\x01")) and suffix in _RAW_SUFFIXES:
        return _RAW_SUFFIXES[suffix]
    if head.startswith(b"\xff\xd8\xff") and suffix in (".mjpeg", ".mjpg"):
        return "mjpeg"
    start = head.find(b"\x00\x00\x01", 0, 4) + 3  # 2 where there is none
    for name, units in _FIRST_UNITS.items():
        if start > 2 and head.startswith(units, start):
            return name
    return ""
