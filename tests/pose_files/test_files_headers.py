"""Names of joints in the wild, and skeletons that are a part of what is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tables import COCO17, COCO18, FRAMES, flat, named, person, read, refused, same, save

from gesture_core.joint_names import joint_named
from gesture_core.skeletons import BLAZEPOSE33, SKELETONS, Skeleton

UPPER = ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist")


def camel(joint: str) -> str:
    first, *rest = joint.split("_")
    return first + "".join(word.title() for word in rest)


def side_last(joint: str) -> str:
    side, _, part = joint.partition("_")
    return f"{part}_{side[0]}" if side in ("left", "right") else joint


def initial(joint: str) -> str:
    side, _, part = joint.partition("_")
    return f"{side[0].upper()}{part.title()}" if side in ("left", "right") else joint.title()


SPELLINGS: dict[str, Callable[[str], str]] = {
    "ours": lambda joint: joint,
    "LShoulder": initial,
    "shoulder_l": side_last,
    "L_SHOULDER": lambda joint: joint.replace("left_", "l_").replace("right_", "r_").upper(),
    "leftShoulder": camel,
    "Left Shoulder": lambda joint: joint.replace("_", " ").title(),
    "left-shoulder": lambda joint: joint.replace("_", "-"),
    "LEFT_SHOULDER": str.upper,
    "lshoulder": lambda joint: joint.replace("left_", "l").replace("right_", "r"),
    "shoulderLeft": lambda joint: camel("_".join(joint.split("_")[::-1])),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize("body", SKELETONS.values(), ids=lambda body: body.name)
def test_every_joint_is_known_in_every_spelling(spelling: str, body: Skeleton) -> None:
    for joint in body.joints:
        if joint.startswith("face_") or "_pose_" in joint:
            continue  # a number, or one of two of a name
        if spelling in ("lshoulder", "shoulderLeft", "shoulder_l", "LShoulder") and (
            joint.count("_") > 1 or not joint.startswith(("left_", "right_"))
        ):
            continue  # of two words, or without a side
        assert joint_named(SPELLINGS[spelling](joint)) == joint


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize("suffix", ["{}_{}", "{}.{}", "{} {}", "{}-{}"])
@pytest.mark.parametrize("upper", [False, True])
def test_columns_in_every_spelling(tmp_path: Path, spelling: str, suffix: str, upper: bool) -> None:
    points = person(COCO17.joints)
    axes = "XY" if upper else "xy"
    header = [suffix.format(SPELLINGS[spelling](joint), axis) for joint in COCO17.joints for axis in axes]
    (pose,) = read(save(tmp_path / "k.csv", header, flat(points)))
    assert pose.skeleton == "coco17" and "notes" not in pose.provenance
    same(pose, points, COCO17.joints)
    assert np.isfinite(pose.onto("coco18").keypoints[:, COCO18.index("neck")]).all()
    assert pose.provenance["assumed"] == "unit=pixels, fps=30"


@pytest.mark.parametrize(
    "score", ["score", "confidence", "conf", "likelihood", "visibility", "c", "v", "prob", "Likelihood"]
)
def test_scores_by_every_name(tmp_path: Path, score: str) -> None:
    header = [f"{joint}_{part}" for joint in UPPER for part in ("x", "y", score)]
    points = person(UPPER)
    rows = np.concatenate([points, np.full((FRAMES, len(UPPER), 1), 0.25)], axis=2).reshape(FRAMES, -1)
    text = ",".join(header) + "\n" + "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "k.csv").write_text(text)
    (pose,) = read(tmp_path / "k.csv")
    np.testing.assert_allclose(pose.scores[:, COCO18.index("left_wrist")], 0.25)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ([joint for joint in COCO17.joints for _ in "xy"], ["x", "y"] * 17),
        ([cell for joint in COCO17.joints for cell in (joint, "")], ["x", "y"] * 17),
        (["x", "y"] * 17, [joint for joint in COCO17.joints for _ in "xy"]),
    ],
    ids=["repeated", "spanning", "turned"],
)
def test_two_rows_of_names(tmp_path: Path, first: list[str], second: list[str]) -> None:
    points = person(COCO17.joints)
    (pose,) = read(save(tmp_path / "k.csv", first, [second, *flat(points)]))
    assert pose.skeleton == "coco17" and len(pose) == FRAMES
    same(pose, points, COCO17.joints)


def test_three_rows_of_names_of_which_one_tells_nothing(tmp_path: Path) -> None:
    points = person(UPPER)
    head = [
        ["model", *["net"] * 12],
        ["joint", *[j for j in UPPER for _ in "xy"]],
        ["coords", *["x", "y"] * 6],
    ]
    rows = [[number, *row] for number, row in enumerate(flat(points))]
    (pose,) = read(save(tmp_path / "k.csv", head[0], [*head[1:], *rows]))
    same(pose, points, UPPER)


SUBSETS = {
    "upper body": (UPPER, "ankles"),
    "one arm": (("left_shoulder", "right_shoulder", "right_elbow", "right_wrist"), "left wrist"),
    "neck and hips": (("neck", "right_wrist", "right_elbow", "left_hip", "right_hip"), "shoulders"),
}


@pytest.mark.parametrize("kind", SUBSETS)
def test_a_part_of_a_skeleton_is_enough_and_the_rest_is_named(tmp_path: Path, kind: str) -> None:
    joints, lacking = SUBSETS[kind]
    points = person(joints)
    (pose,) = read(save(tmp_path / "k.csv", named(joints), flat(points)))
    same(pose, points, joints)
    found = pose.onto("coco18").seen[:, COCO18.index("neck")]
    assert found.all() and "not in the file and not compared: nose" in pose.provenance["notes"]
    assert lacking in pose.provenance["notes"]
    assert not pose.onto("coco18").seen[:, COCO18.index("left_ankle")].any()


def test_hips_and_hands_stand_in(tmp_path: Path) -> None:
    joints = ("left_shoulder", "right_shoulder", "left_wrist", "right_wrist", "left_hip")
    points = person(joints)
    header = named(("LShoulder", "RShoulder", "LHand", "RHand", "pelvis"))
    (pose,) = read(save(tmp_path / "k.csv", header, flat(points)))
    same(pose, points, joints)
    same(pose, points[:, [4]], ("right_hip",))


def test_joints_without_an_origin_are_refused(tmp_path: Path) -> None:
    error = refused(save(tmp_path / "k.csv", named(("left_wrist", "right_wrist")), [[1, 2, 3, 4]]))
    assert error.code == "E_KEYPOINTS_SKELETON" and "neither a neck nor both shoulders" in error.cause


@pytest.mark.parametrize("form", ["{1}_{0}", "{1}{0}", "{0}_{1}", "kp{0}_{1}", "{1}.{0}", "keypoint_{0}_{1}"])
@pytest.mark.parametrize("start", [0, 1])
def test_numbered_joints(tmp_path: Path, form: str, start: int) -> None:
    points = person(COCO17.joints)
    header = [form.format(number + start, axis) for number in range(17) for axis in "xy"]
    (pose,) = read(
        save(tmp_path / "k.csv", ["frame", *header], [[f, *r] for f, r in enumerate(flat(points))])
    )
    assert pose.skeleton == "coco17"
    same(pose, points, COCO17.joints)
    assert pose.provenance["assumed"] == "order=coco17, unit=pixels, fps=30"


def test_numbered_joints_of_no_known_number_need_an_order(tmp_path: Path) -> None:
    points = person(UPPER)
    header = [f"x{n}" for n in range(6)] + [f"y{n}" for n in range(6)]
    rows = [[*row[::2], *row[1::2]] for row in flat(points)]
    path = save(tmp_path / "k.csv", header, rows)
    assert "keypoints.order" in refused(path).remedy
    (pose,) = read(path, order=UPPER)
    same(pose, points, UPPER)
    (bare,) = read(save(tmp_path / "b.csv", None, flat(points)), order=UPPER)
    same(bare, points, UPPER)


def test_landmarks_with_depth_and_visibility(tmp_path: Path) -> None:
    header = [f"{axis}{n}" for n in range(1, 34) for axis in "xyzv"]
    rows = np.random.default_rng(0).uniform(0.2, 0.8, (FRAMES, 132))
    text = ",".join(header) + "\n" + "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "k.csv").write_text(text)
    (pose,) = read(tmp_path / "k.csv")
    assert pose.skeleton == "blazepose33" and "depth (z)" in pose.provenance["notes"]
    np.testing.assert_allclose(pose.scores, rows.reshape(FRAMES, 33, 4)[..., 3], rtol=1e-5)
    names = [
        f"{joint.upper()}_{part}" for joint in BLAZEPOSE33.joints for part in ("x", "y", "z", "visibility")
    ]
    names = [name.replace("LEFT_MOUTH", "MOUTH_LEFT").replace("RIGHT_MOUTH", "MOUTH_RIGHT") for name in names]
    (tmp_path / "n.csv").write_text(text.replace(",".join(header), ",".join(names)))
    np.testing.assert_array_equal(read(tmp_path / "n.csv")[0].keypoints, pose.keypoints)


@pytest.mark.parametrize("labels", ["names", "numbers"])
@pytest.mark.parametrize("people", [False, True])
def test_a_row_for_each_joint(tmp_path: Path, labels: str, people: bool) -> None:
    points = person(COCO17.joints)
    rows = [
        [f, *([p] if people else []), joint if labels == "names" else n, *(points[f, n] + 200 * p), 0.5]
        for f in range(FRAMES)
        for p in range(1 + people)
        for n, joint in enumerate(COCO17.joints)
    ]
    header = ["frame", *(["person"] if people else []), "keypoint", "x", "y", "confidence"]
    path = tmp_path / "k.csv"
    path.write_text("\n".join(",".join(map(str, row)) for row in [header, *rows]))
    found = read(path, "multi")
    assert len(found) == 1 + people
    same(found[0], points, COCO17.joints)
    assert found[0].skeleton == "coco17" and (found[0].scores == 0.5).all()


def test_a_row_for_each_joint_of_two_people_needs_a_column(tmp_path: Path) -> None:
    rows = [[f, j, 10 * n + p, 5] for f in range(3) for p in (0, 50) for n, j in enumerate(UPPER)]
    error = refused(save(tmp_path / "k.csv", ["frame", "joint", "x", "y"], rows))
    assert "twice" in error.cause and "person" in error.remedy


KINECT2 = (
    "SpineBase SpineMid Neck Head ShoulderLeft ElbowLeft WristLeft HandLeft ShoulderRight ElbowRight "
    "WristRight HandRight HipLeft KneeLeft AnkleLeft FootLeft HipRight KneeRight AnkleRight FootRight "
    "SpineShoulder HandTipLeft ThumbLeft HandTipRight ThumbRight"
)
AZURE = (
    "PELVIS SPINE_NAVEL SPINE_CHEST NECK CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT "
    "HANDTIP_LEFT THUMB_LEFT CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT "
    "HANDTIP_RIGHT THUMB_RIGHT HIP_LEFT KNEE_LEFT ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT "
    "FOOT_RIGHT HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT"
)
SMPL = (
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 "
    "left_foot right_foot neck left_collar right_collar head left_shoulder right_shoulder left_elbow "
    "right_elbow left_wrist right_wrist"
)


@pytest.mark.parametrize(("names", "body"), [(KINECT2, "kinect25"), (AZURE, "kinect32"), (SMPL, "smpl22")])
def test_the_names_of_a_maker_are_its_skeleton(tmp_path: Path, names: str, body: str) -> None:
    joints = names.split()
    points = np.random.default_rng(0).uniform(100, 400, (6, 2 * len(joints)))
    path = tmp_path / "a.csv"
    path.write_text(",".join(f"{joint}_{axis}" for joint in joints for axis in "xy") + "\n")
    with path.open("a") as file:
        np.savetxt(file, points, delimiter=",")
    (pose,) = read(path)
    assert pose.skeleton == body and pose.provenance["notes"] == "feet and spine: read and not compared"
    np.testing.assert_allclose(pose.keypoints.reshape(6, -1), points, rtol=1e-6)


def test_where_the_thorax_is_named_it_is_the_neck(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Thorax_x,Thorax_y,Neck_x,Neck_y,RFoot_x,RFoot_y\n" + "1,2,3,4,5,6\n" * 3)
    (pose,) = read(path)
    assert pose.keypoints[0, COCO18.index("neck")].tolist() == [1, 2]
    assert pose.keypoints[0, COCO18.index("right_ankle")].tolist() == [5, 6]  # without another one


DEEP = np.concatenate([person(COCO17.joints), 10 + person(COCO17.joints)[..., :1] / 4], axis=2)


def deep_table(path: Path) -> Path:
    names = [f"{joint}_{axis}" for joint in COCO17.joints for axis in "xyz"]
    return save(path, names, [[f"{value:g}" for value in row] for row in DEEP.reshape(FRAMES, -1)])


def long_table(path: Path) -> Path:
    rows = [
        [frame, joint, *(f"{value:g}" for value in place)]
        for frame, places in enumerate(DEEP)
        for joint, place in zip(COCO17.joints, places, strict=True)
    ]
    return save(path, ["frame", "joint", "x", "y", "z"], rows)


@pytest.mark.parametrize("table", [deep_table, long_table])
def test_a_third_coordinate_is_kept_where_it_is_wanted(tmp_path: Path, table: Callable[[Path], Path]) -> None:
    (pose,) = read(table(tmp_path / "k.csv"), depth=True)
    np.testing.assert_allclose(pose.keypoints, DEEP, atol=1e-3)
    (flat_one,) = read(table(tmp_path / "k.csv"))
    np.testing.assert_allclose(flat_one.keypoints, DEEP[..., :2])
    assert "depth (z), which --preset depth uses" in flat_one.provenance["notes"]


def test_a_joint_without_a_third_coordinate_is_named_and_a_table_of_such_refused(tmp_path: Path) -> None:
    path = deep_table(tmp_path / "k.csv")
    path.write_text(path.read_text().replace("nose_z", "other"))
    (pose,) = read(path, depth=True)
    assert "nose (no z)" in pose.provenance["notes"] and np.isnan(pose.keypoints[:, 0]).all()
    plane = save(tmp_path / "p.csv", named(COCO17.joints), flat(DEEP[..., :2]))
    assert "third coordinate" in refused(plane, depth=True).cause


def test_people_told_apart_by_their_place_have_no_third_coordinate(tmp_path: Path) -> None:
    path = deep_table(tmp_path / "k.csv")
    header, *rows = path.read_text().splitlines()
    beside = [",".join(f"{value:g}" for value in row.reshape(-1)) for row in DEEP + np.array([900, 0, 0])]
    both = [f"{frame},{row}" for frame, pair in enumerate(zip(rows, beside, strict=True)) for row in pair]
    path.write_text("\n".join([f"frame,{header}", *both]))
    assert "no z is kept" in refused(path, depth=True).cause
