"""A stream of frames becomes sequences; a crop follows the person; the video is never held."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from tiny_networks import FIGURE, GREY, constant, dot_network, dot_picture, random_maps

from gesture_core.errors import ConfigError
from gesture_core.plugin import registry
from gesture_core.plugin.interfaces import Person
from gesture_core.pose.contract import ModelContract
from gesture_core.pose.extract import extract_poses, open_backend
from gesture_core.pose.follow import PAUSE, Follower
from gesture_core.pose.models import find_model
from gesture_core.pose.network import NetworkBackend
from gesture_core.settings import load_settings


def backend(path: Path, **options: object) -> NetworkBackend:
    made: NetworkBackend = registry().make("pose", "onnx", options, model=find_model(path))
    return made


def walk(count: int, size: float = 72, start: tuple[float, float] = (30, 20)) -> list[np.ndarray]:
    """Joints of a small figure that crosses a picture of 640 by 360 pixels and waves."""
    found = []
    for t in range(count):
        joints = FIGURE * size + start + (3.0 * t, 1.0 * t)
        joints[[4, 7]] += (0, -0.3 * size * np.sin(t / 3))
        found.append(joints)
    return found


def film(places: list[np.ndarray], radius: int = 3) -> list[tuple[float, np.ndarray]]:
    return [(0.04 * t, dot_picture((360, 640), joints, radius)) for t, joints in enumerate(places)]


def errors(points: np.ndarray, places: list[np.ndarray]) -> np.ndarray:
    """(T, J) distances in shoulder widths; infinite where a joint is missing."""
    distance = np.linalg.norm(points - np.stack(places), axis=2)
    width = np.linalg.norm(places[0][2] - places[0][5])
    found: np.ndarray = np.nan_to_num(distance / width, nan=np.inf)
    return found


def test_following_sees_a_person_of_a_fifth_of_the_height(tmp_path: Path) -> None:
    places = walk(40)
    network = backend(dot_network(tmp_path / "dots.onnx"))
    (still,) = extract_poses(film(places), network, follow=False)
    (followed,) = extract_poses(film(places), network, follow=True, source="walk")
    assert (errors(still.keypoints, places) < 0.5).mean() < 0.5
    assert (errors(followed.keypoints, places) < 0.2).mean() > 0.97
    assert followed.source == "walk" and followed.provenance["follow"] == "True"


def test_the_person_is_searched_once_while_they_stay(tmp_path: Path) -> None:
    follower = Follower(backend(dot_network(tmp_path / "dots.onnx")))
    frames = list(film(walk(30)))
    for start in range(0, 30, 8):
        follower.estimate(frames[start : start + 8])
    assert follower.searches == 1


def test_a_person_who_leaves_and_comes_back_elsewhere_is_found_again(tmp_path: Path) -> None:
    places = walk(16)
    nobody = np.full((12, 18, 2), np.nan)
    back = walk(16, size=120, start=(400, 150))
    (pose,) = extract_poses(
        film([*places, *nobody, *back]), backend(dot_network(tmp_path / "d.onnx")), follow=True
    )
    assert (errors(pose.keypoints[:16], places) < 0.2).mean() > 0.95
    assert not pose.seen[18:28].any()
    # The last search may have been up to `PAUSE` frames before they came back.
    late = PAUSE - 12
    assert (errors(pose.keypoints[28 + late :], back[late:]) < 0.3).mean() > 0.9


def test_someone_cut_at_the_hips_is_followed_too(tmp_path: Path) -> None:
    places = [FIGURE * 600 + (20 + t, 30) for t in range(16)]
    for joints in places:
        joints[joints[:, 1] > 355] = np.nan
    seen = ~np.isnan(places[0][:, 0])
    (pose,) = extract_poses(film(places, 16), backend(dot_network(tmp_path / "d.onnx")), follow=True)
    assert (errors(pose.keypoints, places)[:, seen] < 0.2).mean() > 0.95
    assert not pose.seen[:, ~seen].any()


def test_pictures_smaller_than_a_tile_and_empty_ones_are_survived(tmp_path: Path) -> None:
    network = backend(dot_network(tmp_path / "dots.onnx"))
    for size in ((5, 9), (40, 31), (300, 20)):
        frames = [(float(t), np.full((*size, 3), GREY, np.uint8)) for t in range(20)]
        (pose,) = extract_poses(frames, network, follow=True)
        assert len(pose) == 20 and not pose.seen.any()


def test_searches_for_nobody_are_bounded(tmp_path: Path) -> None:
    follower = Follower(backend(dot_network(tmp_path / "dots.onnx")))
    empty = [(t / 10, np.full((90, 160, 3), GREY, np.uint8)) for t in range(8)]
    for _ in range(10):
        assert all(person is None or np.isnan(person.keypoints).all() for person in follower.estimate(empty))
    assert follower.searches <= 2 + 80 / PAUSE


def test_frames_are_let_go_while_the_video_is_read(tmp_path: Path) -> None:
    alive: list[weakref.ref[np.ndarray]] = []
    most = 0

    def frames() -> Iterator[tuple[float, np.ndarray]]:
        nonlocal most
        for t in range(60):
            frame = np.full((40, 40, 3), t, np.uint8)
            alive.append(weakref.ref(frame))
            most = max(most, sum(ref() is not None for ref in alive))
            yield t / 10, frame
            del frame

    for follow in (False, True):
        alive.clear()
        extract_poses(frames(), backend(random_maps(tmp_path / "r.onnx"), batch_size=4), follow=follow)
    assert most <= 2 * 4 + 1


def test_times_size_and_provenance_are_kept(tmp_path: Path) -> None:
    times = [0.0, 0.1, 0.1, 0.4, 1.0, 1.5, 7.0, 7.0, 7.0, 8.0]
    frames = [(t, np.zeros((40, 60, 3), np.uint8)) for t in times]
    path = random_maps(tmp_path / "r.onnx")
    (pose,) = extract_poses(frames, backend(path, score=0.25), source="a.avi")
    assert pose.times.tolist() == times and pose.frame_size == (60, 40) and pose.skeleton == "coco18"
    assert pose.provenance["model_sha256"] == find_model(path).sha256
    assert pose.provenance["backend"] == "onnx" and "onnxruntime" in pose.provenance["runtime"]
    assert pose.provenance["score"] == "0.25" and pose.provenance["people"] == "single"


def test_the_choice_over_time_is_an_option_of_the_backend(tmp_path: Path) -> None:
    path = dot_network(tmp_path / "dots.onnx")
    sets = [f"pose.model={path}", "onnx.steady=false"]
    still = open_backend(load_settings(sets=sets, environment={}))
    frames = film(walk(9, size=300))
    assert extract_poses(frames, still)[0].provenance["steady"] == "False"
    assert extract_poses(frames, backend(path))[0].provenance["steady"] == "True"
    assert extract_poses(frames, still, steady=True)[0].provenance["steady"] == "True"


def test_no_frames_are_no_sequence(tmp_path: Path) -> None:
    network = backend(random_maps(tmp_path / "r.onnx"))
    assert extract_poses([], network) == [] and extract_poses(iter([]), network, "multi") == []


def test_other_skeletons_become_coco(tmp_path: Path) -> None:
    maps = np.zeros((1, 26, 16, 16), np.float32)
    maps[0, :25, 5, 9] = 0.9
    frames = [(0.0, np.zeros((64, 64, 3), np.uint8))] * 3
    (pose,) = extract_poses(frames, backend(constant(tmp_path / "x.onnx", {"maps": maps})))
    assert pose.skeleton == "body25" and pose.onto("coco18").seen.all()


class Two:
    """A backend that is no network: it sees two people, the second one from frame 10 on."""

    skeleton = "coco18"
    batch_size = 4

    def __init__(self) -> None:
        self.frame = 0

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        found = []
        for _ in frames:
            first = Person(FIGURE * 50 + self.frame, np.full(18, 0.9))
            second = Person(FIGURE * 50 + (300, 0), np.full(18, 0.8))
            found.append([second, first] if self.frame >= 10 else [first])
            self.frame += 1
        return found


def test_every_person_is_a_sequence_of_their_own() -> None:
    frames = [(t / 10, np.zeros((400, 400, 3), np.uint8)) for t in range(24)]
    first, second = extract_poses(frames, Two(), "multi")
    assert (first.person, len(first), second.person, len(second)) == (0, 24, 1, 14)
    assert second.times[0] == 1.0 and second.times[-1] == 2.3
    np.testing.assert_allclose(first.keypoints[20], FIGURE * 50 + 20, rtol=1e-6)
    (best,) = extract_poses(frames, Two())
    assert len(best) == 24


class Able(Two):
    """The same with every optional ability."""

    follow, crop, steady = True, 2.0, False
    provenance: ClassVar[dict[str, str]] = {"made_by": "hand"}


def test_what_a_backend_can_do_beside_finding_people_is_asked_of_it() -> None:
    frames = [(t / 10, np.zeros((400, 400, 3), np.uint8)) for t in range(6)]
    (plain,), (able,) = extract_poses(frames, Two()), extract_poses(frames, Able())
    assert plain.provenance == {"people": "single", "follow": "False", "steady": "True"}
    assert able.provenance == {"people": "single", "follow": "True", "steady": "False", "made_by": "hand"}
    assert Follower(Able()).size == 2.0 and Follower(Two()).size == ModelContract.crop
    chosen = extract_poses(frames, Able(), follow=False, steady=True)[0].provenance
    assert (chosen["follow"], chosen["steady"]) == ("False", "True")


def test_settings_choose_the_backend_and_its_options(tmp_path: Path) -> None:
    path = dot_network(tmp_path / "free.onnx", side=None)
    sets = [f"pose.model={path}", "pose.height=96", "pose.score=0.3", "opencv-dnn.batch_size=3"]
    for name, batch in (("onnx", 8), ("opencv-dnn", 3)):
        found = open_backend(load_settings(sets=[*sets, f"pose.backend={name}"], environment={}))
        assert isinstance(found, NetworkBackend)
        assert (found.name, found.score, found.height, found.batch_size) == (name, 0.3, 96, batch)
    fixed = dot_network(tmp_path / "fixed.onnx", side=64)
    for height, name in ((64, "onnx"), (96, "onnx"), (96, "opencv-dnn")):
        asked = [f"pose.model={fixed}", f"pose.height={height}", f"pose.backend={name}"]
        with nullcontext() if height == 64 else pytest.raises(ConfigError, match="64x64 alone"):
            open_backend(load_settings(sets=asked, environment={}))
    plain = open_backend(load_settings(sets=[f"pose.model={path}"], environment={}))
    assert isinstance(plain, NetworkBackend)
    assert plain.height is None and plain.provenance["height"] == str(plain.contract.default_size)


@pytest.mark.parametrize("option", ["pose.score=0.3", "pose.height=96"])
def test_what_the_backend_does_not_take_is_not_dropped_without_a_word(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = dot_network(tmp_path / "free.onnx", side=None)
    monkeypatch.setattr(type(registry()), "takes", lambda self, kind, name, key: key == "threads")
    with pytest.raises(ConfigError, match=f"{option.partition('=')[0]} is nothing to the pose backend onnx"):
        open_backend(load_settings(sets=[f"pose.model={path}", "pose.backend=onnx", option], environment={}))
