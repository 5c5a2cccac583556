"""What exactly a warping distance is: every choice that differs between libraries has a name here."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import partial
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Literal

from gesture_core.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np

__all__ = ["BandMask", "DtwSpec"]

Mode = Literal["independent", "dependent"]
Cost = Literal["absolute", "squared", "euclidean"]
Reduce = Literal["sum", "mean"]
Shape = Literal["sakoe_chiba", "itakura"]

_CHOICES = {
    "mode": ("independent", "dependent"),
    "cost": ("absolute", "squared", "euclidean"),
    "reduce": ("sum", "mean"),
    "shape": ("sakoe_chiba", "itakura"),
}
_SOFTNESS = (1e-300, 1e30)
"""Least and greatest softness: beyond, its inverse or a soft distance overflows."""


@dataclass(frozen=True)
class BandMask:
    """A band as a boolean array, hashable; rows are the query's frames.

    Holds learned bands (Ratanamahatana and Keogh 2004). Make one with `BandMask.of`.

    Attributes
    ----------
    rows : tuple of n bytes objects
        Each holds the m cells of a row, a byte each.

    Examples
    --------
    >>> from gesture_core.dtw import BandMask
    >>> BandMask.of([[True, False], [True, True]]).array().sum().item()
    3
    """

    rows: tuple[bytes, ...]

    @classmethod
    def of(cls, cells: Any) -> BandMask:
        """The mask of a boolean (n, m) array; a ConfigError for anything else."""
        import numpy as np

        try:
            array = np.asarray(cells)
        except ValueError:
            raise _wrong("mask", cells, "a boolean (n, m) array") from None
        if array.ndim != 2 or array.dtype != bool or 0 in array.shape:
            raise _wrong("mask", f"{array.dtype} array of shape {array.shape}", "a boolean (n, m) array")
        return cls(tuple(row.tobytes() for row in array))

    def array(self) -> np.ndarray:
        """(n, m) bool."""
        import numpy as np

        return np.frombuffer(b"".join(self.rows), bool).reshape(len(self.rows), -1)


@dataclass(frozen=True)
class DtwSpec:
    """A warping distance.

    A pair is compared on the dimensions ``(mask_q | mask_e) & present_q & present_e``.

    Attributes
    ----------
    mode : "independent" or "dependent"
        One warping for each dimension, then ``reduce`` over them; or one warping for all
        dimensions together (Shokoohi-Yekta et al. 2017).
    cost : "absolute", "squared" or "euclidean"
        Local cost of two frames. Dependent: the sum over dimensions of absolute or squared
        differences, or the Euclidean length of the difference vector. Independent: Euclidean
        equals absolute.
    root : bool
        Take the square root of each warping's accumulated cost (tslearn, dtaidistance).
    reduce : "sum" or "mean"
        Over the dimensions of a pair. In dependent mode "mean" divides the local cost's sum
        by their number (before a Euclidean local cost takes its root).
    length_norm : bool
        Divide each accumulated cost by (length of query + length of example), before the root.
    window : None, int or float
        Band: a radius in frames (int), a fraction of the longer length (float in 0..1), or none.
    shape : "sakoe_chiba" or "itakura"
        Form of the band (Sakoe and Chiba 1978; Itakura 1975).
    max_slope : float
        Slope of the Itakura parallelogram, above 1.
    gamma : None or float
        Softness (Cuturi and Blondel 2017); None is hard DTW.
    weights : None or tuple of D floats
        Non-negative factor of each dimension's local cost (Reyes et al. 2011); inside the root of
        a Euclidean one in dependent mode.
    mask : None, BandMask or boolean (n, m) array
        Cells that a path may visit; stretched to pairs of other lengths.

    Raises
    ------
    ConfigError
        For a value that a field cannot have, and for ``root`` with ``gamma`` or ``mask`` with
        another band.

    Examples
    --------
    The distance of dtaidistance and tslearn, with a window of a tenth of the longer series:

    >>> from gesture_core.dtw import DtwSpec
    >>> spec = DtwSpec(mode="dependent", cost="squared", reduce="sum", root=True, window=0.1)
    >>> spec.replace(root=False) == DtwSpec(mode="dependent", cost="squared", reduce="sum", window=0.1)
    True
    """

    mode: Mode = "independent"
    cost: Cost = "absolute"
    root: bool = False
    reduce: Reduce = "mean"
    length_norm: bool = False
    window: int | float | None = None
    shape: Shape = "sakoe_chiba"
    max_slope: float = 2.0
    gamma: float | None = None
    weights: tuple[float, ...] | None = None
    mask: BandMask | None = None

    def __post_init__(self) -> None:
        put = partial(object.__setattr__, self)
        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            if not isinstance(value, str) or value not in choices:
                raise _wrong(name, value, " or ".join(choices))
        for name in ("root", "length_norm"):
            value = getattr(self, name)
            if type(value).__name__ not in ("bool", "bool_"):  # the second is that of NumPy
                raise _wrong(name, value, "True or False")
            put(name, bool(value))
        if self.window is not None:
            put("window", _window(self.window))
        put("max_slope", _real("max_slope", self.max_slope, "a number above 1"))
        if self.max_slope <= 1:
            raise _wrong("max_slope", self.max_slope, "a number above 1")
        if self.gamma is not None:
            expected = f"a positive number, {_SOFTNESS[0]:g} to {_SOFTNESS[1]:g}, or none for hard DTW"
            put("gamma", _real("gamma", self.gamma, expected, *_SOFTNESS))
            if self.root:
                raise ConfigError(
                    "dtw.root with dtw.gamma: soft-DTW may be negative and has no root", code="E_OPTION"
                )
        if self.weights is not None:
            expected = "a sequence of non-negative finite numbers"
            if isinstance(self.weights, str) or not isinstance(self.weights, Iterable):
                raise _wrong("weights", self.weights, expected)
            put("weights", tuple(_real("weights", weight, expected) for weight in self.weights))
        if self.mask is not None:
            if not isinstance(self.mask, BandMask):
                put("mask", BandMask.of(self.mask))
            if self.window is not None or self.shape != "sakoe_chiba":
                raise ConfigError("dtw.mask with another band: choose one of them", code="E_OPTION")

    def _key(self) -> tuple[object, ...]:
        """The fields; the window with its type, for a radius of 1 is not a fraction of 1.0."""
        return (type(self.window), *(getattr(self, part.name) for part in fields(self)))

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, DtwSpec) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def replace(self, **changes: Any) -> DtwSpec:
        """The same specification with other choices."""
        return replace(self, **changes)


def as_spec(spec: DtwSpec | None) -> DtwSpec:
    """``spec``, or the default; anything else is refused."""
    if spec is None:
        return DtwSpec()
    if not isinstance(spec, DtwSpec):
        raise ConfigError(f"spec = {spec!r}", remedy="a DtwSpec", code="E_OPTION")
    return spec


def _window(value: object) -> int | float:
    """The window as Python's own int or float, NumPy's scalars included: its type says what it means."""
    if isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= 0:
        return int(value)
    if isinstance(value, Real) and not isinstance(value, Integral) and 0 <= float(value) <= 1:
        return float(value)
    raise _wrong("window", value, "a radius in frames (0, 1, 2 …), a fraction 0.0..1.0, or none")


def _real(
    name: str, value: object, expected: str, least: float = 0.0, most: float = sys.float_info.max
) -> float:
    """``value`` as a float between the two; text and truth values are no numbers."""
    if isinstance(value, Real) and not isinstance(value, bool) and least <= float(value) <= most:
        return float(value)
    raise _wrong(name, value, expected)


def _wrong(name: str, value: object, expected: str) -> ConfigError:
    return ConfigError(f"dtw.{name} = {value!r}", remedy=expected, code="E_OPTION")
