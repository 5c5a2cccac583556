"""Where the body's parts are, where they point, how they move: weighted channels for one warping.

Positions alone make two gestures alike whose hands take the same way at another pace, and make the
same gesture of two people differ by their proportions. The channels here are vectors of limbs and
joints (Celebi et al. 2013 weigh joints, Reyes et al. 2011 weigh features), their velocities
(derivative warping, Keogh and Pazzani 2001), the energy of the motion, which does not depend on the
phase of a wave of the hand, the sense in which a limb turns, the bend of the elbow, and the way from
one hand to the other.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gesture_core.errors import SignalError
from gesture_core.joints import FINGERS
from gesture_core.types import Signals
from gesture_signals.filters import smooth

_POINTS = (
    "nose", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "mouth", "brow_middle",
    *(f"{finger}_tip" for finger in FINGERS),
)  # fmt: skip
_PLACES = [(finger, ("cmc", "mcp") if finger == "thumb" else ("mcp", "pip")) for finger in FINGERS]
_LIMBS = {
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
    "arm": ("shoulder", "wrist"),
    "thigh": ("hip", "knee"),
    "shin": ("knee", "ankle"),
    "leg": ("hip", "ankle"),
    "hand_from_face": ("nose", "wrist"),
    "palm": ("hand_wrist", "middle_mcp"),
    **{f"{finger}_base": (f"{finger}_{places[0]}", f"{finger}_{places[1]}") for finger, places in _PLACES},
    **{f"{finger}_end": (f"{finger}_{places[1]}", f"{finger}_tip") for finger, places in _PLACES},
}
_BENDS = {"arm": ("upper_arm", "forearm"), "leg": ("thigh", "shin")}
_BENDS |= {finger: (f"{finger}_base", f"{finger}_end") for finger in FINGERS}
# From the left joint to the right one: a vector without a side, which a mirror turns upside down.
_PAIRS = {"hands": ("left_wrist", "right_wrist"), "lips": ("upper_lip", "lower_lip")}
_MIDDLE = ("nose", *_PAIRS)
# All five in one warping: their tips, or how they bend.
_SEVERAL = "fingers"
_TERM = re.compile(r"(?P<part>[a-z_]+)(\.(?P<kind>[a-z]+))?(@(?P<share>[0-9.]+))?")
# Velocities in body lengths per tenth of a second have the size of positions in body lengths.
_TENTH = 10.0
_NO_LENGTH = 1e-6
# Seconds from frame to frame where the times do not tell.
_STEP = 0.05


@dataclass(frozen=True)
class Parts:
    """Replace the joints' coordinates by weighted channels of body parts.

    Parameters
    ----------
    weights : mapping
        ``"part.kind@share"`` to the factor of its squared difference. Parts: a joint (``wrist``,
        seen from the neck) or a limb (``forearm``, from its upper joint), both sides of it, or
        ``hands`` (from the left wrist to the right one); with the normalizer `hands` also ``fingers`` (the
        tips of all five), ``palm``, ``hand_from_face``, ``lips`` and others. Kinds: none for the vector
        itself, ``direction`` (unit vector), ``velocity`` (per tenth of a second), ``energy`` (its root mean
        square around each frame), ``spread`` (root mean square of the distance from its recent
        middle), ``turning`` (signed area that the vector sweeps around that middle), ``bend`` (of
        ``arm``, ``leg`` or ``fingers``: sine and cosine of the angle at the elbow, knee or knuckle).
        Share: how much of the mean is subtracted.
    window : float
        Seconds, standard deviation of the Gaussian that ``energy``, ``spread`` and ``turning``
        average over.
    """

    weights: Mapping[str, float] = field(default_factory=lambda: {"wrist": 1.0, "elbow": 1.0})
    window: float = 0.2

    def __post_init__(self) -> None:
        if not isinstance(self.weights, Mapping):
            raise TypeError(f"weights {self.weights!r} are no table of parts and numbers")
        for text, weight in self.weights.items():
            _term(text)
            if not 0 <= weight < float("inf"):
                raise ValueError(f"weight {weight} of {text!r} is not a number of zero or more")
        if not any(self.weights.values()):
            raise ValueError("no weight is above zero")
        if not self.window > 0:
            raise ValueError(f"window {self.window} is not above zero")

    def apply(self, signals: Signals) -> Signals:
        """The channels of every part, each scaled by the root of its weight."""
        columns, names, masks, present = [], [], [], []
        step = time_step(signals)
        for text, weight in self.weights.items():
            if weight == 0:
                continue
            part, kind, share = _term(text)
            members = FINGERS if part == _SEVERAL else ("",)
            sides = ("",) if part in _MIDDLE else ("right_", "left_")
            for side, member in itertools.product(sides, members):
                if kind == "bend":
                    values, mask, there = _bend(signals, member or part, side)
                else:
                    values, mask, there = _vector(signals, f"{member}_tip" if member else part, side)
                    if kind:
                        values = KINDS[kind](values, step, self.window)
                suffixes = [f"_{axis}" for axis in "xyz"[: values.shape[1]]] if values.shape[1] > 1 else [""]
                if share:
                    values = values - share * values.mean(axis=0, dtype=np.float64)
                columns.append(values * np.sqrt(weight))
                tail = (f".{kind}" if kind else "") + (f"@{share:g}" if share else "")
                own = f"{side}{part}/{member}" if member else f"{side}{part}"
                names += [f"{own}{suffix}{tail}" for suffix in suffixes]
                masks += [mask] * len(suffixes)
                present += [there] * len(suffixes)
        return replace(
            signals,
            values=np.concatenate(columns, axis=1),
            channels=tuple(names),
            mask=np.array(masks),
            present=np.array(present),
        )

    def on_stream(self) -> Parts:
        """No mean is subtracted from any part."""
        weights: dict[str, float] = {}
        for text, weight in self.weights.items():
            name = text.partition("@")[0]
            weights[name] = weights.get(name, 0.0) + weight
        return replace(self, weights=weights)


def time_step(signals: Signals) -> float:
    """Seconds from frame to frame, as they mostly are."""
    steps = np.diff(signals.times)
    step = float(np.median(steps)) if len(steps) else 0.0
    return step if step > 0 else _STEP


def _term(text: str) -> tuple[str, str, float]:
    match = _TERM.fullmatch(text)
    part, kind = (match["part"], match["kind"] or "") if match else ("", "")
    parts = (*_POINTS, *_LIMBS, *_PAIRS, _SEVERAL)
    if match is None or part not in parts or kind not in ("", *KINDS, "bend"):
        known = ", ".join(parts)
        kinds = ", ".join((*KINDS, "bend"))
        raise ValueError(f"{text!r} is not part.kind@share with a part of {known} and a kind of {kinds}")
    if kind == "bend" and part not in (*_BENDS, _SEVERAL):
        raise ValueError(f"{text!r}: only {', '.join((*_BENDS, _SEVERAL))} bend")
    share = float(match["share"] or 0)
    if not 0 <= share <= 1:
        raise ValueError(f"{text!r}: the share is not in 0..1")
    return part, kind, share


def _vector(signals: Signals, part: str, side: str) -> tuple[np.ndarray, bool, bool]:
    """(T, 2 or 3) float64 vector of a part, whether it is salient, whether it is present."""
    names: tuple[str, ...] = _LIMBS.get(part) or _PAIRS.get(part) or (part,)
    tracks, mask, present = [], False, True
    axes = "xyz" if "neck_z" in signals.channels else "xy"
    assert signals.mask is not None and signals.present is not None
    for name in names:
        joint = name if name == "nose" else f"{side}{name}"
        try:
            places = [signals.channels.index(f"{joint}_{axis}") for axis in axes]
        except ValueError:
            raise SignalError(
                f"filter 'parts' needs the channels {joint}_x and {joint}_y",
                subject=signals.source,
                remedy="signals.filters with 'parts' before any filter that drops channels",
                code="E_SIGNAL_CHANNELS",
            ) from None
        tracks.append(signals.values[:, places].astype(np.float64))
        mask |= bool(signals.mask[places].any())
        present &= bool(signals.present[places].all())
    return (tracks[-1] - tracks[0] if len(tracks) == 2 else tracks[0]), mask, present


def _bend(signals: Signals, part: str, side: str) -> tuple[np.ndarray, bool, bool]:
    """(T, 2) sine and cosine of the angle between the two limbs of a part, zero where one has no length.

    A mirror turns the sense of the angle round, as it does with x, and leaves the cosine, as y.
    """
    (upper, mask, there), (lower, other, also) = (_vector(signals, limb, side) for limb in _BENDS[part])
    both = np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1)
    if upper.shape[1] == 3:
        raise SignalError(
            f"{part}.bend has a side in the plane alone", subject=signals.source,
            remedy="--set keypoints.depth=false, or weights without bend", code="E_SIGNAL_CHANNELS",
        )  # fmt: skip
    sine = upper[:, 0] * lower[:, 1] - upper[:, 1] * lower[:, 0]
    values = np.stack([sine, (upper * lower).sum(axis=1)], axis=1)
    angle = np.divide(values, both[:, None], out=np.zeros_like(values), where=both[:, None] > _NO_LENGTH)
    return angle, mask or other, there and also


def _direction(vector: np.ndarray, step: float, window: float) -> np.ndarray:
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    # A limb that points at the camera has no direction in the picture.
    direction: np.ndarray = np.zeros_like(vector)
    np.divide(vector, length, out=direction, where=length > _NO_LENGTH)
    return direction


def _velocity(vector: np.ndarray, step: float, window: float) -> np.ndarray:
    if len(vector) < 2:
        return np.zeros_like(vector)
    velocity: np.ndarray = np.gradient(vector, axis=0) / (step * _TENTH)
    return velocity


def _energy(vector: np.ndarray, step: float, window: float) -> np.ndarray:
    energy: np.ndarray = np.sqrt(np.maximum(smooth(_velocity(vector, step, window) ** 2, window / step), 0))
    return energy


def _spread(vector: np.ndarray, step: float, window: float) -> np.ndarray:
    from_middle = vector - smooth(vector, 2 * window / step)
    spread: np.ndarray = np.sqrt(np.maximum(smooth(from_middle**2, window / step), 0))
    return spread


def _turning(vector: np.ndarray, step: float, window: float) -> np.ndarray:
    speed = _velocity(vector, step, window)
    from_middle = vector - smooth(vector, 2 * window / step)
    if vector.shape[1] == 3:  # around each axis
        return 3.0 * smooth(np.cross(from_middle, speed), 0.75 * window / step)
    area = from_middle[:, 0] * speed[:, 1] - from_middle[:, 1] * speed[:, 0]
    return 3.0 * smooth(area[:, None], 0.75 * window / step)


KINDS: Mapping[str, Callable[[np.ndarray, float, float], np.ndarray]] = {
    "direction": _direction,
    "velocity": _velocity,
    "energy": _energy,
    "spread": _spread,
    "turning": _turning,
}
