"""The overlay is drawn where the joints are, and written as a video with real times, or as a strip."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_networks import FIGURE, GREY, dot_network, dot_picture

from gesture_core.cli.main import run
from gesture_core.errors import MediaError
from gesture_core.pose.overlay import cropped, draw_pose, overlay, side_colour, write_strip
from gesture_core.skeletons import COCO18, SKELETONS
from gesture_core.types import PoseSequence
from gesture_core.video.writer import write_video

TIMES = [0.0, 0.04, 0.1, 0.5, 0.5, 1.25]


def frames(size: tuple[int, int] = (121, 161)) -> list[tuple[float, np.ndarray]]:
    return [(t, np.full((*size, 3), 40 * i, np.uint8)) for i, t in enumerate(TIMES)]


def pose(first: int = 0) -> PoseSequence:
    count = len(TIMES) - first
    points = np.stack([FIGURE * 100 + (20 + 5 * t, 10) for t in range(count)])
    return PoseSequence(points, np.ones((count, 18)), np.array(TIMES[first:]))


def test_each_side_has_its_colour_and_missing_joints_are_left_out() -> None:
    points = FIGURE * 100 + (10, 10)
    points[7] = np.nan
    picture = np.zeros((120, 120, 3), np.uint8)
    draw_pose(picture, points, COCO18)
    x, y = np.rint(points[COCO18.index("right_wrist")]).astype(int)
    assert tuple(picture[y, x]) == side_colour("right_wrist") == (0, 159, 230)
    x, y = np.rint(points[COCO18.index("left_elbow")]).astype(int)
    assert tuple(picture[y, x]) == side_colour("left_elbow") == (233, 180, 86)
    x, y = np.rint(FIGURE[7] * 100 + (10, 10)).astype(int)
    assert not picture[y, x].any()


@pytest.mark.parametrize("name", SKELETONS)
def test_every_skeleton_can_be_drawn_even_outside_the_picture(name: str) -> None:
    joints = len(SKELETONS[name].joints)
    picture = np.zeros((50, 50, 3), np.uint8)
    draw_pose(picture, np.random.default_rng(0).uniform(-100, 150, (joints, 2)), SKELETONS[name])
    assert picture.any()
    draw_pose(picture, np.full((joints, 2), np.nan), SKELETONS[name])


def test_people_appear_at_their_own_times_and_frames_stay_untouched() -> None:
    given = frames()
    drawn = list(overlay(given, [pose(), pose(first=3)]))
    assert [time for time, _ in drawn] == TIMES
    changed = [
        (picture != frame).any(axis=2).sum() for (_, picture), (_, frame) in zip(drawn, given, strict=True)
    ]
    assert all(changed) and min(changed[3:]) > 0
    alone = [picture for _, picture in overlay(given, [pose(first=3)])]
    assert all((alone[i] == given[i][1]).all() for i in range(3))
    assert all((alone[i] != given[i][1]).any() for i in range(3, 6))
    assert all((frame == 40 * i).all() for i, (_, frame) in enumerate(given))


def test_times_that_were_rounded_on_their_way_are_the_same_times() -> None:
    exact = [picture for _, picture in overlay(frames(), [pose()])]
    rounded = [(float(np.float32(t)) + 1e-7, frame) for t, frame in frames()]
    for (_, picture), wanted in zip(overlay(rounded, [pose()]), exact, strict=True):
        assert (picture == wanted).all()


def test_a_frame_that_does_not_come_again_costs_its_own_pose_only() -> None:
    given = frames()
    drawn = [picture for _, picture in overlay(given[:1] + given[2:], [pose()])]
    whole = [picture for _, picture in overlay(given, [pose()])]
    for picture, wanted in zip(drawn, whole[:1] + whole[2:], strict=True):
        assert (picture == wanted).all()


def test_a_video_keeps_the_times_of_its_frames(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "out.mp4"
    assert write_video(frames(), path) == len(TIMES)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.width, stream.height) == ("h264", 160, 120)
        decoded = [
            (float(picture.time), picture.to_ndarray(format="gray")) for picture in container.decode(stream)
        ]
    times = [time for time, _ in decoded]
    assert len(times) == len(TIMES) and times == sorted(set(times))
    np.testing.assert_allclose(times, TIMES, atol=1e-3)
    assert decoded[5][1].mean() > decoded[0][1].mean() + 100
    assert list(tmp_path.iterdir()) == [path]


def test_a_failure_leaves_no_half_a_video(tmp_path: Path) -> None:
    pytest.importorskip("av")

    def broken() -> Iterator[tuple[float, np.ndarray]]:
        yield frames()[0]
        raise RuntimeError("the reader failed")

    with pytest.raises(RuntimeError):
        write_video(broken(), tmp_path / "out.mp4")
    with pytest.raises(MediaError, match="E_MEDIA_WRITE"):
        write_video([], tmp_path / "out.mp4")
    with pytest.raises(MediaError, match="E_MEDIA_WRITE"):
        write_strip([], tmp_path / "out.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("count", [1, 7, 8, 100])
def test_a_strip_shows_the_beginning_and_the_end(count: int, tmp_path: Path) -> None:
    import cv2

    pictures = ((float(i), np.full((60, 80, 3), 2 * i, np.uint8)) for i in range(count))
    assert write_strip(pictures, tmp_path / "out.png", pictures=8, height=30) == count
    strip = cv2.imread(str(tmp_path / "out.png"))
    assert strip is not None
    assert strip.shape == (30, 40 * min(count, 8), 3)
    shown = strip[0, ::40, 0].astype(int)
    assert (np.diff(shown) > 0).all() and shown[0] == 0 and shown[-1] >= 2 * 0.8 * (count - 1)


def test_a_strip_shows_the_moments_that_are_wanted(tmp_path: Path) -> None:
    import cv2

    for wanted, shown in (
        ([80.0, 3.5, 40.0, 40.2], [4, 40, 41, 80]),
        ([12.0, 99.4, 99.8], [12, 99]),  # of frames that were thinned out the last one is before the moment
        ([120.0], [99]),
        (list(range(50)), 8),
    ):
        pictures = ((float(i), np.full((60, 80, 3), 2 * i, np.uint8)) for i in range(100))
        assert write_strip(pictures, tmp_path / "out.png", pictures=8, height=30, moments=wanted) == 100
        strip = cv2.imread(str(tmp_path / "out.png"))
        assert strip is not None
        seen = (strip[0, ::40, 0] // 2).tolist()
        assert seen == shown if isinstance(shown, list) else len(seen) == shown and seen[-1] == 49


def test_the_command_renders_a_video(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("av")
    monkeypatch.chdir(tmp_path)
    network = dot_network(tmp_path / "dots.onnx")
    moving = [(t / 10, dot_picture((240, 320), FIGURE * 180 + (40 + 2 * t, 30), 6)) for t in range(12)]
    write_video(moving, tmp_path / "in.mp4", quality=8)
    assert run(["render", "in.mp4", "--model", str(network)]) == 0
    assert "12 frames, 1 person in 12 of them" in capsys.readouterr().out
    assert (tmp_path / "in-pose.mp4").stat().st_size > 1000
    assert run(["render", "in.mp4", "--model", str(network)]) != 0
    assert "E_EXISTS" in capsys.readouterr().err
    assert run(["render", "in.mp4", "--model", str(network), "--overwrite"]) == 0
    assert run(["render", "in.mp4", "--model", str(network), "--out", "a.png"]) == 0
    assert run(["render", "in.mp4", "--model", str(network), "--out", "in.mp4", "--overwrite"]) != 0
    assert run(["render", "in.mp4", "--model", str(network), "--out", "a.gif"]) == 2
    assert run(["render", "in.mp4", "--model", str(network), "--people", "both", "--out", "b.png"]) == 2
    assert "single or multi" in capsys.readouterr().err
    (tmp_path / "points.csv").write_text("1,2\n")
    assert run(["render", "points.csv", "--model", str(network)]) == 2
    assert "is not one video" in capsys.readouterr().err
    write_video([(t, np.full_like(frame, GREY)) for t, frame in moving], tmp_path / "dark.mp4")
    assert run(["render", "dark.mp4", "--model", str(network)]) == 1
    assert "E_NO_PERSON" in capsys.readouterr().err


def test_a_video_is_no_darker_than_what_it_is_made_of_and_says_its_matrix(tmp_path: Path) -> None:
    import cv2

    av = pytest.importorskip("av")
    rng = np.random.default_rng(0)
    patches = np.kron(rng.integers(0, 256, (6, 8, 3)), np.ones((32, 32, 1))).astype(np.uint8)
    write_video([(0.0, patches)], tmp_path / "patches.mp4", quality=1)
    with av.open(str(tmp_path / "patches.mp4")) as container:
        stream = container.streams.video[0]
        (frame,) = container.decode(stream)
        assert [int(one) for one in (frame.color_range, frame.colorspace)] == [1, 6]
    seen = cv2.cvtColor(frame.to_ndarray(), cv2.COLOR_YUV2BGR_I420).astype(float)
    assert np.abs((seen - patches).mean(axis=(0, 1))).max() < 0.6


def test_tags_say_who_it_is_and_when() -> None:
    given = frames((240, 320))
    plain = [picture for _, picture in overlay(given, [pose()])]
    tags = [lambda _: "0 wave 0.41", lambda _: "1 Grüße"]
    tagged = [picture for _, picture in overlay(given, [pose(), pose(first=3)], tags)]
    assert all((one != other).any() for one, other in zip(plain, tagged, strict=True))
    green = (np.array(tagged[0]) == (115, 158, 0)).all(axis=2)
    assert green.any() and not (np.array(plain[0]) == (115, 158, 0)).all(axis=2).any()


def test_a_strip_is_cropped_to_the_people() -> None:
    given = frames((400, 600))
    left, top, right, bottom = (int(edge) for edge in pose().box)
    for _, picture in cropped(given, [pose()], margin=0.1)[0]:
        assert picture.shape[0] < 1.3 * (bottom - top) + 4 and picture.shape[1] < right - left + 40
    numbered = np.arange(400 * 600 * 3, dtype=np.uint32).reshape(400, 600, 3)
    at, (moved,) = cropped([(0.0, numbered)], [pose()], margin=0)
    ((_, exact),) = at
    assert np.nanmin(moved.keypoints, axis=(0, 1)) == pytest.approx((0, 0), abs=1)
    assert exact[0, 0, 0] == (top * 600 + left) * 3


def test_a_strip_has_its_size_before_anything_is_written_into_it() -> None:
    one = replace(pose(), frame_size=(600, 400))
    parts, (near,) = cropped(frames((400, 600)), [one])
    scaled, (grown,) = cropped(frames((400, 600)), [one], height=300)
    plain, large = next(parts)[1], next(scaled)[1]
    scale = 300 / plain.shape[0]
    assert large.shape[:2] == (300, round(plain.shape[1] * scale))
    assert np.allclose(grown.keypoints, near.keypoints * scale, equal_nan=True)


def test_what_is_written_above_a_person_is_inside_of_the_strip() -> None:
    around, moved = cropped(frames((400, 600)), [pose()])
    tagged = list(overlay(around, moved, [lambda _: "0 wave 0.12"]))
    colour = (115, 158, 0)
    for _, picture in tagged[:2]:
        tag = (picture == colour).all(axis=2)
        line = np.flatnonzero(tag.sum(axis=1) > 0.6 * picture.shape[1])
        assert len(line) >= 5, "the ground of the text lies in the picture"
