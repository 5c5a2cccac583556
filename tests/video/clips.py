"""Makes short real clips in the test: every container and codec that this machine can write."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

if TYPE_CHECKING:
    from av.video.stream import VideoStream

FRAMES = 36
SIZE = (96, 64)
_ENCODERS = {"h264": "libx264", "hevc": "libx265", "vp9": "libvpx-vp9", "mjpeg": "mjpeg", "mpeg4": "mpeg4"}
_CONTAINERS = {
    "mp4": ("h264", "hevc", "vp9", "mpeg4", "mjpeg"),
    "avi": ("h264", "mpeg4", "mjpeg"),
    "mkv": ("h264", "hevc", "vp9", "mpeg4", "mjpeg"),
    "webm": ("vp9",),
}
_FRAGMENTED = {"movflags": "frag_keyframe+empty_moov+default_base_moof"}
KINDS = tuple((container, codec) for container, codecs in _CONTAINERS.items() for codec in codecs)


@dataclass(frozen=True)
class Clip:
    """A healthy clip as bytes."""

    name: str
    container: str
    codec: str
    frames: int
    data: bytes


def picture(index: int, width: int = SIZE[0], height: int = SIZE[1]) -> np.ndarray:
    """Frame ``index`` of every clip: a bright block that moves over a gradient, BGR."""
    y, x = np.mgrid[:height, :width]
    frame = np.stack([x * 255 // width, y * 255 // height, (x + y + 3 * index) % 256], axis=2)
    left, top = (index * 3) % (width - 16), (index * 2) % (height - 16)
    frame[top : top + 16, left : left + 16] = (20, 240, 250)
    return frame.astype(np.uint8)


def write_clip(
    path: Path,
    codec: str,
    *,
    frames: int = FRAMES,
    fps: int = 25,
    size: tuple[int, int] = SIZE,
    options: dict[str, str] | None = None,
    stamps: list[int] | None = None,
    container_options: dict[str, str] | None = None,
) -> None:
    """Encode `frames` pictures to ``path``; ``stamps`` are time stamps in milliseconds."""
    from fractions import Fraction

    import av

    with av.open(str(path), "w", options=container_options or {}) as container:
        stream = cast("VideoStream", container.add_stream(_ENCODERS.get(codec, codec), rate=fps))
        stream.width, stream.height = size
        stream.pix_fmt = {"mjpeg": "yuvj420p", "gif": "rgb8"}.get(codec, "yuv420p")
        base = {"libx264": {"preset": "veryfast", "g": "12"}, "libvpx-vp9": {"cpu-used": "8", "g": "12"}}
        base["libx265"] = {"preset": "ultrafast", "x265-params": "log-level=none:keyint=12:pools=1"}
        stream.options = {**base.get(_ENCODERS.get(codec, codec), {}), **(options or {})}
        if stamps is not None:
            stream.codec_context.time_base = Fraction(1, 1000)
        for index in range(frames):
            frame = av.VideoFrame.from_ndarray(picture(index, *size), format="bgr24")
            if stamps is not None:
                frame.pts, frame.time_base = stamps[index], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def make_clips(folder: Path, kinds: tuple[tuple[str, str], ...] = KINDS) -> list[Clip]:
    """One clip for each container and codec whose encoder is there."""
    import av

    clips = []
    for container, codec in kinds:
        path = folder / f"{codec}.{container}"
        try:
            av.Codec(_ENCODERS[codec], "w")
        except ValueError:  # this build of FFmpeg lacks the encoder
            continue
        # AVI stamps packets in the order of the file: pictures that come out of order confuse it.
        write_clip(path, codec, options={"bf": "0"} if container == "avi" else None)
        clips.append(Clip(path.name, container, codec, FRAMES, path.read_bytes()))
    fragmented = folder / "fragmented.mp4"
    write_clip(fragmented, "mpeg4", container_options=_FRAGMENTED)
    clips.append(Clip(fragmented.name, "mp4", "mpeg4", FRAMES, fragmented.read_bytes()))
    return clips
