"""Result lists of AlphaPose, COCO's tools and MMPose: one JSON file a clip, drawn as each tool writes it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames import person
from gesture_pose_files.openpose_json import OpenPoseJsonReader
from gesture_pose_files.result_list import ResultListReader
from json_fuzz import fuzz
from outcomes import check as outcome_of

from gesture_core.errors import KeypointError
from gesture_core.plugin.interfaces import KeypointReader
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import COCO18
from gesture_core.testing import READER_CHECKS

FRAMES = 12
BODIES = [person(17, (100 + 3 * number, 50), seed=1) for number in range(FRAMES)]


def flat(body: np.ndarray) -> list[float]:
    return [round(float(value), 3) for value in body.reshape(-1)]


def alphapose(bodies: list[np.ndarray], name: str = "{}.jpg") -> list[dict[str, Any]]:
    return [
        {"image_id": name.format(number), "category_id": 1, "keypoints": flat(body), "score": 2.9,
         "box": [1.0, 2.0, 3.0, 4.0], "idx": [0.0]}
        for number, body in enumerate(bodies)
    ]  # fmt: skip


def mmpose(bodies: list[np.ndarray]) -> list[dict[str, Any]]:
    return [
        {"frame_id": number, "instances": [
            {"keypoints": body[:, :2].tolist(), "keypoint_scores": body[:, 2].tolist(),
             "bbox": [[0.0, 0.0, 9.0, 9.0]], "bbox_score": 0.9}]}
        for number, body in enumerate(bodies)
    ]  # fmt: skip


def coco18(body: np.ndarray) -> np.ndarray:
    """AlphaPose's own change of COCO-17 into OpenPose's 18 joints."""
    neck = (body[5] + body[6]) / 2
    return np.vstack([body, neck])[[0, 17, 6, 8, 10, 5, 7, 9, 12, 14, 16, 11, 13, 15, 2, 1, 4, 3]]


def by_image(key: str, joints: str) -> dict[str, Any]:
    return {
        f"{n}.jpg": {"version": "AlphaPose v0.3", key: [{joints: flat(coco18(body))}]}
        for n, body in enumerate(BODIES)
    }


def annotated() -> dict[str, Any]:
    entries = []
    for number, body in enumerate(BODIES):
        marked = np.column_stack([body[:, :2], np.full(17, 2)])
        marked[3] = 0, 0, 0
        entries.append(
            {"id": 9 - number, "image_id": 50 + number, "category_id": 1, "keypoints": flat(marked)}
        )
    images = [
        {"id": 50 + n, "file_name": f"clips/wave/{n:06d}.jpg", "width": 800, "height": 600}
        for n in range(FRAMES)
    ]
    return {
        "info": {},
        "images": images[::-1],
        "annotations": entries,
        "categories": [{"keypoints": ["nose"]}],
    }


FORMS: dict[str, tuple[Any, str]] = {
    "alphapose": (alphapose(BODIES)[::-1], "coco17"),
    "alphapose of pictures": (alphapose(BODIES, "wave_{:05d}.png"), "coco17"),
    "alphapose open": (by_image("people", "pose_keypoints_2d"), "coco18"),
    "alphapose cmu": (by_image("bodies", "joints"), "coco18"),
    "coco results": ([{**e, "image_id": n} for n, e in enumerate(alphapose(BODIES))], "coco17"),
    "coco annotations": (annotated(), "coco17"),
    "mmpose": (mmpose(BODIES), "coco17"),
    "mmpose with meta": (
        {"meta_info": {"dataset_name": "coco", "num_keypoints": 17}, "instance_info": mmpose(BODIES)},
        "coco17",
    ),
}


def write(path: Path, tree: Any) -> Path:
    path.write_text(json.dumps(tree))
    return path


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_one_clip(tmp_path: Path, form: str) -> None:
    tree, kind = FORMS[form]
    path, reader = write(tmp_path / "wave_0.json", tree), ResultListReader(ReadOptions(fps=10))
    assert reader.accepts(path) and reader.members(path) == [""]
    assert not OpenPoseJsonReader().accepts(tmp_path), "its number is that of a clip, not of a frame"
    (sequence,) = reader.read(path)
    assert sequence.skeleton == kind
    np.testing.assert_allclose(sequence.times, np.arange(FRAMES) / 10)
    wanted = [coco18(body) if kind == "coco18" else body for body in BODIES]
    seen = sequence.seen
    np.testing.assert_allclose(
        sequence.keypoints[seen], np.array(wanted)[..., :2][seen], atol=2e-3
    )  # three digits
    if form == "coco annotations":
        assert not seen[:, 3].any() and sequence.frame_size == (800, 600)
        assert (sequence.scores[seen] == 1).all() and "visibility" in sequence.provenance["notes"]
    else:
        assert seen.all()
        np.testing.assert_allclose(sequence.scores, np.array(wanted)[..., 2], atol=1e-3)
    assert sequence.provenance["assumed"] == f"order={kind}, unit=pixels"


def test_images_are_in_the_order_of_their_numbers_and_empty_ones_count(tmp_path: Path) -> None:
    """AlphaPose leaves out images without people: frames 3 and 4 here."""
    entries = [entry for n, entry in enumerate(alphapose(BODIES)) if n not in (3, 4)]
    (sequence,) = ResultListReader().read(write(tmp_path / "a.json", sorted(entries, key=str)))
    assert len(sequence) == FRAMES and sequence.frames_with_pose == FRAMES - 2
    np.testing.assert_allclose(sequence.keypoints[10, 0], BODIES[10][0, :2], atol=2e-3)
    assert not sequence.seen[3:5].any()
    every_third = [{**entry, "image_id": f"{3 * n}.jpg"} for n, entry in enumerate(alphapose(BODIES))]
    (sequence,) = ResultListReader(ReadOptions(fps=30)).read(write(tmp_path / "b.json", every_third))
    assert len(sequence) == FRAMES
    np.testing.assert_allclose(np.diff(sequence.times), 0.1)


@pytest.mark.parametrize("key", ["idx", "track_id"])
def test_people_by_their_track(tmp_path: Path, key: str) -> None:
    """Two people change places; the list says who is who."""
    entries = []
    for number in range(FRAMES):
        for identity in (3, 8):
            at = 500 if (identity == 3) == (number < 6) else 0
            body = person(17, (at, 0), seed=identity)
            entries.append({"image_id": f"{number}.jpg", "keypoints": flat(body), key: [float(identity)]})
    path = write(tmp_path / "two.json", entries)
    found = ResultListReader(people="multi").read(path)
    assert len(found) == 2
    for sequence in found:
        assert sequence.frames_with_pose == FRAMES
        assert abs(np.diff(sequence.keypoints[:, 0, 0])[5]) == pytest.approx(500, abs=0.01)
    assert len(ResultListReader().read(path)) == 1


def test_several_clips_in_one_list(tmp_path: Path) -> None:
    entries = alphapose(BODIES, "clap/{:04d}.jpg") + alphapose(BODIES[:5], "wave/{:04d}.jpg")
    path, reader = write(tmp_path / "all.json", entries), ResultListReader()
    assert reader.members(path) == ["clap", "wave"]
    assert [len(reader.read(path, name)[0]) for name in reader.members(path)] == [FRAMES, 5]
    with pytest.raises(KeypointError) as caught:
        reader.read(path)
    assert caught.value.code == "E_KEYPOINTS_MEMBER"


def test_scores_of_networks_above_one_are_brought_down(tmp_path: Path) -> None:
    bodies = [body * [1, 1, 4] for body in BODIES]
    (sequence,) = ResultListReader().read(write(tmp_path / "simcc.json", mmpose(bodies)))
    assert sequence.scores.max() == pytest.approx(1) and "divided" in sequence.provenance["notes"]


def test_a_bad_entry_costs_its_frame(tmp_path: Path) -> None:
    entries = alphapose(BODIES)
    entries[4]["keypoints"] = entries[4]["keypoints"][:40]
    (sequence,) = ResultListReader().read(write(tmp_path / "a.json", entries))
    assert sequence.frames_with_pose == FRAMES - 1
    assert sequence.provenance["lost"].startswith("1 of 12 frames cannot be read: ")
    assert "4.jpg" in sequence.provenance["lost"]


def test_a_list_without_anybody_is_a_clip_without_anybody(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", [])
    assert ResultListReader().accepts(path) and ResultListReader().read(path) == []


BAD_LISTS: dict[str, tuple[Any, str]] = {
    "another tool": ({"name": "x"}, "E_KEYPOINTS_FORMAT"),
    "numbers": ([1, 2], "E_KEYPOINTS_FORMAT"),
    "boxes only": ([{"image_id": 1, "bbox": [1, 2, 3, 4]}] * 3, "E_KEYPOINTS_FORMAT"),
    "images without numbers": (
        [{"image_id": name, "keypoints": flat(BODIES[0])} for name in ("a.jpg", "b.jpg")],
        "E_KEYPOINTS_FORMAT",
    ),
    "unrelated pictures": (
        [{"image_id": number, "keypoints": flat(BODIES[0])} for number in (139, 285, 632, 1000)],
        "E_KEYPOINTS_TIMES",
    ),
    "an image that is a list": ([{"image_id": [1], "keypoints": flat(BODIES[0])}], "E_KEYPOINTS_FORMAT"),
    "sixteen joints": ([{"image_id": 1, "keypoints": [1.0] * 48}], "E_KEYPOINTS_FORMAT"),
}


@pytest.mark.parametrize("kind", BAD_LISTS)
def test_a_bad_list_is_a_typed_error(tmp_path: Path, kind: str) -> None:
    tree, code = BAD_LISTS[kind]
    path = write(tmp_path / "x.json", tree)
    with pytest.raises(KeypointError) as caught:
        ResultListReader().read(path)
    assert caught.value.code == code and "x.json" in caught.value.subject


def test_a_list_that_is_cut_is_no_json(tmp_path: Path) -> None:
    path = write(tmp_path / "x.json", alphapose(BODIES))
    path.write_text(path.read_text()[:-200])
    assert ResultListReader().accepts(path)
    with pytest.raises(KeypointError) as caught:
        ResultListReader().read(path)
    assert caught.value.code == "E_KEYPOINTS_JSON"


@pytest.mark.parametrize("text", ["", "{}", '{"a": 1}', "[1, 2]", '[{"bbox": [1]}]', "\x00\x01"])
def test_other_json_is_not_taken(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    assert not ResultListReader().accepts(tmp_path / "x.json")


def test_an_order_that_the_list_names(tmp_path: Path) -> None:
    """Human3.6M has 17 joints too, in another order; CrowdPose has 14, which no number tells."""
    crowdpose = [
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
        "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "top_head", "neck",
    ]  # fmt: skip
    h36m = [
        "root", "right_hip", "right_knee", "right_foot", "left_hip", "left_knee", "left_foot", "spine",
        "thorax", "neck_base", "head", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder",
        "right_elbow", "right_wrist",
    ]  # fmt: skip
    for names in (crowdpose, h36m):
        bodies = [person(len(names), (number, 0), seed=2) for number in range(FRAMES)]
        meta = {"keypoint_id2name": {str(n): name for n, name in enumerate(names)}}
        tree = {"meta_info": meta, "instance_info": mmpose(bodies)}
        (sequence,) = ResultListReader().read(write(tmp_path / "a.json", tree))
        assert sequence.skeleton == "coco18" and "order" not in sequence.provenance["assumed"]
        for joint in ("left_elbow", "right_wrist", "left_hip"):
            found = sequence.keypoints[:, COCO18.index(joint)]
            wanted = [body[names.index(joint), :2] for body in bodies]
            np.testing.assert_allclose(found, wanted, rtol=1e-5)


@pytest.mark.parametrize("check", READER_CHECKS)
@pytest.mark.parametrize("form", ["alphapose", "mmpose with meta", "coco annotations"])
def test_the_reader_keeps_the_contract(
    tmp_path: Path, form: str, check: Callable[[KeypointReader, Path], None]
) -> None:
    check(ResultListReader(), write(tmp_path / "clip.json", FORMS[form][0]))


def test_broken_lists(tmp_path: Path) -> None:
    """Lists whose bytes, values and structure are broken: a sequence or a typed error, cheaply."""
    sound = [json.dumps(tree).encode() for tree, _ in FORMS.values()]
    path = tmp_path / "x.json"
    outcomes = []
    for number in range(300):
        path.write_bytes(fuzz(sound, f"lists:{number}"))
        outcomes.append(outcome_of(ResultListReader(), path))
    assert outcomes.count("ok") > 10 and {"E_KEYPOINTS_JSON", "E_KEYPOINTS_FORMAT"} <= set(outcomes)
