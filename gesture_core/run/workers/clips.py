"""Parts of a video, re-encoded as clips: the recording is decoded once, whatever their number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from gesture_core.errors import GestureError, InputError, MediaError
from gesture_core.files import content_sha256
from gesture_core.records import decoded

if TYPE_CHECKING:
    from av import AudioFrame

    from gesture_core.run.workers.worker import Worker
    from gesture_core.video.writer import VideoWriter

SAME = 0.0005
"""Seconds below which two times are one: less than half a frame at the fastest rate that is read."""
QUALITY = 18
"""x264's rate factor of clips, which are looked at by a network again: hardly any loss."""
_SIGN = 100
"""Frames between two signs of progress."""


@dataclass
class _Clip:
    """A clip to be written, and what came of it."""

    number: int
    path: Path
    start: float
    end: float
    box: Sequence[float]
    frames: int = 0
    note: str = ""
    error: GestureError | None = None
    _writer: VideoWriter | None = field(default=None, init=False)
    _open: ExitStack = field(default_factory=ExitStack, init=False)

    def add(self, time: float, frame: Any, sound: Sound | None) -> None:
        """Append a frame; after an error, nothing more."""
        from gesture_core.video.writer import VideoWriter, room_around

        if self.error:
            return
        try:
            if self._writer is None:
                heard = sound.between(time, self.end, self) if sound else None
                rate = sound.rate if sound else 48_000
                self._writer = self._open.enter_context(
                    VideoWriter(self.path, quality=QUALITY, sound=heard, rate=rate)
                )
                self._first = time
            self._writer.add(time - self._first, frame[room_around([self.box])] if self.box else frame)
        except (GestureError, OSError) as error:
            self._failed(error)

    def close(self) -> None:
        """No frame follows: the file takes its place."""
        try:
            self._open.close()
        except (GestureError, OSError) as error:
            self._failed(error)
        if self._writer is None and self.error is None:
            cause = f"has no frame from {self.start:.3f} to {self.end:.3f} s"
            self.error = MediaError(cause, code="E_MEDIA_NO_FRAMES")
        self.frames = self._writer.count if self._writer else 0

    def abandon(self, error: GestureError) -> None:
        """Its recording cannot be read further: nothing is left of it."""
        self.error = self.error or error
        with suppress(GestureError, OSError, ValueError):
            self._open.__exit__(type(error), error, None)

    def _failed(self, error: GestureError | OSError) -> None:
        if isinstance(error, OSError):
            cause = f"{self.path} cannot be written: {error.strerror or error}"
            error = InputError(cause, remedy="free space there, or another --out", code="E_OUT")
        self.abandon(error)


def cut(
    worker: Worker, path: str, sha256: str, clips: Sequence[Mapping[str, Any]], sound: bool
) -> list[dict[str, Any]]:
    """Write parts of a video as clips.

    Parameters
    ----------
    worker : Worker
    path : str
        Encoded, as those of the clips.
    sha256 : str
        Of the content that the clips' times are about.
    clips : sequence of mapping
        ``path``, ``start``, ``end`` in seconds, ``box`` in pixels or empty for the whole picture.
    sound : bool

    Returns
    -------
    list of dict
        Of each clip ``frames``, ``note``, ``code`` and ``message``, in the order of ``clips``.

    Raises
    ------
    GestureError
        Where the video cannot be opened, or is not what it was.
    """
    from gesture_core.video import open_configured, pictures

    video_path = decoded(path)
    if content_sha256(video_path, worker.alive) != sha256:
        raise InputError("has changed since the run", remedy="the run again", code="E_CHANGED")
    made = [
        _Clip(number, decoded(one["path"]), one["start"], one["end"], one["box"])
        for number, one in enumerate(clips)
    ]
    waiting = sorted(made, key=lambda one: -one.start)
    running: list[_Clip] = []
    heard = Sound(video_path) if sound else None
    try:
        with open_configured(video_path, worker.settings) as video:
            unsaid = 0
            for time, convert in pictures(video):
                unsaid += 1
                if unsaid == _SIGN:
                    worker.report({"frames": unsaid})
                    unsaid = 0
                while waiting and waiting[-1].start - SAME <= time:
                    running.append(waiting.pop())
                for one in [one for one in running if time > one.end + SAME]:
                    running.remove(one)
                    one.close()
                if not waiting and not running:
                    break
                frame = convert() if running else None
                for one in running if frame is not None else ():
                    one.add(time, frame, heard)
    except GestureError as error:
        for one in [*running, *waiting]:
            one.abandon(error)
        running = waiting = []
    for one in [*running, *waiting]:
        one.close()
    return [
        {
            "frames": one.frames,
            "note": one.note,
            "code": one.error.code if one.error else "",
            "message": one.error.message if one.error else "",
        }
        for one in made
    ]


class Sound:
    """The sound of a video, found anew for each clip.

    Attributes
    ----------
    rate : int
        Samples a second.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.rate = 48_000

    def between(self, start: float, end: float, clip: _Clip) -> Iterator[AudioFrame]:
        """Samples from ``start`` to ``end`` seconds, as the video counts them; what fails is a note."""
        import av

        try:
            yield from self._between(start, end, clip)
        except (av.FFmpegError, ValueError, OSError) as error:
            clip.note = f"its sound is not whole: {error}"

    def _between(self, start: float, end: float, clip: _Clip) -> Iterator[AudioFrame]:
        import av
        import numpy as np

        from gesture_core.video.containers import open_container

        file, container = open_container(self._path)
        with file, av.open(file, "r", format=container, metadata_errors="replace", io_open=_refuse) as opened:
            if not opened.streams.audio:
                clip.note = "the recording has no sound"
                return
            stream, pictures = opened.streams.audio[0], opened.streams.video[0]
            base = pictures.time_base
            origin = float(pictures.start_time * base) if pictures.start_time and base else 0.0
            opened.seek(max(0, int((origin + start - 1) * 1e6)))
            resampler = av.AudioResampler(format="fltp", layout="stereo", rate=self.rate)
            for decoded in opened.decode(stream):
                at = None if decoded.time is None else decoded.time - origin
                if at is None or at + decoded.samples / decoded.sample_rate <= start:
                    continue
                if at >= end:
                    break
                for samples in resampler.resample(decoded):
                    first = max(0, round((start - at) * self.rate))
                    last = min(samples.samples, round((end - at) * self.rate))
                    if first >= last:
                        continue
                    part = av.AudioFrame.from_ndarray(
                        np.ascontiguousarray(samples.to_ndarray()[:, first:last], np.float32),
                        "fltp",
                        "stereo",
                    )
                    part.sample_rate = self.rate
                    part.pts = round((at - start) * self.rate) + first
                    at += samples.samples / self.rate
                    yield part


def _refuse(url: str, flags: int, options: object) -> NoReturn:
    """Called where FFmpeg would open a further file."""
    raise ValueError(f"a media file may not open {url!r}")
