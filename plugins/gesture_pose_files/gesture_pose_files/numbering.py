"""Frame numbers in names: ``wave_000000000012_keypoints.json``, ``image_00001.jpg``, ``frame1``, ``0001``."""

from __future__ import annotations

import re

# At most 18 digits: time stamps in nanoseconds fit, and so does the number into 64 bits.
_NUMBERED = re.compile(r"(.*?)(\d{1,18})(?:[_\-. ]?(?:keypoints|pose|poses|skeleton))?", re.DOTALL)
_SUFFIX = re.compile(r"\.[A-Za-z][A-Za-z0-9]{0,5}")


def number_in(name: str) -> tuple[str, int] | None:
    """What comes before the frame number in the name of a file or picture, and the number itself.

    None where the name ends in no number. The order of frames is that of their numbers, whatever zeros
    they are padded with.

    Examples
    --------
    >>> number_in("wave_000000000012_keypoints.json"), number_in("clips/a-7.jpg"), number_in("wave.json")
    (('wave', 12), ('clips/a', 7), None)
    """
    stem, dot, suffix = name.rpartition(".")
    if dot and _SUFFIX.fullmatch(dot + suffix):
        name = stem
    match = _NUMBERED.fullmatch(name)
    return (match[1].rstrip("_-. /\\"), int(match[2])) if match else None
