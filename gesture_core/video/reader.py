"""The front door: opens a video with the reader that is asked for, or with the best one that is installed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from gesture_core.errors import MissingDependencyError
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import VideoInfo, VideoLimits, VideoReport
from gesture_core.video.frames import Picture, pictures

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.plugin.interfaces import Video, VideoReader

Options = Mapping[str, Mapping[str, Any]]


def open_video(
    path: str | os.PathLike[str],
    reader: str = "auto",
    limits: VideoLimits | None = None,
    options: Options | None = None,
    fps: float | None = None,
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
    fps : float, optional
        Frames a second, as in the setting ``video.fps``: the frames then come at this rate, whatever their
        times in the file are.

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
    name, chosen = _choose(reader, options or {})
    with calling(registry().find("video", name), passing=(OSError,)):
        video = chosen.open(Path(path), limits or VideoLimits())
    return video if fps is None else _Paced(video, fps)


class _Paced:
    """A video whose frames come at a rate that the user gave."""

    def __init__(self, video: Video, fps: float) -> None:
        self._video = video
        self._fps = fps

    @property
    def info(self) -> VideoInfo:
        return replace(self._video.info, fps=self._fps)

    @property
    def report(self) -> VideoReport:
        found = self._video.report
        instead = "" if found.assumed else " instead of its own times"
        return replace(found, assumed=f"{self._fps:g} frames/s{instead} (video.fps)")

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        for time, convert in self.pictures():
            if (frame := convert()) is not None:
                yield time, frame

    def pictures(self) -> Iterator[Picture]:
        for number, (_, convert) in enumerate(pictures(self._video)):
            yield number / self._fps, convert

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
