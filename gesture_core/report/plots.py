"""Plots share one look; matplotlib draws to files only and is loaded when it is needed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import MissingDependencyError
from gesture_core.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, GREY = "#2368a8", "#d1600f", "#3b8a3f", "#7f7f7f"
"""Distinguishable in print and with the common colour-vision deficiencies."""
_OTHER_WRITINGS = (
    "Noto Sans CJK SC", "Noto Sans CJK JP", "Noto Sans CJK KR", "WenQuanYi Micro Hei", "IPAGothic",
    "Hiragino Sans", "PingFang SC", "Apple SD Gothic Neo", "Microsoft YaHei", "Yu Gothic", "Malgun Gothic",
    "Noto Sans Devanagari", "Noto Sans Thai", "Arial Unicode MS",
)  # fmt: skip


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

    The file appears once it is complete; its folder is made where there is none. Text is drawn as it is:
    names of files and labels may hold dollars, which would begin a formula, and letters of any writing.
    """
    from matplotlib.text import Text

    families = _families()
    for text in figure.findobj(Text):
        text.set_parse_math(False)
        text.set_fontfamily(families)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120, metadata={"Software": None})
    return path


def _families() -> list[str]:
    """The font of the plots, and those of this machine that have the letters which it lacks."""
    from matplotlib.font_manager import fontManager

    here = set(fontManager.get_font_names())
    return ["DejaVu Sans", *(name for name in _OTHER_WRITINGS if name in here)]
