"""Distances that are known: each pair is compared once, whatever batch it comes in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gesture_core.classify import comparison, known
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
    table = KnownDistances("key")
    Comparison(every[:6], SETTINGS, table).distances(every[:6])
    table.write(tmp_path / "table")
    table = KnownDistances.read(tmp_path / "table", "key")
    found = Comparison(every, SETTINGS, table).distances(every)
    assert compared == [(6, 6), (6, 1), (1, 7)]
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(
        Comparison(every[::-1], SETTINGS, table).distances(every), expected[:, ::-1]
    )
    assert len(compared) == 3, "the order of examples changes no pair"


def test_a_table_of_other_settings_or_a_damaged_one_is_computed_again(tmp_path: Path) -> None:
    items = some(1, 3)
    marks = [mark_of(item) for item in items]
    table = KnownDistances("key")
    table.learn(marks, marks, np.arange(9.0).reshape(3, 3))
    table.write(tmp_path / "table")
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


def test_the_table_does_not_grow_beyond_its_room(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(known, "LARGEST", 8 * 3 * 10)  # ten rows of three examples
    table, columns = KnownDistances("key"), [b"a" * 16, b"b" * 16, b"c" * 16]
    marks = [f"{i:016d}".encode() for i in range(40)]
    values = np.arange(120.0).reshape(40, 3)
    for start in range(0, 40, 4):
        table.learn(marks[start : start + 4], columns, values[start : start + 4])
        assert table._values.nbytes <= known.LARGEST and len(table._rows) <= 10
    np.testing.assert_array_equal(table.find(marks, columns)[:10], values[:10])
    assert np.isnan(table.find(marks, columns)[10:]).all()
    table.learn(marks[:2], [b"d" * 16, b"e" * 16], np.ones((2, 2)))  # more examples leave room for fewer rows
    assert table._values.nbytes <= known.LARGEST and len(table._rows) == 6
    np.testing.assert_array_equal(table.find(marks[:6], columns), values[:6])
    table.write(tmp_path / "table")
    monkeypatch.undo()
    again = KnownDistances.read(tmp_path / "table", "key").find(marks[:6], [*columns, b"d" * 16])
    np.testing.assert_array_equal(again[:, :3], values[:6])
    assert again[:2, 3].tolist() == [1, 1] and np.isnan(again[2:, 3]).all()


def test_a_table_that_holds_nothing_yet_is_read_again(tmp_path: Path) -> None:
    """As a run leaves it that ended before anything was compared."""
    KnownDistances("these").write(tmp_path / "distances.npz")
    known = KnownDistances.read(tmp_path / "distances.npz", "these")
    assert known.find([b"a"], [b"b"]).shape == (1, 1)
