"""Plots share one look; matplotlib draws to files only and is loaded when it is needed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.archive.atomic import replacing
from gesture_core.errors import MissingDependencyError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, GREY = "#2368a8", "#d1600f", "#3b8a3f", "#7f7f7f"
"""Distinguishable in print and with the common colour-vision deficiencies."""


def new_figure(width: float, height: float, **layout: Any) -> Figure:
    """An empty figure of ``width`` x ``height`` inches that needs no display.

    Raises
    ------
    MissingDependencyError
        Where matplotlib is not installed; it names the command.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingDependencyError(
            "plots need matplotlib", remedy="pip install 'gesture-core[evaluate]'"
        ) from None
    figure = Figure(figsize=(width, height), layout="constrained", **layout)
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write ``figure`` as PNG and return ``path``; the same numbers give the same bytes.

    The file appears once it is complete; its folder is made where there is none.
    """
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120, metadata={"Software": None})
    return path
