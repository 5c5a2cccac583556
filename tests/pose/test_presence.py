"""Who is no person is nobody: by the network's own word, or by what its keypoints look like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_networks import FIGURE, constant, dot_network, dot_picture

from gesture_core.errors import ModelError
from gesture_core.plugin import registry
from gesture_core.pose.contract import ModelContract
from gesture_core.pose.decode import decode
from gesture_core.pose.extract import extract_poses
from gesture_core.pose.follow import Follower
from gesture_core.pose.models import find_model
from gesture_core.pose.network import NetworkBackend
from gesture_core.types import Person

GREY = np.full((96, 96, 3), 96, np.uint8)


def backend(path: Path, contract: dict[str, object] | None = None, **options: object) -> NetworkBackend:
    model = find_model(path)
    if contract:
        assert model.contract is not None
        model = replace(model, contract=replace(model.contract, **contract))  # type: ignore[arg-type]
    made: NetworkBackend = registry().make("pose", "onnx", {"threads": 1, **options}, model=model)
    return made


@pytest.mark.parametrize(("presence", "least", "found"), [(0.9, 0.5, 1), (0.2, 0.5, 0), (0.2, 0.1, 1)])
def test_heat_maps_may_come_with_a_presence(
    presence: float, least: float, found: int, tmp_path: Path
) -> None:
    maps = np.zeros((1, 19, 16, 16), np.float32)
    maps[0, :, 8, 8] = 0.8
    path = constant(tmp_path / "x.onnx", {"maps": maps, "presence": np.full((1, 1), presence)})
    people = backend(path, presence=least).estimate([GREY])[0]
    assert [round(person.presence, 3) for person in people] == [presence] * found


def test_networks_without_one_are_judged_by_their_keypoints(tmp_path: Path) -> None:
    path = dot_network(tmp_path / "dots.onnx")
    contract = {"presence": (-4.0, 8.0, 4.0), "follow": False}
    seen = backend(path, contract)
    whole = dot_picture((96, 96), FIGURE * 90 + 3, 3)
    (person,) = seen.estimate([whole])[0]
    assert person.presence > 0.9
    few = np.where(np.arange(18)[:, None] < 3, FIGURE * 90 + 3, np.nan)
    assert seen.estimate([GREY, dot_picture((96, 96), few, 3)]) == [[], []]
    # With the limit switched off, everybody is there, with their probability.
    (doubtful,) = backend(path, contract, presence=0.0).estimate([GREY])[0]
    assert doubtful.presence < 0.1


def test_a_sequence_is_empty_where_nobody_is(tmp_path: Path) -> None:
    seen = backend(dot_network(tmp_path / "dots.onnx"), {"presence": (-4.0, 8.0, 4.0), "follow": True})
    there = dot_picture((96, 96), FIGURE * 90 + 3, 3)
    frames = [(i / 10, there if i < 8 else GREY) for i in range(16)]
    (pose,) = extract_poses(frames, seen)
    assert pose.seen.any(axis=1).tolist() == [True] * 8 + [False] * 8


@pytest.mark.parametrize("wrong", [(1.0,), (1.0, 2.0, "3"), (1.0, float("nan"), 2.0)])
def test_weights_are_three_numbers(wrong: tuple[float, ...]) -> None:
    with pytest.raises(ModelError, match="presence"):
        ModelContract("openpose", presence=wrong)


def test_a_network_that_tells_people_apart_says_whether_others_are_there() -> None:
    maps = np.zeros((1, 57, 32, 32), np.float32)
    maps[0, :18, 10, 10] = 0.9
    contract = ModelContract("openpose")
    ((alone,),) = decode([maps], contract, (256, 256), "single", 0.1)
    maps[0, :18, 10, 24] = 0.8
    ((both,),) = decode([maps], contract, (256, 256), "single", 0.1)
    assert (alone.others, both.others) == (0, 1)
    ((unknown,),) = decode([maps[:, :19]], contract, (256, 256), "single", 0.1)
    assert unknown.others == 0


class Fickle:
    """Sees a person in every view, or in the ``luckily``-th one alone, less than certain that it is one."""

    name, skeleton, batch_size = "fickle", "coco18", 4

    def __init__(self, luckily: int = 0) -> None:
        self.luckily, self.looks = luckily, 0

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        found = []
        for frame in frames:
            self.looks += 1
            points = (FIGURE * 0.4 + 0.3) * (frame.shape[1], frame.shape[0])
            person = Person(points.astype(np.float32), np.ones(18, np.float32), presence=0.9)
            found.append([person] if self.luckily in (0, self.looks) else [])
        return found


def test_who_is_seen_in_one_cut_alone_is_nobody() -> None:
    film = [(i / 10, np.zeros((240, 320, 3), np.uint8)) for i in range(8)]
    assert all(Follower(Fickle()).estimate(film))
    for luckily in (1, 2, 5, 9):  # in the whole picture, in its middle, in a tile
        assert not any(Follower(Fickle(luckily)).estimate(film))


@pytest.mark.parametrize(
    ("least", "presence", "found"),
    [(0.5, 0.7, True), (0.5, 0.6, False), (0.2, 0.4, True), (0.2, 0.3, False), (0.0, 0.0, True)],
)
def test_other_cuts_must_show_more_than_the_least_presence(
    least: float, presence: float, found: bool
) -> None:
    class Doubting(Fickle):
        """As sure of a person in one view as in the other."""

        def __init__(self) -> None:
            super().__init__()
            self.presence = least

        def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
            return [[replace(one, presence=presence)] for (one,) in super().estimate(frames)]

    film = [(0.0, np.zeros((240, 320, 3), np.uint8))]
    assert [person is not None for person in Follower(Doubting()).estimate(film)] == [found]


def test_a_chance_find_among_frames_of_nobody_is_nobody() -> None:
    film = [(i / 10, np.zeros((240, 320, 3), np.uint8)) for i in range(8)]
    backend = Fickle(-1)
    follower = Follower(backend)
    assert not any(follower.estimate(film))
    backend.luckily = backend.looks + 3
    assert not any(follower.estimate(film))
    backend.luckily = 0
    assert all(follower.estimate(film))
