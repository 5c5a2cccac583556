"""Dynamic time warping: distances, search, paths, soft-DTW and barycenters.

The public functions are listed in ``__all__`` and imported when they are first used; importing this
package imports no NumPy. How they are computed is the business of distance kernels, which are plugins.

Plugins of distance kernels may import, besides ``gesture_core.plugin.hooks`` and
``gesture_core.plugin.interfaces``:

- `gesture_core.dtw.spec`: `DtwSpec`, `BandMask`
- `gesture_core.dtw.bands`: `is_banded`, `has_holes`, `row_spans`, `allowed_cells`
- `gesture_core.dtw.batches`: `used_dimensions`, `weighted`, `lane_cost`, `warping_dtype`, `FAR`, `UNREACHED`
- `gesture_core.dtw.lanes`: `LaneKernel`, `GradientLaneKernel`, `Lanes`, `Prepared`, `UNBOUNDED`
- `gesture_core.dtw.subsequence`: `SubsequenceState`, `UNREACHABLE`, `BORDER`
- `gesture_core.types`: `SignalBatch`; `gesture_core.files`: `usable_cores`; ``gesture_core.errors``
- in their tests `gesture_core.testing`

These names are the ``__all__`` of their modules; nothing else of the core is promised to them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gesture_core.dtw.distances import derivatives, warping_distance, warping_distances
    from gesture_core.dtw.paths import warping_path
    from gesture_core.dtw.search import ExampleIndex, nearest
    from gesture_core.dtw.soft import (
        SoftGradient,
        barycenter,
        soft_divergence,
        soft_warping,
        soft_warping_gradient,
    )
    from gesture_core.dtw.spec import BandMask, DtwSpec

__all__ = [
    "BandMask",
    "DtwSpec",
    "ExampleIndex",
    "SoftGradient",
    "barycenter",
    "derivatives",
    "nearest",
    "soft_divergence",
    "soft_warping",
    "soft_warping_gradient",
    "warping_distance",
    "warping_distances",
    "warping_path",
]

_MODULES = {
    "BandMask": "spec",
    "DtwSpec": "spec",
    "ExampleIndex": "search",
    "SoftGradient": "soft",
    "barycenter": "soft",
    "derivatives": "distances",
    "nearest": "search",
    "soft_divergence": "soft",
    "soft_warping": "soft",
    "soft_warping_gradient": "soft",
    "warping_distance": "distances",
    "warping_distances": "distances",
    "warping_path": "paths",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'gesture_core.dtw' has no attribute {name!r}")
    value: object = getattr(import_module(f"gesture_core.dtw.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
