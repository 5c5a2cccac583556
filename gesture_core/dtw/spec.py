"""What exactly a warping distance is: every choice that differs between libraries, named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from gesture_core.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np

Mode = Literal["independent", "dependent"]
Cost = Literal["absolute", "squared", "euclidean"]
Reduce = Literal["sum", "mean"]
Shape = Literal["sakoe_chiba", "itakura"]


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

        array = np.asarray(cells)
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
        if self.window is not None:
            fits = not isinstance(self.window, bool) and (
                self.window >= 0 if isinstance(self.window, int) else 0 <= self.window <= 1
            )
            if not fits:
                raise _wrong(
                    "window", self.window, "a radius in frames (0, 1, 2 …), a fraction 0.0..1.0, or none"
                )
        if not self.max_slope > 1:
            raise _wrong("max_slope", self.max_slope, "a number above 1")
        if self.gamma is not None and not 0 < self.gamma < float("inf"):
            raise _wrong("gamma", self.gamma, "a positive number, or none for hard DTW")
        if self.gamma is not None and self.root:
            raise ConfigError(
                "dtw.root with dtw.gamma: soft-DTW may be negative and has no root", code="E_OPTION"
            )
        if self.weights is not None:
            object.__setattr__(self, "weights", tuple(float(w) for w in self.weights))
            if not all(0 <= w < float("inf") for w in self.weights):
                raise _wrong("weights", self.weights, "non-negative finite numbers")
        if self.mask is not None:
            if not isinstance(self.mask, BandMask):
                object.__setattr__(self, "mask", BandMask.of(self.mask))
            if self.window is not None or self.shape != "sakoe_chiba":
                raise ConfigError("dtw.mask with another band: choose one of them", code="E_OPTION")

    def replace(self, **changes: object) -> DtwSpec:
        """The same specification with other choices."""
        return replace(self, **changes)  # type: ignore[arg-type]


def _one_of(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise _wrong(name, value, " or ".join(choices))


def _wrong(name: str, value: object, expected: str) -> ConfigError:
    return ConfigError(f"dtw.{name} = {value!r}", remedy=expected, code="E_OPTION")
