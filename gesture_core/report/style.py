"""The look of all plots: fonts, and how a figure becomes a file.

matplotlib draws to files only and is loaded when it is needed.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import MissingDependencyError
from gesture_core.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OTHER_SCRIPTS = (
    "Noto Sans CJK SC", "Noto Sans CJK JP", "Noto Sans CJK KR", "WenQuanYi Micro Hei", "IPAGothic",
    "Hiragino Sans", "PingFang SC", "Apple SD Gothic Neo", "Microsoft YaHei", "Yu Gothic", "Malgun Gothic",
    "Noto Sans Devanagari", "Noto Sans Thai", "Arial Unicode MS",
)  # fmt: skip
"""Fonts that have letters which the font of the plots lacks."""


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
            "pictures need matplotlib", remedy="pip install 'gesture-core[evaluate]'"
        ) from None
    figure = Figure(figsize=(width, height), layout="constrained", **layout)
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write ``figure`` as PNG and return ``path``; the same numbers give the same bytes.

    The file appears once it is complete; its folder is made where there is none. Text is drawn as it is:
    names of files and labels may hold dollars, which would begin a formula, and letters of any script.
    """
    from matplotlib.font_manager import fontManager
    from matplotlib.text import Text

    installed = set(fontManager.get_font_names())
    families = ["DejaVu Sans", *(name for name in _OTHER_SCRIPTS if name in installed)]
    for text in figure.findobj(Text):
        text.set_parse_math(False)
        text.set_fontfamily(families)
    with replacing(path) as temporary:
        # As large as what is drawn: a long label beside few classes must push nothing over the edge.
        figure.savefig(
            temporary, format="png", dpi=120, metadata={"Software": None}, bbox_inches="tight", pad_inches=0.1
        )
    return path
