"""The suite of pose backends. Each check takes a backend, and pictures of somebody if it needs its own.

>>> import pytest
>>> from gesture_core.testing import POSE_CHECKS
>>> @pytest.mark.parametrize("check", POSE_CHECKS)
... def test_my_backend(check):
...     check(MyBackend(model))
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from gesture_core.plugin.interfaces import PoseBackend
from gesture_core.skeletons import SKELETONS
from gesture_core.testing.answers import ask, ask_or_refuse
from gesture_core.types import Person

_SAME = 0.01
"""Pixels within which two answers to the same picture agree."""


class PoseCheck(Protocol):
    """A check of a pose backend.

    ``frames`` are a few pictures of one size, (H, W, 3) uint8 in BGR, with somebody whom the backend
    finds; a drawn person by default.
    """

    __name__: str

    def __call__(self, backend: PoseBackend, frames: Sequence[np.ndarray] = ()) -> None: ...


def draw_frames(count: int = 3) -> list[np.ndarray]:
    """Pictures of a drawn person who waves, 320 x 240 pixels."""
    from gesture_core.demo.drawing import backdrop_of, draw
    from gesture_core.demo.figure import GESTURES, Style, joints, random_body

    rng = np.random.default_rng(0)
    body = random_body(rng, (320, 240))
    points = joints(body, *GESTURES["wave"](Style(max(count, 9))), rng)
    backdrop = backdrop_of(body, (320, 240), rng)
    return [draw(body, place, backdrop) for place in points[-count:]]


def check_pose_answer(backend: PoseBackend, frames: Sequence[np.ndarray] = ()) -> None:
    """For every frame at most one person, with (J, 2) pixels of that frame and (J,) scores in 0..1."""
    name, frames = type(backend).__name__, frames or draw_frames()
    assert isinstance(backend, PoseBackend), f"{name} lacks skeleton, batch_size, or the method estimate"
    assert isinstance(backend.batch_size, int) and backend.batch_size >= 1, (
        f"{name}.batch_size is {backend.batch_size!r}, expected a number of frames, 1 or more"
    )
    found = _people(backend, frames)
    most = max(len(people) for people in found)
    assert most, f"{name}.estimate finds nobody in these pictures; give the check some with somebody in them"
    assert most == 1, f'{name}.estimate finds {most} people in a frame where people is "single"'


def check_pose_pixels(backend: PoseBackend, frames: Sequence[np.ndarray] = ()) -> None:
    """Coordinates are pixels of the frame: in a picture of twice the size they are twice as large."""
    name, frames = type(backend).__name__, frames or draw_frames()
    large = [frame.repeat(2, axis=0).repeat(2, axis=1) for frame in frames]
    pairs = [
        (one[0].keypoints, two[0].keypoints)
        for one, two in zip(_people(backend, frames), _people(backend, large), strict=True)
        if one and two
    ]
    here, there = np.array([one for one, _ in pairs]), np.array([two for _, two in pairs])
    assert np.isfinite(here - there).any(), f"{name}.estimate loses everybody in a picture twice as large"
    assert np.nanmax(here) > 1, (
        f"{name}.estimate: all coordinates lie in 0..1; they are pixels of the frame, not shares of it"
    )
    off = float(np.nanmedian(np.linalg.norm(here - there / 2, axis=-1)))
    assert off < 0.03 * max(frames[0].shape), (
        f"{name}.estimate: joints lie {off:.0f} pixels from where they lie in the same picture at twice the "
        "size; coordinates are pixels of the frame that was passed in"
    )


def check_pose_batches(backend: PoseBackend, frames: Sequence[np.ndarray] = ()) -> None:
    """A frame has the same people alone, among others, among frames of another size, and a second time."""
    name, frames = type(backend).__name__, list(frames or draw_frames())
    assert ask(backend.estimate, []) == [], f"{name}.estimate of no frames is not an empty list"
    alone = [_people(backend, [frame])[0] for frame in frames]
    many = [frames[n % len(frames)] for n in range(min(backend.batch_size + 1, 9))]
    small = np.ascontiguousarray(frames[0][: frames[0].shape[0] // 2])
    for what, given, places in (
        ("among others", many, range(len(many))),
        ("among frames of another size", [frames[0], small, *frames[1:]], [0, *range(2, len(frames) + 1)]),
        ("a second time", frames, range(len(frames))),
    ):
        found = _people(backend, given)
        for n, place in enumerate(places):
            assert _alike(found[place], alone[n % len(frames)]), (
                f"{name}.estimate finds other joints in a frame {what} than in the same frame alone"
            )


def check_pose_input(backend: PoseBackend, frames: Sequence[np.ndarray] = ()) -> None:
    """Frames stay as they are, and may be windows of larger pictures that nobody may write to."""
    name, frames = type(backend).__name__, frames or draw_frames()
    high, wide = frames[0].shape[:2]
    around = np.zeros((high + 30, wide + 50, 3), np.uint8)
    around[10 : high + 10, 20 : wide + 20] = frames[0]
    before = around.copy()
    around.flags.writeable = False
    (seen,) = _people(backend, [around[10 : high + 10, 20 : wide + 20]])
    assert np.array_equal(around, before), f"{name}.estimate changes the frame that it was given"
    (alone,) = _people(backend, [np.array(frames[0])])
    assert _alike(seen, alone), (
        f"{name}.estimate finds other joints in a window of a larger picture than in a copy of the window"
    )


def check_pose_people(backend: PoseBackend, frames: Sequence[np.ndarray] = ()) -> None:
    """ "multi" gives everybody, best first, or a GestureError; another word is a GestureError."""
    name, frames = type(backend).__name__, frames or draw_frames()
    everybody = ask_or_refuse('people="multi"', backend.estimate, frames, "multi")
    if everybody is not None:
        _check_people(backend, frames, everybody)
    nobody = ask_or_refuse('people="no-such-word"', backend.estimate, frames, "no-such-word")
    assert nobody is None, f'{name}.estimate takes people="no-such-word" and must raise a GestureError'


def check_pose_odd(backend: PoseBackend, frames: Sequence[np.ndarray] = ()) -> None:
    """One pixel, one colour, noise, very wide pictures: people, nobody, or a GestureError."""
    noise = np.random.default_rng(0).integers(0, 256, (90, 120, 3), dtype=np.uint8)
    for what, frame in (
        ("one pixel", np.zeros((1, 1, 3), np.uint8)),
        ("a black picture", np.zeros((90, 120, 3), np.uint8)),
        ("a white picture", np.full((90, 120, 3), 255, np.uint8)),
        ("noise", noise),
        ("a picture of 2 x 300 pixels", np.ascontiguousarray(noise[:2].repeat(3, axis=1)[:, :300])),
    ):
        found = ask_or_refuse(what, backend.estimate, [frame])
        if found is not None:
            _check_people(backend, [frame], found)


def _people(backend: PoseBackend, frames: Sequence[np.ndarray]) -> list[list[Person]]:
    """The people whom ``backend`` finds in ``frames``, checked."""
    found = ask(backend.estimate, frames)
    _check_people(backend, frames, found)
    return found


def _check_people(backend: PoseBackend, frames: Sequence[np.ndarray], found: list[list[Person]]) -> None:
    """Shapes, missing values, ranges."""
    name, body = f"{type(backend).__name__}.estimate", SKELETONS.get(backend.skeleton)
    assert body, (
        f"{type(backend).__name__}.skeleton is {backend.skeleton!r}, expected one of {', '.join(SKELETONS)}"
    )
    joints = len(body.joints)
    assert len(found) == len(frames), f"{name} answers with {len(found)} frames for {len(frames)}"
    for frame, people in zip(frames, found, strict=True):
        assert isinstance(people, list), f"{name} gives {type(people).__name__} for a frame, expected a list"
        for person in people:
            points, scores = np.asarray(person.keypoints), np.asarray(person.scores)
            assert points.shape == (joints, 2) and scores.shape == (joints,), (
                f"{name}: keypoints {points.shape} and scores {scores.shape}, expected ({joints}, 2) and "
                f"({joints},) for {backend.skeleton}"
            )
            assert points.dtype.kind == "f" and scores.dtype.kind == "f", f"{name}: expected float arrays"
            assert np.isfinite(scores).all() and ((scores >= 0) & (scores <= 1)).all(), (
                f"{name}: scores of {scores.min():g} to {scores.max():g}, expected 0..1"
            )
            missing = np.isnan(points)
            assert (missing[:, 0] == missing[:, 1]).all(), f"{name}: a joint has one coordinate; NaN in both"
            size = np.array([frame.shape[1], frame.shape[0]])
            inside = (points > -0.5 * size - 1) & (points < 1.5 * size + 1)
            assert (inside | missing).all(), f"{name}: a joint lies far outside its frame; NaN where missing"


def _alike(one: Sequence[Person], other: Sequence[Person]) -> bool:
    """Whether the same people were found twice."""
    return len(one) == len(other) and all(
        np.allclose(a.keypoints, b.keypoints, atol=_SAME, equal_nan=True)
        for a, b in zip(one, other, strict=True)
    )


POSE_CHECKS: tuple[PoseCheck, ...] = (
    check_pose_answer,
    check_pose_pixels,
    check_pose_batches,
    check_pose_input,
    check_pose_people,
    check_pose_odd,
)
"""The suite of pose backends."""
