"""The front door: opens a video with the reader that is asked for, or with the best one that is installed."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Self

from gesture_core.errors import MediaError, MissingDependencyError
from gesture_core.plugin.abilities import LazyFrames
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import VideoInfo, VideoLimits, VideoReport
from gesture_core.video.containers import PICTURES

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.plugin.interfaces import Video, VideoReader
    from gesture_core.settings import Settings
    from gesture_core.settings.schema import VideoSettings

Options = Mapping[str, Mapping[str, Any]]
Picture = tuple[float, Callable[[], "np.ndarray | None"]]
"""The second of a frame, and what gives its pixels, or None where they cannot be converted."""
_RECENT = 15
"""Frames whose median interval says how far apart they are."""


def open_video(
    path: str | os.PathLike[str],
    reader: str = "auto",
    limits: VideoLimits | None = None,
    options: Options | None = None,
    rates: VideoSettings | None = None,
) -> Video:
    """Open a video for reading.

    Parameters
    ----------
    path : path
        Any file name, of any bytes. The first frame is decoded here, so that a file that holds none
        fails here.
    reader : str
        Name of a video reader, or ``auto``: ``pyav`` where PyAV is installed and ``opencv`` elsewhere;
        ``info.reader`` says which.
    limits : VideoLimits, optional
    options : mapping of mappings, optional
        Options of plugins by their name, as in `Settings.options`.
    rates : VideoSettings, optional
        [video]: the frames a second of streams without times, or of every video; whether a picture is one.

    Raises
    ------
    MediaError
        `E_MEDIA_MISSING`, `E_MEDIA_UNREADABLE`, `E_MEDIA_EMPTY`, `E_MEDIA_FORMAT` (no container of the
        list, a playlist), `E_MEDIA_BROKEN`, `E_MEDIA_NO_VIDEO`, `E_MEDIA_NO_FRAMES`, `E_MEDIA_CODEC`,
        `E_MEDIA_MEMORY`, `E_MEDIA_LIMIT`.
    PluginError
        Where there is no reader of that name, or it raises anything else.
    MissingDependencyError
        Where what the reader needs is not installed.
    """
    if rates is not None and rates.pictures and Path(path).suffix.lower() in PICTURES:
        from gesture_core.video.picture import Still

        return Still(Path(path), limits or VideoLimits())
    name, chosen = _choose(reader, options or {})
    with calling(registry().find("video", name), passing=(OSError,)):
        video = chosen.open(Path(path), limits or VideoLimits())
    if rates is None or (rates.fps is None and rates.retime is None):
        return video
    return _Paced(video, rates.fps, rates.retime)


def open_configured(path: Path, settings: Settings) -> Video:
    """`open_video` by the reader, its options, the limits and the rates of ``settings``."""
    limits = VideoLimits(settings.limits.pixels, settings.limits.frames)
    return open_video(path, settings.pose.reader, limits, settings.options, settings.video)


class _Paced:
    """A video whose frames come at a rate that the user gave, unless that is for others."""

    def __init__(self, video: Video, fps: float | None, retime: float | None) -> None:
        self._video = video
        self._timed = not video.report.assumed
        self._retime = retime
        self._fps = retime or (None if self._timed else fps)

    @property
    def info(self) -> VideoInfo:
        return replace(self._video.info, fps=self._fps) if self._fps else self._video.info

    @property
    def report(self) -> VideoReport:
        found = self._video.report
        if not self._fps:
            return replace(found, assumed="its own times, not video.fps (video.retime replaces them)")
        instead = " instead of its own times" if self._timed else ""
        key = "video.retime" if self._retime else "video.fps"
        return replace(found, assumed=f"{self._fps:g} frames/s{instead} ({key})")

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        for time, convert in self.pictures():
            if (frame := convert()) is not None:
                yield time, frame

    def pictures(self) -> Iterator[Picture]:
        for number, (time, convert) in enumerate(pictures(self._video)):
            yield number / self._fps if self._fps else time, convert

    def __enter__(self) -> Self:
        self._video.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._video.__exit__(*error)


def reader_name(reader: str, options: Options | None = None) -> str:
    """The video reader that ``reader`` stands for on this machine; errors as in `open_video`."""
    return _choose(reader, options or {})[0]


def _choose(reader: str, options: Options) -> tuple[str, VideoReader]:
    """Name and object of the reader that ``reader`` stands for."""
    if reader == "auto":
        try:
            return "pyav", registry().make("video", "pyav", options.get("pyav"))
        except MissingDependencyError:
            reader = "opencv"
    return reader, registry().make("video", reader, options.get(reader))


def pictures(video: Video) -> Iterator[Picture]:
    """The frames of a video, converted only where somebody asks if it can do so (`LazyFrames`)."""
    if isinstance(video, LazyFrames):
        yield from video.pictures()
        return
    for time, frame in video:
        yield time, partial(_same, frame)


def _same(frame: np.ndarray) -> np.ndarray:
    return frame


def at_rate(pictures: Iterable[Picture], rate: float | None) -> Iterator[tuple[float, np.ndarray]]:
    """The frames that are looked at: one for each stretch of 1/``rate`` seconds, by their time stamps.

    That is the first one from its beginning, or half an interval between frames before, so that stamps that
    jitter or are rounded choose the frames that even ones would. A video that has no more than ``rate``
    frames a second has all of them. Where its own rate is a multiple of ``rate``, or far above it, they are
    evenly spaced.

    Parameters
    ----------
    pictures : iterable of (seconds, convert)
        From `pictures`.
    rate : float or None
        Frames a second; with None or 0, every frame.

    Raises
    ------
    MediaError
        ``E_MEDIA_BROKEN`` for a time that is no number, or earlier than the one before.
    """
    first, stretch, before = None, -1, -math.inf
    intervals: deque[float] = deque(maxlen=_RECENT)
    for time, convert in pictures:
        if not before <= time < math.inf:
            raise MediaError(
                f"its reader gives a frame the time {time} after {before}",
                remedy="another --set pose.reader=…, or --set video.retime=RATE",
                code="E_MEDIA_BROKEN",
            )
        if first is None:
            first = time
        else:
            intervals.append(time - before)
        before = time
        usual = median(intervals) if intervals else 0.0
        here = int((time - first + usual / 2) * rate) if rate else stretch + 1
        seldom = rate is not None and usual * rate >= 1
        if (here > stretch or seldom) and (frame := convert()) is not None:
            stretch = here
            yield time, frame
