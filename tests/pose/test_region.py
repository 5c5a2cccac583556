"""BlazePose and the square that follows a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gesture_core.errors import ModelError
from gesture_core.plugin import registry
from gesture_core.plugin.interfaces import Person
from gesture_core.pose.contract import BLAZEPOSE, Tensor, infer_contract
from gesture_core.pose.decode import decode
from gesture_core.pose.extract import extract_poses
from gesture_core.pose.follow import PAUSE
from gesture_core.pose.live import LivePose
from gesture_core.pose.models import ModelFile
from gesture_core.pose.network import NetworkBackend
from gesture_core.pose.region import CIRCLE, JOINTS, OneEuro, Region, RegionFollower
from gesture_core.skeletons import BLAZEPOSE33, COCO18, Skeleton
from gesture_core.video import open_video

IMAGE = Tensor("input", "float32", (1, 3, 256, 256))
_ARM = "shoulder", "elbow"
SHAPES = [(1, 1, 256, 256), (1, 39, 64, 64), (1, BLAZEPOSE), (1, 117), (1, 1)]


def landmarks(points: np.ndarray, visibility: float = 2.0) -> np.ndarray:
    """The network's output (1, 195) for 33 points of the square."""
    rows = np.zeros((39, 5), np.float32)
    rows[:33, :2] = points + 0.5
    rows[:33, 2] = 10 * np.arange(33)
    rows[:33, 3] = visibility
    rows[33:35, :2] = (128.5, 120.5), (128.5, 20.5)
    return rows.reshape(1, -1)


def test_its_outputs_are_recognised_and_decoded() -> None:
    contract = infer_contract([IMAGE], SHAPES)
    assert (contract.layout, contract.skeleton, contract.steady) == ("blazepose", "blazepose33", False)
    points = np.random.default_rng(0).uniform(-20, 280, (33, 2)).astype(np.float32)
    outputs = [np.full(shape, -20, np.float32) for shape in SHAPES]  # the heat maps show nothing
    outputs[2], outputs[4] = landmarks(points), np.full((1, 1), 0.7, np.float32)
    ((person,),) = decode(outputs, contract, (256, 256), "single", 0.05)
    np.testing.assert_allclose(person.keypoints, points, atol=1e-3)
    np.testing.assert_allclose(person.scores, 1 / (1 + np.exp(-2.0)), atol=1e-5)
    assert person.depth is not None and person.depth[3] == 30
    assert person.presence == pytest.approx(0.7) and person.region is not None
    np.testing.assert_allclose(person.region, [(128, 120), (128, 20)])


def test_heat_maps_make_landmarks_finer() -> None:
    contract = infer_contract([IMAGE], SHAPES)
    points = np.random.default_rng(1).uniform(30, 220, (33, 2)).astype(np.float32)
    points[7], points[8], points[9] = (-5, 100), (1, 254), (np.nan, 3)
    outputs = [np.zeros(shape, np.float32) for shape in SHAPES]
    outputs[2], outputs[4] = landmarks(points), np.full((1, 1), 0.9, np.float32)
    outputs[1] -= 20  # nothing is known, but of four joints, whose cells are 4 pixels wide
    outputs[1][0, 3, 20, 30] = outputs[1][0, 3, 20, 31] = 3
    outputs[1][0, 8, 62, 0] = outputs[1][0, 10, 5, 5] = 3
    outputs[1][0, 4, 20, 30] = -0.1  # less than even
    points[3], points[4], points[10] = (123, 78), (123, 78), (200, 200)
    outputs[2] = landmarks(points)
    ((person,),) = decode(outputs, contract, (256, 256), "single", 0.05)
    expected = points.copy()
    expected[3], expected[8] = (30.5 * 4 - 0.5, 20 * 4 - 0.5), (-0.5, 62 * 4 - 0.5)
    np.testing.assert_allclose(person.keypoints, expected, atol=1e-3)


@pytest.mark.parametrize("angle", [0.0, 0.3, -1.2, 3.0])
def test_a_place_is_seen_in_the_square_and_found_back(angle: float) -> None:
    picture = np.zeros((300, 400, 3), np.uint8)
    picture[140:143, 210:213] = 255
    region = Region(200, 150, 160, angle)
    view = region.view(picture, 256).sum(axis=2).astype(float)
    rows, columns = np.mgrid[:256, :256]
    seen = np.array([[(columns * view).sum(), (rows * view).sum()]]) / view.sum()
    found = region.back(Person(seen, np.ones(1)), 256).keypoints
    np.testing.assert_allclose(found, [[211, 141]], atol=0.1)


def test_people_stand_upright_in_their_square() -> None:
    middle, top = np.array([100.0, 100.0]), np.array([170.0, 100.0])  # lying, the head to the right
    region = Region.around(middle, top)
    assert region is not None
    upright = Region.around(middle, np.array([100.0, 30.0]))
    assert upright is not None and upright.angle == 0 and upright.side == region.side == 175
    head = region.back(Person(np.array([[127.5, 60.0]]), np.ones(1), region=np.zeros((2, 2))), 256)
    assert head.keypoints[0, 0] > 120 and head.keypoints[0, 1] == pytest.approx(100, abs=0.5)
    assert head.region is not None and np.linalg.norm(head.region[0] - middle) > 100
    deep = Region(0, 0, 512).back(Person(np.zeros((1, 2)), np.ones(1), depth=np.array([30.0])), 256)
    assert deep.depth is not None and deep.depth[0] == 60  # in pixels of the frame, as x and y
    assert Region.around(middle, middle) is None
    for wrong in (np.nan, np.inf, -np.inf, 1e12):
        assert Region.around(middle, np.array([wrong, 30.0])) is None
        assert Region.around(np.array([wrong, 30.0]), np.array([wrong, 90.0])) is None


def test_landmarks_without_presence_are_another_network() -> None:
    shapes = [shape for shape in SHAPES if shape != (1, 1)]
    with pytest.raises(ModelError, match=r"E_MODEL_LAYOUT.*presence"):
        infer_contract([IMAGE], shapes)
    contract = infer_contract([IMAGE], SHAPES)
    with pytest.raises(ModelError, match=r"E_MODEL_LAYOUT.*whether a person is there"):
        decode([np.zeros(shape, np.float32) for shape in shapes], contract, (256, 256), "single", 0.05)


def figure(view: np.ndarray, layout: Skeleton) -> np.ndarray:
    """Keypoints (J, 2) of the figure whose shoulders are a red spot, and whose hips are a blue one."""
    spots = [np.argwhere(view[..., channel] > 60) for channel in (2, 0)]
    red, blue = (spot.mean(axis=0)[::-1] if len(spot) else np.full(2, np.nan) for spot in spots)
    points = np.full((len(layout.joints), 2), np.nan)
    across = 0.3 * float(np.linalg.norm(red - blue))
    for sign, side in ((1, "left"), (-1, "right")):
        points[layout.index(f"{side}_shoulder")] = red + np.array([sign * across, 0])
        points[layout.index(f"{side}_hip")] = blue + np.array([sign * across, 0])
    return points


class Seeing:
    """Sees the figure in its square, in a picture without one too where it is ``wrong``."""

    skeleton, batch_size, region, wrong = "blazepose33", 1, 256, False

    def finder(self) -> Finding:
        return Finding()

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        (view,) = frames
        if not view.any():
            points = np.full((33, 2), 128.0) + np.arange(33)[:, None]
            return [[Person(points, np.ones(33), region=points[[0, 30]])] if self.wrong else []]
        points = figure(view, BLAZEPOSE33)
        hips, shoulders = (
            points[[BLAZEPOSE33.index(f"{side}_{part}") for side in ("left", "right")]].mean(axis=0)
            for part in ("hip", "shoulder")
        )
        region = np.array([hips, hips + 1.75 * (shoulders - hips)])
        return [[Person(points, np.ones(33), region=region)]]


class Finding:
    """Finds the figure; in a picture without one, a body somewhere else than the other one."""

    skeleton, batch_size, presence = "coco18", 8, 1.0

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        nobody = np.zeros((64, 64, 3), np.uint8)
        nobody[20, 20, 2] = nobody[50, 20, 0] = 255
        found = [figure(view if view.any() else nobody, COCO18) for view in frames]
        return [[Person(points, np.ones(18), presence=self.presence)] for points in found]


EMPTY = np.zeros((240, 320, 3), np.uint8)
FRAME = EMPTY.copy()
FRAME[80:84, 150:154, 2] = FRAME[120:124, 150:154, 0] = 255


def film(pictures: Sequence[np.ndarray], rate: float = 20.0) -> list[tuple[float, np.ndarray]]:
    return [(i / rate, picture) for i, picture in enumerate(pictures)]


def test_nobody_is_kept_where_nobody_is_and_searches_become_seldom() -> None:
    follower = RegionFollower(Seeing())
    found = follower.estimate(film([FRAME] * 10))
    assert follower.searches == 1
    for person in found:
        assert person is not None
        shoulder = person.keypoints[BLAZEPOSE33.index("left_shoulder")]
        np.testing.assert_allclose(shoulder, (151.5 + 12, 81.5), atol=1)
    assert not any(follower.estimate(film([EMPTY] * 200)))
    assert follower.searches < 200 / PAUSE + 8
    found = follower.estimate(film([FRAME] * (PAUSE + 2)))
    assert found[-1] is not None  # who comes back is found after the longest pause at the latest


def test_a_find_that_the_other_network_does_not_see_is_nobody() -> None:
    backend = Seeing()
    backend.wrong = True
    assert not any(RegionFollower(backend).estimate(film([EMPTY] * 5)))


@pytest.mark.parametrize(("presence", "there"), [(0.1, False), (0.9, True)])
def test_a_find_that_is_no_person_to_the_other_network_is_nobody(
    presence: float, there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Finding, "presence", presence)
    assert all(RegionFollower(Seeing()).estimate(film([FRAME] * 3))) == there


def euro(values: np.ndarray, times: np.ndarray, constants: tuple[float, float], size: float) -> np.ndarray:
    """The filter of the paper, one number at a time, as its authors print it."""
    smooth = [float(values[0])]
    speed = 0.0
    for before, value, gap in zip(values, values[1:], np.diff(times), strict=False):
        share = 1 / (1 + 1 / (2 * np.pi * gap))
        speed = share * (value - before) / gap / size + (1 - share) * speed
        share = 1 / (1 + 1 / (2 * np.pi * (constants[0] + constants[1] * abs(speed)) * gap))
        smooth.append(float(share * value + (1 - share) * smooth[-1]))
    return np.array(smooth)


@pytest.mark.parametrize("constants", [JOINTS, CIRCLE])
def test_the_low_pass_is_that_of_the_paper(constants: tuple[float, float]) -> None:
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.02, 0.1, 60))
    values = np.stack([np.full(60, 5.0), 40 * times, random.normal(0, 1, 60)], axis=1)
    values[:, 0] += random.normal(0, 0.1, 60)
    low_pass = OneEuro(*constants)
    found = np.stack([low_pass(time, row, 120.0) for time, row in zip(times, values, strict=True)])
    for column in range(3):
        np.testing.assert_allclose(found[:, column], euro(values[:, column], times, constants, 120.0))
    assert np.std(found[20:, 0]) < 0.03  # at rest it jitters a fraction as much
    assert np.abs(found[-1, 1] - values[-1, 1]) < 2  # what moves is hardly late


def test_a_joint_that_was_missing_is_taken_as_it_is() -> None:
    low_pass = OneEuro(*JOINTS)
    rows = np.array([[1.0, 1], [np.nan, 1], [np.nan, 1], [9, 1], [9, 1]])
    found = [low_pass(0.1 * i, row, 10.0) for i, row in enumerate(rows)]
    np.testing.assert_allclose(found, rows)
    # A clock that stands still, or steps back, stops nothing.
    for time in [0.4] * 20 + [0.1, 0.2]:
        place = low_pass(time, np.array([30.0, 1]), 10.0)
    np.testing.assert_allclose(place, (30, 1), atol=1)


class Jittery(Seeing):
    """Sees the figure a little off each time, its circle too."""

    def __init__(self) -> None:
        self._random = np.random.default_rng(8)

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        ((person,),) = super().estimate(frames)
        assert person.region is not None
        off, turn = self._random.normal(0, 0.2, person.keypoints.shape), self._random.normal(0, 0.2, (2, 2))
        return [[replace(person, keypoints=person.keypoints + off, region=person.region + turn)]]


def test_what_jitters_is_smoothed_live_as_in_a_recording() -> None:
    frames = film([FRAME] * 40)
    (pose,) = extract_poses(frames, Jittery(), follow=True, steady=False)
    live = LivePose(Jittery(), follow=True, steady=False)
    pushed = [live.push(*frame) for frame in frames]
    np.testing.assert_array_equal(pose.keypoints, np.concatenate([one.keypoints for one in pushed]))
    shoulder = pose.keypoints[20:, BLAZEPOSE33.index("left_shoulder")]
    assert np.diff(shoulder, axis=0).std() < 0.05  # 0.2 of the square are 0.14 pixels, and differences 0.2


def blaze(model: ModelFile, **options: object) -> NetworkBackend:
    made: NetworkBackend = registry().make("pose", "opencv-dnn", {"threads": 1, **options}, model=model)
    return made


def test_it_sees_nobody_in_pictures_of_nobody(blazepose: ModelFile) -> None:
    random = np.random.default_rng(5)
    bars = np.zeros((240, 320, 3), np.uint8)
    for i, colour in enumerate([(255, 255, 255), (0, 255, 255), (255, 255, 0), (0, 255, 0), (255, 0, 255)]):
        bars[:, 64 * i : 64 * (i + 1)] = colour
    noise = random.integers(0, 256, (240, 320, 3), np.uint8)
    for picture in (np.zeros((240, 320, 3), np.uint8), np.full((240, 320, 3), 255, np.uint8), bars, noise):
        (pose,) = extract_poses([(0.0, picture), (0.1, picture)], blaze(blazepose))
        assert pose.frames_with_pose == 0


def test_it_sees_the_person_of_a_clip_where_its_publisher_does(blazepose: ModelFile, shared: Path) -> None:
    folder = shared / "body_gesture"
    with open_video(folder / "S2" / "slowdown_1_1m_upper.avi") as video:
        frames = [frame for frame, _ in zip(video, range(12), strict=False)]
    (pose,) = extract_poses(frames, blaze(blazepose))
    assert pose.skeleton == "blazepose33" and pose.frames_with_pose == len(frames)
    nose, ear = (BLAZEPOSE33.index(joint) for joint in ("nose", "left_ear"))
    assert pose.depth is not None and (pose.depth[:, nose] < pose.depth[:, ear]).all()  # they face the camera
    with np.load(folder / "landmarks_mediapipe33.npz", allow_pickle=False) as archive:
        theirs = archive["S2__d__slowdown_1_1m_upper"][: len(frames), :, :2] * (640, 480)
    joints = [
        BLAZEPOSE33.index(f"{side}_{part}") for side in ("left", "right") for part in ("shoulder", "elbow")
    ]
    width = np.linalg.norm(theirs[:, joints[0]] - theirs[:, joints[2]], axis=1).mean()
    away = np.linalg.norm(pose.keypoints[:, joints] - theirs[:, joints], axis=2) / width
    assert np.median(away) < 0.06
