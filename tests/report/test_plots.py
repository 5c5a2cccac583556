"""Names of files and labels stand in plots as they are, whatever they are made of."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Families of the text that is drawn, of a machine that has one font for Chinese."""
    pytest.importorskip("matplotlib")
    from matplotlib import font_manager
    from matplotlib.text import Text

    names = font_manager.fontManager.get_font_names()
    monkeypatch.setattr(font_manager.fontManager, "get_font_names", lambda: [*names, "Noto Sans CJK SC"])
    families: list[str] = []

    def note(_text: Text, family: object) -> None:
        families.extend(family if isinstance(family, list) else ())

    monkeypatch.setattr(Text, "set_fontfamily", note)
    return families


def test_a_dollar_is_a_dollar_and_other_writings_have_a_font(shown: list[str], tmp_path: Path) -> None:
    from gesture_core.report.style import new_figure, save

    figure = new_figure(3, 2)
    axes = figure.add_subplot()
    axes.set_xticks([0, 1], ["$_$", "a$^$"])
    axes.set_title("clip_$1_$2.mp4")
    figure.suptitle("$\\nothing$")
    assert save(figure, tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
    assert set(shown) == {"DejaVu Sans", "Noto Sans CJK SC"}


@pytest.mark.parametrize(
    "labels", [("a very long label indeed", "b"), ("up", "side", "knee"), tuple("abcdefgh")]
)
def test_nothing_of_a_confusion_plot_is_cut_off(labels: tuple[str, ...], tmp_path: Path) -> None:
    """Every border of the picture is white: what is drawn ends before it."""
    pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    from gesture_core.classify.scores import Answer, Evaluation
    from gesture_core.report.evaluation import confusion_plot
    from gesture_core.settings import load_settings

    answers = [
        Answer(str(n), label, "s", "s", label if n else None, 0.1, 0.1) for n, label in enumerate(labels)
    ]
    evaluation = Evaluation(answers, "leave-one-subject-out", load_settings())
    picture = imread(confusion_plot(evaluation, tmp_path / "plot.png"))[..., :3]
    for border in (picture[:4], picture[-4:], picture[:, :4], picture[:, -4:]):
        assert (border == 1).all()
