"""Samples of a WAV file, in which some loggers keep the axes of a sensor as channels of sound."""

from __future__ import annotations

import wave
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_pose_files.files import MAX_FRAMES, open_keypoints
from gesture_pose_files.npy import MAX_FILE_BYTES

_FAST = 1000.0
"""Samples a second from which on a file is one of sound, or should be resampled."""


def samples_in(path: Path) -> tuple[np.ndarray, float, list[str]]:
    """(T, D) samples in -1..1, how many a second, and notes.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_BROKEN`, `E_KEYPOINTS_LIMIT`.
    """
    source = printable(path)
    with open_keypoints(path, MAX_FILE_BYTES) as raw:
        try:
            with wave.open(raw, "rb") as file:
                count, width, channels, rate = (
                    file.getnframes(), file.getsampwidth(), file.getnchannels(), file.getframerate(),
                )  # fmt: skip
                if count > MAX_FRAMES:
                    cause = f"holds {count} samples, more than are read"
                    remedy = "parts of it, or a lower rate"
                    raise KeypointError(cause, subject=source, remedy=remedy, code="E_KEYPOINTS_LIMIT")
                data = np.frombuffer(file.readframes(count), np.uint8)
        except (wave.Error, EOFError) as error:
            raise KeypointError(
                f"is no WAV file of plain samples (PCM): {error}",
                subject=source, remedy="saving it so, or as CSV", code="E_KEYPOINTS_BROKEN",
            ) from error  # fmt: skip
    if not rate or not channels or not len(data) or len(data) != count * channels * width:
        raise KeypointError(
            "is cut off, or empty", subject=source, remedy="copying it again", code="E_KEYPOINTS_BROKEN"
        )
    raw_samples = data.reshape(-1, width).astype(np.int64)
    if width == 1:  # the only width without a sign
        raw_samples -= 128
    values = (raw_samples << (8 * np.arange(width))).sum(axis=1)
    half = 1 << (8 * width - 1)
    values = np.where(values >= half, values - 2 * half, values) / half
    notes = [f"{rate} samples a second: --set resample.rate=100 compares fewer"] if rate > _FAST else []
    return values.reshape(-1, channels), float(rate), notes
