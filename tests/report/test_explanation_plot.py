"""Each name beside a bar of the explanation's plot is that of its bar, with a runner-up and without."""

from __future__ import annotations

import numpy as np
import pytest

from gesture_core.classify.explanation import Alignment
from gesture_core.report.explanation import _bars
from gesture_core.types import Signals


def alignment(label: str, costs: list[float]) -> Alignment:
    names = tuple(f"channel_{number}" for number in range(len(costs)))
    signals = Signals(np.zeros((3, len(costs))), np.arange(3), names, np.ones(len(costs), bool))
    path = np.column_stack([np.arange(3)] * 2)
    one, used = np.zeros(3, int), np.ones(3, bool)
    return Alignment(label, label, sum(costs), False, signals, signals, np.array(costs), used, (path,), one)


@pytest.mark.parametrize("count", [1, 2])
def test_names_stand_in_the_middle_of_their_bars(count: int) -> None:
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    axes = Figure().add_subplot()
    _bars(axes, [alignment("up", [3.0, 1.0, 2.0]), alignment("down", [1.0, 1.0, 1.0])][:count], [0, 2, 1])
    bars = [bar for bar in axes.patches if isinstance(bar, Rectangle)]
    middles = np.array([bar.get_y() + bar.get_height() / 2 for bar in bars]).reshape(count, 3)
    np.testing.assert_allclose(axes.get_yticks(), middles.mean(axis=0))
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["channel_0", "channel_2", "channel_1"]
    assert axes.get_title() == ("channels that decide" if count == 2 else "largest parts of its distance")
