"""Distances that are known: each pair is compared once, whatever batch it comes in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gesture_core.classify import comparison
from gesture_core.classify.comparison import Comparison, compare
from gesture_core.classify.known import KnownDistances, mark_of
from gesture_core.settings import load_settings
from gesture_core.types import SignalBatch, Signals

CHANNELS = ("right_wrist_x", "left_wrist_x", "right_wrist_x.energy", "left_wrist_x.energy")
SETTINGS = load_settings("modern", ["classify.kernel=numpy"], environment={})


def some(seed: int, count: int) -> list[Signals]:
    random = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        frames = int(random.integers(3, 9))
        mask, present = random.random((2, 4)) < 0.8
        values = random.normal(size=(frames, 4))
        out.append(Signals(values, np.arange(frames), CHANNELS, mask=mask, present=present))
    return out


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The sizes of the tables that are computed."""
    sizes: list[tuple[int, int]] = []
    warped = comparison._Reading.warped

    def counting(self: comparison._Reading, queries: SignalBatch, extents: comparison.Extents) -> np.ndarray:
        if self.factor == 1:
            sizes.append((len(queries), len(self.extents.frames)))
        return warped(self, queries, extents)

    monkeypatch.setattr(comparison._Reading, "warped", counting)
    return sizes


def test_an_added_example_costs_its_own_pairs_alone(compared: list[tuple[int, int]], tmp_path: Path) -> None:
    every = some(0, 7)
    expected = compare(every, every, SETTINGS)
    compared.clear()
    known = KnownDistances("key")
    Comparison(every[:6], SETTINGS, known).distances(every[:6])
    known.write(tmp_path / "table")
    known = KnownDistances.read(tmp_path / "table", "key")
    found = Comparison(every, SETTINGS, known).distances(every)
    assert compared == [(6, 6), (6, 1), (1, 7)]
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(
        Comparison(every[::-1], SETTINGS, known).distances(every), expected[:, ::-1]
    )
    assert len(compared) == 3, "the order of examples changes no pair"


def test_a_table_of_other_settings_or_a_damaged_one_is_computed_again(tmp_path: Path) -> None:
    items = some(1, 3)
    marks = [mark_of(item) for item in items]
    known = KnownDistances("key")
    known.learn(marks, marks, np.arange(9.0).reshape(3, 3))
    known.write(tmp_path / "table")
    whole = (tmp_path / "table").read_bytes()
    again = KnownDistances.read(tmp_path / "table", "key").find(marks, marks)
    assert again.tolist() == np.arange(9.0).reshape(3, 3).tolist()
    for settings, content in (("other", whole), ("key", whole[:-30]), ("key", b""), ("key", b"x" * 500)):
        (tmp_path / "table").write_bytes(content)
        assert np.isnan(KnownDistances.read(tmp_path / "table", settings).find(marks, marks)).all()
    assert np.isnan(KnownDistances.read(tmp_path / "absent", "key").find(marks, marks)).all()


def test_all_that_decides_a_distance_is_in_the_mark() -> None:
    (item,) = some(2, 1)
    values = item.values.copy()
    values[0, 0] += 1
    everything = np.ones(4, bool)
    others = [
        Signals(values, item.times, CHANNELS, mask=item.mask, present=everything),
        Signals(item.values, item.times, CHANNELS, mask=~np.asarray(item.mask), present=item.present),
        Signals(item.values, item.times, CHANNELS[::-1], mask=item.mask, present=item.present),
    ]
    assert len({mark_of(one) for one in (item, *others)}) == 4
    assert mark_of(Signals(item.values, item.times + 1, CHANNELS, item.mask, item.present, "x")) == mark_of(
        item
    )
