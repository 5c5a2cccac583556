"""What files call a score: shares, percent, COCO's visibility, peaks of networks. One rule for all."""

from __future__ import annotations

import numpy as np

from gesture_core.errors import KeypointError

# Peaks of heat maps overshoot 1 a little, and what is barely below 0 is rounding.
_NEARLY_ONE, _NEARLY_ZERO = 1.5, -0.01
# Peaks of networks that classify coordinates (SimCC) reach about 10; beyond it are percent.
_LARGEST_PEAK, _PERCENT = 20.0, 100.0
# x and y whose median is below this are shares or metres, and a third value above 1 beside them is a depth.
_PIXELS = 10.0


def in_unit(scores: np.ndarray, points: np.ndarray, source: str) -> tuple[np.ndarray, str]:
    """Scores in 0..1, and in words what was done to them; empty where they are that already.

    Scores up to 1.5 are cut at 1; 0, 1 and 2 alone are COCO's visibility; up to 20 they are divided by
    their greatest; up to 100 they are percent.

    Parameters
    ----------
    scores : array
        NaN where there is none.
    points : (…, 2) array
        The joints that have them, NaN where missing.
    source : str

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_VALUE` where this is no score: below 0, above 100, or beside coordinates that are not
        in pixels, which shows a depth.
    """
    known = scores[np.isfinite(scores)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    if low >= _NEARLY_ZERO and high <= _NEARLY_ONE:
        return np.clip(scores, 0, 1), ""
    seen = np.abs(points[np.isfinite(points)])
    pixels = bool(seen.size) and float(np.median(seen)) >= _PIXELS
    if low < _NEARLY_ZERO or high > _PERCENT or not pixels:
        raise KeypointError(
            f"the last value of each joint runs from {low:g} to {high:g}, which is no score",
            subject=source,
            remedy="x, y and a score in 0..1; --set keypoints.unit=metres where it is a depth",
            code="E_KEYPOINTS_VALUE",
        )
    if high == 2 and np.isin(known, (0, 1, 2)).all():
        return scores / 2, "scores are COCO's visibility: 1 counts as 0.5, 2 as 1"
    if high <= _LARGEST_PEAK:
        return np.clip(scores / high, 0, 1), f"scores were divided by the greatest, {high:.3g}"
    return np.clip(scores / _PERCENT, 0, 1), "scores were taken as percent"
