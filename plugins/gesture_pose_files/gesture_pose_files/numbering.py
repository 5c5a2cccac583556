"""Frame numbers in names, as ``wave_000000000012_keypoints.json`` and ``frame1.jpg``; clips by them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_pose_files.files import MAX_FRAMES
from gesture_pose_files.reader import clip_called

# At most 18 digits: time stamps in nanoseconds fit, and so does the number into 64 bits.
_NUMBERED = re.compile(
    r"(.*?)(\d{1,18})\)?(?:[_\-. ]?(?:keypoints|pose|poses|skeleton))?", re.DOTALL | re.IGNORECASE
)
_NUMBER_FIRST = re.compile(
    r"(?P<number>\d{1,18})[_\-. ](?P<clip>.*?)(?:[_\-. ]keypoints)?", re.DOTALL | re.IGNORECASE
)
_BEFORE = re.compile(r"(.*?)(\d{1,18})\D*", re.DOTALL)
_SECONDS = re.compile(r"(?:.*?[_\-. ])?\d+\.\d+", re.DOTALL)
_SUFFIX = re.compile(r"\.[A-Za-z][A-Za-z0-9]{0,5}")
_PREDICTIONS = re.compile(r"(?:\.(?:jpe?g|png|bmp))?\.predictions", re.IGNORECASE)


def number_in(name: str) -> tuple[str, int] | None:
    """What comes before the frame number in the name of a file or picture, and the number itself.

    None where the name neither ends nor begins with a number. The order of frames is that of their numbers,
    whatever zeros they are padded with.

    Examples
    --------
    >>> number_in("wave_000000000012_keypoints.json"), number_in("clips/a-7.jpg"), number_in("wave.json")
    (('wave', 12), ('clips/a', 7), None)
    """
    stem, dot, suffix = name.rpartition(".")
    if dot and _SUFFIX.fullmatch(dot + suffix):
        name = stem
    if found := _PREDICTIONS.search(name):  # OpenPifPaf's, of a picture
        name = name[: found.start()]
    if match := _NUMBERED.fullmatch(name):
        return match[1].rstrip("(_-. /\\"), int(match[2])
    match = _NUMBER_FIRST.fullmatch(name)
    return (match["clip"], int(match["number"])) if match else None


def some_files(folder: Path, suffix: str, count: int) -> list[Path]:
    """The first ``count`` numbered files in a folder, in no order; none where it cannot be listed."""
    try:
        return [path for _, _, path in islice(_files(folder, suffix), count)]
    except OSError:
        return []


def clips_in(folder: Path, suffix: str) -> dict[str, list[tuple[int, Path]]]:
    """Name of each clip -> its numbered files, both in order.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_LIMIT`, `E_KEYPOINTS_UNREADABLE`.
    """
    found: dict[str, list[tuple[int, Path]]] = {}
    decimals = True
    try:
        for count, (name, number, path) in enumerate(_files(folder, suffix)):
            decimals = decimals and bool(_SECONDS.fullmatch(path.name[: -len(suffix)]))
            if count >= MAX_FRAMES:
                raise KeypointError(
                    f"holds more than {MAX_FRAMES} frames",
                    subject=printable(folder),
                    remedy="split it",
                    code="E_KEYPOINTS_LIMIT",
                )
            found.setdefault(name, []).append((number, path))
    except OSError as error:
        raise KeypointError(
            f"cannot be listed: {error.strerror}", subject=printable(folder), code="E_KEYPOINTS_UNREADABLE"
        ) from error
    if decimals and not all(map(_counts, found.values())):
        raise KeypointError(
            f"has files whose names are decimal numbers, as {path.name[:40]}, and no numbers of frames",
            subject=printable(folder),
            remedy="names with whole numbers, as 0012.json, and --set keypoints.fps=…",
            code="E_KEYPOINTS_FORMAT",
        )
    if len(found) > 1 and len({number for clip in found.values() for number, _ in clip}) == 1:
        found = _by_number_before(found)
    return {name: sorted(found[name]) for name in sorted(found)}


def _counts(frames: Sequence[tuple[int, Path]]) -> bool:
    """Whether numbers behind a point, of three digits at least, count frames: ``shot_010.0001.json``."""
    numbers = {number for number, _ in frames}
    digits = min(len(path.stem.rpartition(".")[2]) for _, path in frames)
    return digits > 2 and len(numbers) > 1 and max(numbers) - min(numbers) == len(numbers) - 1


def _by_number_before(found: dict[str, list[tuple[int, Path]]]) -> dict[str, list[tuple[int, Path]]]:
    """Clips of one frame each, all of the same number, by the one before: ``cam2_0007_1``, ``f7_of_90``."""
    out: dict[str, list[tuple[int, Path]]] = {}
    for name, frames in found.items():
        numbered = _BEFORE.fullmatch(name)
        if numbered is None:
            return found
        clip = numbered[1].rstrip("(_-. /\\")
        out.setdefault(clip, []).extend((int(numbered[2]), path) for _, path in frames)
    return out


def clip_in(folder: Path, member: str, suffix: str, expected: str) -> list[tuple[int, Path]]:
    """The numbered files of the clip ``member``, or of the only one; ``expected`` says what they are called.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_MEMBER`, and those of `clips_in`.
    """
    found = clips_in(folder, suffix)
    if not found:
        raise KeypointError(
            f"holds no numbered {suffix} file",
            subject=printable(folder),
            remedy=expected,
            code="E_KEYPOINTS_EMPTY",
        )
    return clip_called(member, found, folder)


def _files(folder: Path, suffix: str) -> Iterator[tuple[str, int, Path]]:
    with os.scandir(folder) as entries:
        for entry in entries:
            numbered = number_in(entry.name) if entry.name.lower().endswith(suffix) else None
            if numbered and not entry.is_dir(follow_symlinks=False):
                yield *numbered, Path(entry.path)
