"""Letterboxing, peaks and windows: what is put into a picture comes out at the same place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core.plugin.interfaces import Person
from gesture_core.pose.contract import ModelContract
from gesture_core.pose.decode import find_peaks, top_peaks
from gesture_core.pose.follow import BELOW, SHOULDERS, Anatomy, Body, Window
from gesture_core.pose.network import Letterbox, input_size, to_batch
from gesture_core.skeletons import COCO18, SKELETONS

side = st.integers(8, 700)


@given(side, side, st.integers(32, 400), st.integers(32, 400), st.floats(0, 1), st.floats(0, 1))
def test_a_point_goes_into_the_box_and_back(
    width: int, height: int, wide: int, high: int, x: float, y: float
) -> None:
    box = Letterbox.fit((width, height), (high, wide))
    assert box.inner_width <= wide and box.inner_height <= high
    assert box.inner_width == wide or box.inner_height == high
    point = np.array([x * (width - 1), y * (height - 1)])
    scale = np.array([box.scale_x, box.scale_y])
    inside = (point + 0.5) * scale - 0.5 + (box.left, box.top)
    np.testing.assert_allclose(box.back(inside), point, atol=1e-2)


@settings(max_examples=60, deadline=None)
@given(st.integers(60, 400), st.integers(60, 400), st.floats(0.15, 0.85), st.floats(0.15, 0.85))
def test_a_spot_lies_in_the_input_where_the_box_says(width: int, height: int, x: float, y: float) -> None:
    frame = np.zeros((height, width, 3), np.uint8)
    point = np.array([round(x * width), round(y * height)])
    reach = 5
    frame[point[1] - reach : point[1] + reach + 1, point[0] - reach : point[0] + reach + 1, 1] = 255
    box = Letterbox.fit((width, height), (128, 96))
    green = to_batch([frame], box, ModelContract("openpose", pad=0))[0, 1]
    assert green.shape == (128, 96)
    rows, columns = np.mgrid[:128, :96]
    centre = np.array([(green * columns).sum(), (green * rows).sum()]) / green.sum()
    np.testing.assert_allclose(box.back(centre), point, atol=0.6 / min(box.scale_x, 1))


def test_colour_mean_scale_and_order_follow_the_contract() -> None:
    frame = np.zeros((4, 4, 3), np.uint8)
    frame[...] = (10, 20, 30)
    box = Letterbox.fit((4, 4), (4, 4))
    rgb = ModelContract("simcc", "coco17", "rgb", mean=(1.0, 2.0, 3.0), scale=(1.0, 0.5, 2.0))
    np.testing.assert_allclose(to_batch([frame], box, rgb)[0, :, 0, 0], [29, 9, 14])
    last = ModelContract("movenet", "coco17", "rgb", dtype="uint8", channels_first=False)
    batch = to_batch([frame], box, last)
    assert batch.shape == (1, 4, 4, 3) and batch.dtype == np.uint8 and batch[0, 0, 0].tolist() == [30, 20, 10]


def test_a_free_input_keeps_the_aspect_and_is_bounded() -> None:
    free = ModelContract("openpose", multiple=8)
    assert input_size(free, (640, 480), 368) == (368, 496)
    assert input_size(free, (480, 640), 368) == (368, 280)
    assert input_size(free, (10_000, 10), 100) == (104, 312)
    assert input_size(ModelContract("openpose", input_size=(256, 192)), (640, 480), 368) == (256, 192)


cell = st.floats(1.5, 10.5)


@given(st.lists(st.tuples(cell, cell), min_size=1, max_size=6), st.floats(0.9, 2.5), st.floats(0.2, 1))
def test_gaussian_peaks_are_found_below_the_size_of_a_cell(
    places: list[tuple[float, float]], sigma: float, height: float
) -> None:
    rows, columns = np.mgrid[:13, :13]
    maps = np.stack(
        [height * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2)) for x, y in places]
    )
    peaks = top_peaks(maps[None].astype(np.float32), 1, 0.1)[0, :, 0]
    assert np.linalg.norm(peaks[:, :2] - places, axis=1).max() < 0.05
    assert (np.abs(peaks[:, 2] - maps.max(axis=(1, 2))) < 1e-5).all()


def test_flat_negative_and_border_maps_are_read_without_fuss() -> None:
    maps = np.zeros((1, 6, 5, 6), np.float32)
    maps[0, 1] = -3
    maps[0, 2, 0, 0] = maps[0, 3, 4, 5] = 7
    maps[0, 4] = np.nan
    maps[0, 5] = 0.5  # all of one height: exactly one peak
    peaks = top_peaks(maps, 2, 0.05)[0]
    assert np.isnan(peaks[[0, 1, 4], :, :2]).all() and (peaks[[0, 1, 4], :, 2] == 0).all()
    assert peaks[2, 0].tolist() == [0, 0, 1] and peaks[3, 0].tolist() == [5, 4, 1]
    assert peaks[5, 0, 2] == 0.5 and np.isnan(peaks[5, 1, :2]).all()


def test_a_peak_beside_a_cell_that_is_no_number_is_found() -> None:
    maps = np.zeros((1, 1, 5, 5), np.float32)
    maps[0, 0, 2, 2], maps[0, 0, 2, 3] = 0.8, np.nan
    n, _, points, scores = find_peaks(maps, 0.1)
    assert n.tolist() == [0] and scores.tolist() == pytest.approx([0.8])
    assert np.isfinite(points).all()


@given(st.integers(0, 2**32 - 1))
def test_the_highest_peaks_come_first_and_agree_with_a_plain_search(seed: int) -> None:
    maps = np.random.default_rng(seed).random((2, 3, 7, 6)).astype(np.float32)
    found = top_peaks(maps, 4, 0.5)
    for one, top in zip(maps.reshape(-1, 7, 6), found.reshape(-1, 4, 3), strict=True):
        around = np.pad(one, 1, constant_values=-1)
        plain = sorted(
            (
                float(one[y, x])
                for y in range(7)
                for x in range(6)
                if one[y, x] > 0.5 and one[y, x] == around[y : y + 3, x : x + 3].max()
            ),
            reverse=True,
        )[:4]
        assert top[: len(plain), 2].tolist() == plain and np.isnan(top[len(plain) :, 0]).all()
        assert (top[len(plain) :, 2] == 0).all()


def _person(**places: tuple[float, float]) -> Person:
    points = np.full((18, 2), np.nan, np.float32)
    for joint, place in places.items():
        points[COCO18.index(joint)] = place
    return Person(points, np.where(np.isnan(points[:, 0]), 0, 0.8).astype(np.float32))


def test_the_body_is_measured_by_the_torso_and_without_hips_by_the_shoulders() -> None:
    anatomy = Anatomy(COCO18)
    shoulders = {"right_shoulder": (70.0, 100.0), "left_shoulder": (130.0, 100.0)}
    hips = {"right_hip": (80.0, 200.0), "left_hip": (120.0, 200.0)}
    body = anatomy.body(_person(**shoulders, **hips))
    assert body is not None and body.torso == pytest.approx(100) and body.x == pytest.approx(100)
    cut = anatomy.body(_person(**shoulders))
    assert cut is not None and cut.torso == pytest.approx(60 / SHOULDERS)
    assert anatomy.body(_person(**hips)) is None and anatomy.body(None) is None
    window = Window.around(body, 1.0, (2000, 2000))
    assert window.bottom >= 100 + BELOW * 100 - 1 and window.top == 0


@pytest.mark.parametrize("name", [name for name, one in SKELETONS.items() if one.group("body")])
def test_every_skeleton_has_an_anatomy(name: str) -> None:
    layout = SKELETONS[name]
    points = np.zeros((len(layout.joints), 2), np.float32)
    for joint, place in {"right_shoulder": (0, 0), "left_shoulder": (30, 0), "right_hip": (15, 40)}.items():
        points[layout.index(joint)] = place
    person = Person(points, np.ones(len(layout.joints), np.float32))
    assert Anatomy(layout).confidence(person) == 1 and Anatomy(layout).body(person) is not None


@given(
    st.floats(-500, 1500), st.floats(-500, 1500), st.floats(2, 2000), st.integers(1, 900), st.integers(1, 900)
)
def test_windows_lie_in_the_frame(x: float, y: float, torso: float, width: int, height: int) -> None:
    window = Window.around(Body(x, y, torso), 1.1, (width, height))
    assert 0 <= window.left < window.right <= width and 0 <= window.top < window.bottom <= height
    size = window.right - window.left, window.bottom - window.top
    assert min(size) >= min(32, width, height) - 1
    assert window.view(np.zeros((height, width, 3), np.uint8)).shape[1::-1] == size


@pytest.mark.parametrize(("torso", "even"), [(40, 2), (170, 2), (200, 4), (420, 8)])
def test_large_windows_are_halved_exactly_more_than_once(torso: float, even: int) -> None:
    for move in range(9):  # whatever the rounding
        window = Window.around(Body(2000.3 + move, 1999.6, torso + 0.3 * move), 1.15, (4096, 4096))
        assert (window.right - window.left) % even == (window.bottom - window.top) % even == 0
