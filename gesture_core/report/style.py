"""The look of all plots: fonts, and how a figure becomes a file.

matplotlib draws to files only and is loaded when it is needed.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import MissingDependencyError
from gesture_core.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text

DPI = 120
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
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained", **layout)
    FigureCanvasAgg(figure)
    return figure


def fitted(text: Text, room: float) -> None:
    """Shorten ``text`` in its middle until it takes no more than ``room`` inches."""
    _choose_font([text])
    words, figure = text.get_text(), text.get_figure(root=True)
    assert figure is not None
    keep, most = len(words), room * figure.dpi
    while keep > 1 and (wide := text.get_window_extent().width) > most:
        keep = min(keep - 1, int(keep * most / wide))
        text.set_text(f"{words[: keep - keep // 2]}…{words[len(words) - keep // 2 :]}")


def save(figure: Figure, path: Path, *, trim: bool = True) -> Path:
    """Write ``figure`` as PNG and return ``path``; the same numbers give the same bytes.

    The file appears once it is complete; its folder is made where there is none. With ``trim`` it is as large
    as what is drawn: a long label beside few classes must push nothing over the edge.
    """
    from matplotlib.text import Text

    _choose_font(figure.findobj(Text))
    box = "tight" if trim else None
    with replacing(path) as temporary:
        figure.savefig(
            temporary, format="png", dpi=DPI, metadata={"Software": None}, bbox_inches=box, pad_inches=0.1
        )
    return path


def _choose_font(texts: Iterable[Text]) -> None:
    """Draw text as it is: names of files and labels may hold dollars, and letters of any script."""
    from matplotlib.font_manager import fontManager

    installed = set(fontManager.get_font_names())
    families = ["DejaVu Sans", *(name for name in _OTHER_SCRIPTS if name in installed)]
    for text in texts:
        text.set_parse_math(False)  # a dollar would begin a formula
        text.set_fontfamily(families)
