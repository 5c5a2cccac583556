"""What exactly a warping distance is: every choice that differs between libraries, named."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Literal

from gesture_core.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np

Mode = Literal["independent", "dependent"]
Cost = Literal["absolute", "squared", "euclidean"]
Reduce = Literal["sum", "mean"]
Shape = Literal["sakoe_chiba", "itakura"]

MOST = sys.float_info.max
SOFTNESS = (1e-300, 1e30)
"""Least and greatest softness: beyond, its inverse or a soft distance overflows."""


@dataclass(frozen=True)
class BandMask:
    """A band as a boolean array, hashable; rows are the query's frames.

    Fits learned bands (Ratanamahatana and Keogh 2004). Make one with `BandMask.of`.
    """

    rows: tuple[bytes, ...]

    @classmethod
    def of(cls, cells: Any) -> BandMask:
        """The mask of a boolean (n, m) array."""
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
        _one_of("mode", self.mode, ("independent", "dependent"))
        _one_of("cost", self.cost, ("absolute", "squared", "euclidean"))
        _one_of("reduce", self.reduce, ("sum", "mean"))
        _one_of("shape", self.shape, ("sakoe_chiba", "itakura"))
        for name in ("root", "length_norm"):
            self._set(name, _flag(name, getattr(self, name)))
        if self.window is not None:
            self._set("window", _window(self.window))
        self._set("max_slope", _real("max_slope", self.max_slope, "a number above 1"))
        if self.max_slope <= 1:
            raise _wrong("max_slope", self.max_slope, "a number above 1")
        if self.gamma is not None:
            expected = f"a positive number, {SOFTNESS[0]:g} to {SOFTNESS[1]:g}, or none for hard DTW"
            self._set("gamma", _real("gamma", self.gamma, expected, *SOFTNESS))
        if self.gamma is not None and self.root:
            raise ConfigError(
                "dtw.root with dtw.gamma: soft-DTW may be negative and has no root", code="E_OPTION"
            )
        if self.weights is not None:
            self._set("weights", _weights(self.weights))
        if self.mask is not None:
            if not isinstance(self.mask, BandMask):
                self._set("mask", BandMask.of(self.mask))
            if self.window is not None or self.shape != "sakoe_chiba":
                raise ConfigError("dtw.mask with another band: choose one of them", code="E_OPTION")

    def _set(self, name: str, value: object) -> None:
        """Put the plain form of a field in its place, while the specification is being made."""
        object.__setattr__(self, name, value)

    def _key(self) -> tuple[object, ...]:
        """The fields; the window with its type, for a radius of 1 is not a fraction of 1.0."""
        return (type(self.window), *(getattr(self, part.name) for part in fields(self)))

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, DtwSpec) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def replace(self, **changes: object) -> DtwSpec:
        """The same specification with other choices."""
        return replace(self, **changes)  # type: ignore[arg-type]


def as_spec(spec: DtwSpec | None) -> DtwSpec:
    """``spec``, or the default; anything else is refused."""
    if spec is None:
        return DtwSpec()
    if not isinstance(spec, DtwSpec):
        raise ConfigError(f"spec = {spec!r}", remedy="a DtwSpec", code="E_OPTION")
    return spec


def _one_of(name: str, value: object, choices: tuple[str, ...]) -> None:
    if not isinstance(value, str) or value not in choices:
        raise _wrong(name, value, " or ".join(choices))


def _flag(name: str, value: object) -> bool:
    """A bool, or NumPy's."""
    if isinstance(value, bool) or type(value).__name__ in ("bool", "bool_"):
        return bool(value)
    raise _wrong(name, value, "True or False")


def _window(value: object) -> int | float:
    """The window as Python's own int or float, NumPy's scalars included: its type says what it means."""
    expected = "a radius in frames (0, 1, 2 …), a fraction 0.0..1.0, or none"
    if isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= 0:
        return int(value)
    if isinstance(value, Real) and not isinstance(value, Integral) and 0 <= float(value) <= 1:
        return float(value)
    raise _wrong("window", value, expected)


def _real(name: str, value: object, expected: str, least: float = 0.0, most: float = MOST) -> float:
    """``value`` as a float between the two; text and truth values are no numbers."""
    if isinstance(value, Real) and not isinstance(value, bool) and least <= float(value) <= most:
        return float(value)
    raise _wrong(name, value, expected)


def _weights(values: object) -> tuple[float, ...]:
    expected = "a sequence of non-negative finite numbers"
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise _wrong("weights", values, expected)
    return tuple(_real("weights", weight, expected) for weight in values)


def _wrong(name: str, value: object, expected: str) -> ConfigError:
    return ConfigError(f"dtw.{name} = {value!r}", remedy=expected, code="E_OPTION")
