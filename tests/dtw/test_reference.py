"""The reference itself: by hand, against other libraries' numbers, and its bands against their definition."""

from __future__ import annotations

import numpy as np
import pytest
from gesture_dtw_numpy.fastdtw import FastDtwKernel, fastdtw

from gesture_core.dtw import derivatives
from gesture_core.dtw.bands import allowed_cells, is_feasible, row_spans
from gesture_core.dtw.reference import accumulate, reference_distance
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError, InputError, SignalError

X = np.array([0.0, 1, 3, 2, 0, -1, 0.5])
Y = np.array([0.5, 2, 3, 1, -1.0])
XX = np.stack([X, np.sin(X)], axis=1)
YY = np.stack([Y, np.cos(Y)], axis=1)
SQUARED = DtwSpec(mode="dependent", cost="squared", reduce="sum")


def distance(x: np.ndarray, y: np.ndarray, spec: DtwSpec) -> float:
    x, y = (s[:, None] if s.ndim == 1 else s for s in (x, y))
    return reference_distance(x, y, spec)


# Printed by the named libraries for these series.
CONVENTIONS = {
    "dtaidistance 2.5.1 dtw.distance": (X, Y, SQUARED.replace(root=True), 2.345207879911715),
    "dtaidistance 2.5.1 dtw_ndim.distance": (XX, YY, SQUARED.replace(root=True), 3.233033315922637),
    "tslearn 0.10.0 dtw": (XX, YY, SQUARED.replace(root=True), 3.233033315922637),
    "tslearn 0.10.0 soft_dtw, gamma 0.5": (XX, YY, SQUARED.replace(gamma=0.5), 9.982488941427974),
    "tslearn 0.10.0 soft_dtw, gamma 0.01": (XX, YY, SQUARED.replace(gamma=0.01), 10.445572950060122),
    "tslearn 0.10.0 dtw, sakoe_chiba_radius 2": (
        X,
        X[::-1],
        SQUARED.replace(root=True, window=2),
        2.1213203435596424,
    ),
    "aeon 1.6.0 dtw_distance": (XX, YY, SQUARED, 10.452504421865722),
    "aeon 1.6.0 dtw_distance, window 0.3": (X, X[::-1], SQUARED.replace(window=2), 4.5),
    "fastdtw 0.3.4, radius 30, Euclidean": (
        XX,
        YY,
        DtwSpec(mode="dependent", cost="euclidean", reduce="sum"),
        8.822218943709913,
    ),
}


@pytest.mark.parametrize("library", CONVENTIONS)
def test_conventions_of_other_libraries(library: str) -> None:
    x, y, spec, printed = CONVENTIONS[library]
    assert distance(x, y, spec) == pytest.approx(printed, rel=1e-12)


def test_by_hand() -> None:
    cost = np.array([[1.0, 4.0], [2.0, 1.0], [5.0, 1.0]])
    table = accumulate(cost, np.ones((3, 2), bool), 0.0)
    assert table.tolist() == [[1, 5], [3, 2], [8, 3]]


def test_modes_norms_and_reductions() -> None:
    x, y = np.array([[0.0, 0.0], [3.0, 4.0]]), np.array([[0.0, 0.0], [0.0, 0.0]])
    assert distance(x, y, DtwSpec(reduce="sum")) == 7
    assert distance(x, y, DtwSpec()) == 3.5
    assert distance(x, y, DtwSpec(mode="dependent", cost="euclidean", reduce="sum")) == 5
    assert distance(x, y, DtwSpec(cost="squared", root=True, reduce="sum")) == 7
    assert distance(x, y, DtwSpec(length_norm=True, reduce="sum")) == 7 / 4
    assert distance(x, y, DtwSpec(weights=(2, 0.5), reduce="sum")) == 8
    assert reference_distance(x, y, DtwSpec(), np.array([False, True])) == 4
    assert reference_distance(x, y, DtwSpec(), np.array([False, False])) == np.inf


def test_soft_is_below_hard_and_may_be_negative() -> None:
    soft = [distance(X, Y, SQUARED.replace(gamma=g)) for g in (10.0, 1.0, 0.1, 1e-3)]
    assert soft == sorted(soft) and soft[0] < 0
    assert soft[-1] == pytest.approx(distance(X, Y, SQUARED), abs=0.05)


@pytest.mark.parametrize("n", [1, 2, 7, 20])
@pytest.mark.parametrize("m", [1, 5, 20, 41])
def test_sakoe_chiba_follows_the_slope(n: int, m: int) -> None:
    cells = allowed_cells(n, m, DtwSpec(window=0.2))
    reach = np.ceil(0.2 * max(n, m) - 1e-9)
    for i in range(n):
        for j in range(m):
            long, short = (i, j) if n > m else (j, i)
            last_long, last_short = max(n, m) - 1, min(n, m) - 1
            center = short * last_long / last_short if last_short else long
            assert cells[i, j] == (abs(long - center) <= reach + 1e-9)
    assert (cells == allowed_cells(m, n, DtwSpec(window=0.2)).T).all()


def test_equal_lengths_have_the_usual_band() -> None:
    cells = allowed_cells(9, 9, DtwSpec(window=2))
    assert (cells == (np.abs(np.subtract.outer(np.arange(9), np.arange(9))) <= 2)).all()
    (low,), (high,) = row_spans(9, np.array([9]), DtwSpec(window=2))
    assert low.tolist() == [0, 0, 0, 1, 2, 3, 4, 5, 6]
    assert high.tolist() == [3, 4, 5, 6, 7, 8, 9, 9, 9]


def test_itakura_is_a_parallelogram() -> None:
    cells = allowed_cells(9, 9, DtwSpec(shape="itakura", max_slope=2.0))
    assert cells[0].sum() == cells[-1].sum() == 1
    assert cells[4].tolist() == [False, False, True, True, True, True, True, False, False]
    assert (cells == cells[::-1, ::-1]).all() and (cells == cells.T).all()


def test_feasibility_is_whether_a_path_exists() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        n, m = rng.integers(1, 7, 2)
        mask = rng.random((n, m)) < 0.7
        spec = DtwSpec(mask=mask)  # type: ignore[arg-type]  # an array becomes a mask
        table = accumulate(np.ones((n, m)), mask, 0.0)
        assert is_feasible(int(n), np.array([m]), spec)[0] == np.isfinite(table[-1, -1])


def test_fastdtw_gives_the_numbers_of_its_package() -> None:
    rng = np.random.default_rng(7)
    a = rng.integers(-9, 10, (50, 2)).astype(float)
    b = rng.integers(-9, 10, (37, 2)).astype(float)
    assert fastdtw(a, b, 1, "absolute")[0] == 437.0
    assert fastdtw(a, b, 30, "absolute")[0] == 435.0
    assert fastdtw(a, b, 1, "euclidean")[0] == pytest.approx(344.68265690717595, rel=1e-14)
    assert fastdtw(X[:, None], Y[:, None], 1, "absolute")[0] == 5.0
    with pytest.raises(ConfigError):
        FastDtwKernel(radius=0)


def test_derivatives_are_those_of_keogh_and_pazzani() -> None:
    (slope,) = derivatives([np.array([0.0, 1, 4, 9, 16])])
    assert slope.tolist() == [1.5, 1.5, 3.5, 5.5, 5.5]
    for dtype in (np.uint8, np.int8, np.float16, np.float64):
        (slope,) = derivatives([np.array([5, 3, 1, 0], dtype)])
        assert slope.tolist() == [-2, -2, -1.75, -1.75] and slope.dtype == np.float64
    assert derivatives([np.zeros(3, np.float32)])[0].dtype == np.float32
    with pytest.raises(SignalError, match="series 1 has 2 frames"):
        derivatives([np.zeros(3), np.zeros(2)])
    masked = np.ma.masked_array(np.arange(4.0), [False, True, False, False])
    for wrong, code in ((masked, "E_NOT_FINITE"), (3.0, "E_DIMENSIONS"), (["a", "b", "c"], "E_DIMENSIONS")):
        with pytest.raises(InputError, match=f"{code} series 0"):
            derivatives([wrong])  # type: ignore[list-item]
    with pytest.raises(InputError, match=r"E_DIMENSIONS series are one array of shape \(4, 2\)"):
        derivatives(np.zeros((4, 2)))  # type: ignore[arg-type]
