"""Motion captures: bones in BVH, markers in C3D."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.bvh import BvhReader, joint_names
from gesture_pose_files.c3d_file import C3dReader
from gesture_pose_files.trc import TrcReader
from scipy.spatial.transform import Rotation
from tool_files import BONES, write_bvh, write_c3d, write_trc

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joint_named
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

OURS = {
    "Hips": "mid_hip", "Neck": "neck", "Head": "head",
    "LeftArm": "left_shoulder", "LeftForeArm": "left_elbow", "LeftHand": "left_wrist",
    "RightArm": "right_shoulder", "RightForeArm": "right_elbow", "RightHand": "right_wrist",
    "LeftUpLeg": "left_hip", "LeftLeg": "left_knee", "LeftFoot": "left_ankle",
    "RightUpLeg": "right_hip", "RightLeg": "right_knee", "RightFoot": "right_ankle",
}  # fmt: skip
ANGLES = np.random.default_rng(0).uniform(-25, 25, (6, len(BONES), 3))
ANGLES[:, 0] = [0, 0, 0]


def places(angles: np.ndarray, order: str) -> dict[str, np.ndarray]:
    """(T, 3) centimetres of each bone's beginning, by scipy's rotations."""
    out: dict[str, np.ndarray] = {}
    turns: dict[str, Rotation] = {}
    for number, (name, (parent, offset)) in enumerate(BONES.items()):
        own = Rotation.from_euler(order, angles[:, number], degrees=True)
        out[name] = (
            out[parent] + turns[parent].apply(offset) if parent else np.tile([3.0, 100, -7], (len(angles), 1))
        )
        turns[name] = turns[parent] * own if parent else own
    return out


def depth(path: Path, reader: type) -> PoseSequence:
    (pose,) = reader(ReadOptions(depth=True)).read(path)
    assert isinstance(pose, PoseSequence)
    return pose


@pytest.mark.parametrize(("order", "prefix"), [("ZXY", ""), ("XYZ", "mixamorig:"), ("YXZ", "")])
def test_bones_are_turned_as_the_file_says(tmp_path: Path, order: str, prefix: str) -> None:
    """As a marker file of the places that scipy computes."""
    there = places(ANGLES, order)
    pose = depth(write_bvh(tmp_path / "a.bvh", ANGLES, order, prefix), BvhReader)
    solid = np.stack([there[name] for name in OURS], axis=1)
    marks = depth(write_trc(tmp_path / "a.trc", solid, "cm", list(OURS.values())), TrcReader)
    neck = COCO18.index("neck")
    found, wanted = (one.keypoints - one.keypoints[:, neck : neck + 1] for one in (pose, marks))
    size = np.ptp(np.stack([way[0] for way in there.values()]), axis=0).max() / 100
    np.testing.assert_allclose(found[:, 1:14] * size, wanted[:, 1:14], atol=1e-4)
    np.testing.assert_allclose(pose.times, np.arange(6) * 0.02)
    assert pose.provenance["notes"].startswith("it names no unit")
    (flat,) = BvhReader().read(tmp_path / "a.bvh")
    assert flat.keypoints.shape[2] == 2


@pytest.mark.parametrize(
    "names",
    [
        "hip abdomen neck lCollar lShldr lForeArm lHand rShldr lThigh lShin lFoot rThigh",
        "pelvis root neck_01 clavicle_l upperarm_l lowerarm_l hand_l upperarm_r thigh_l calf_l foot_l "
        "thigh_r",
        "Hips Spine1 Neck LeftShoulder LeftArm LeftForeArm LeftHand RightArm LeftUpLeg LeftLeg LeftFoot "
        "RightUpLeg",
        "Bip01|Bip01 Spine|Bip01 Neck|Bip01 L Clavicle|Bip01 L UpperArm|Bip01 L Forearm|Bip01 L Hand|"
        "Bip01 R UpperArm|Bip01 L Thigh|Bip01 L Calf|Bip01 L Foot|Bip01 R Thigh",
        "Hips Chest4 Neck LeftCollar LeftShoulder LeftElbow LeftWrist RightShoulder LeftHip LeftKnee "
        "LeftAnkle RightHip",
        "CC_Base_Hip CC_Base_Waist CC_Base_NeckTwist01 CC_Base_L_Clavicle CC_Base_L_Upperarm "
        "CC_Base_L_Forearm CC_Base_L_Hand CC_Base_R_Upperarm CC_Base_L_Thigh CC_Base_L_Calf CC_Base_L_Foot "
        "CC_Base_R_Thigh",
        "J_Bip_C_Hips J_Sec_Hair1_01 J_Bip_C_Neck J_Bip_L_Shoulder J_Bip_L_UpperArm J_Bip_L_LowerArm "
        "J_Bip_L_Hand J_Bip_R_UpperArm J_Bip_L_UpperLeg J_Bip_L_LowerLeg J_Bip_L_Foot J_Bip_R_UpperLeg",
        "Character1_Hips Character1_Spine Character1_Neck Character1_LeftShoulder Character1_LeftArm "
        "Character1_LeftForeArm Character1_LeftHand Character1_RightArm Character1_LeftUpLeg "
        "Character1_LeftLeg Character1_LeftFoot Character1_RightUpLeg",
        "Hips Spine Neck LShoulder LArm LArm1 LHand RArm LUpLeg LLeg LFoot RUpLeg",
        "root lowerback lowerneck lclavicle lhumerus lradius lwrist rhumerus lfemur ltibia lfoot rfemur",
        "Hip Ab Neck LShoulder LUArm LFArm LHand RUArm LThigh LShin LFoot RThigh",
        "hip abdomenLower neckLower lCollar lShldrBend lForearmBend lHand rShldrBend lThighBend lShin lFoot "
        "rThighBend",
        "DEF-spine DEF-spine.001 DEF-neck DEF-shoulder.L DEF-upper_arm.L DEF-forearm.L DEF-hand.L "
        "DEF-upper_arm.R DEF-thigh.L DEF-shin.L DEF-foot.L DEF-thigh.R",
        "mPelvis mTorso mNeck mCollarLeft mShoulderLeft mElbowLeft mWristLeft mShoulderRight mHipLeft "
        "mKneeLeft mAnkleLeft mHipRight",
        "hips_JNT spine_JNT neck_JNT l_shoulder_JNT l_arm_JNT l_forearm_JNT l_hand_JNT r_arm_JNT l_upleg_JNT "
        "l_leg_JNT l_foot_JNT r_upleg_JNT",
    ],
)
def test_bones_of_other_programs_are_known(names: str) -> None:
    given = names.split("|") if "|" in names else names.split()
    found = [joint_named(name) for name in joint_names(given)]
    arm = ["left_collar", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder"]
    assert found[2:] == ["neck", *arm, "left_hip", "left_knee", "left_ankle", "right_hip"]
    assert found[0] in ("mid_hip", None)


def test_a_name_of_a_hundred_thousand_words_costs_no_more_than_to_read_it() -> None:
    assert joint_names(["rig " * 100_000 + "L Hand", "tail " * 100_000]) == ["left_wrist", "tail " * 100_000]


def test_what_lies_on_the_floor_is_no_hip() -> None:
    found = joint_names(["root", "pelvis", "upperarm_l", "upperarm_twist_01_l", "Neck", "Neck1"])
    assert found == ["the root", "mid_hip", "left_shoulder", "upperarm_twist_01_l", "neck", "Neck1"]
    assert joint_named(found[0]) is None


def test_a_forearm_ends_in_the_wrist_where_there_is_no_hand(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", ANGLES)
    (whole,) = BvhReader().read(path)
    text, hands = path.read_text(), ("LeftHand", "RightHand")
    for hand in hands:
        own = rf"JOINT {hand}\n{{\n(OFFSET.*\n)CHANNELS.*\n(?:.*\n){{5}}"
        text = re.sub(own, r"End Site\n{\n\1}\n", text)
    columns = [3 + 3 * list(BONES).index(hand) + axis for hand in hands for axis in range(3)]
    head, _, motion = text.partition("Time: 0.02\n")
    rows = [np.delete(row.split(), columns) for row in motion.splitlines()]
    path.write_text(head + "Time: 0.02\n" + "\n".join(" ".join(row) for row in rows))
    (pose,) = BvhReader().read(path)
    np.testing.assert_allclose(pose.keypoints, whole.keypoints, atol=1e-6)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n").replace(" ", "\t"),
        lambda text: "# by hand\n" + text.replace("HIERARCHY", "HIERARCHY  // of bones"),
        lambda text: re.sub("(Frames.*)\n(Frame Time.*)", r"\2\n\1", text).replace("MOTION\n", "MOTION "),
        lambda text: text.replace(".", ","),
    ],
)  # fmt: skip
def test_a_capture_is_read_however_its_lines_are_written(tmp_path: Path, change: object) -> None:
    path = write_bvh(tmp_path / "a.bvh", ANGLES)
    (plain,) = BvhReader().read(path)
    path.write_bytes(change(path.read_text()).encode())  # type: ignore[operator]
    (pose,) = BvhReader().read(path)
    np.testing.assert_array_equal(pose.keypoints, plain.keypoints)
    np.testing.assert_array_equal(pose.times, plain.times)
    assert "lost" not in pose.provenance


@pytest.mark.parametrize("said", ["Frame Time: 0", ""])
def test_a_capture_that_tells_no_rate_has_that_of_the_settings(tmp_path: Path, said: str) -> None:
    path = write_bvh(tmp_path / "a.bvh", ANGLES)
    path.write_text(path.read_text().replace("Frame Time: 0.02", said))
    (pose,) = BvhReader(ReadOptions(fps=25)).read(path)
    np.testing.assert_allclose(pose.times, np.arange(6) / 25)


def test_a_raised_arm_is_up_in_the_picture(tmp_path: Path) -> None:
    angles = np.zeros((5, len(BONES), 3))
    angles[:, list(BONES).index("LeftArm"), 0] = [0, 20, 45, 70, 90]  # around z, towards y
    (pose,) = BvhReader().read(write_bvh(tmp_path / "a.bvh", angles))
    shoulder, wrist = (pose.keypoints[:, COCO18.index(f"left_{j}")] for j in ("shoulder", "wrist"))
    way = wrist - shoulder
    assert way[0, 0] > 0.3 and abs(way[0, 1]) < 0.01  # the figure's left is on the right of who looks
    assert way[-1, 1] < -0.3 and abs(way[-1, 0]) < 0.01


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("CHANNELS 3", "CHANNELS 4", 1), "channels"),
        (lambda text: text.partition("MOTION")[0], "before MOTION"),
        (lambda text: re.sub("Neck|Shoulder|Arm", "A", text), "neither a neck"),
        (lambda text: text.partition("Frame Time")[0], "no frame"),
        (lambda text: text.replace("}", "", 3), "tree"),
        (lambda text: text.replace("OFFSET", "OFSET", 1), "OFSET"),
    ],
)  # fmt: skip
def test_what_is_no_motion_capture_says_why(tmp_path: Path, change: object, said: str) -> None:
    path = write_bvh(tmp_path / "a.bvh", ANGLES)
    path.write_text(change(path.read_text()))  # type: ignore[operator]
    with pytest.raises(KeypointError, match=said):
        BvhReader().read(path)


def test_a_capture_that_is_cut_is_degraded(tmp_path: Path) -> None:
    pytest.importorskip("c3d")
    bones = write_bvh(tmp_path / "a.bvh", ANGLES)
    bones.write_text(bones.read_text()[:-100])
    (pose,) = BvhReader().read(bones)
    assert len(pose) == 5 and pose.provenance["lost"] == "it ends after 5 of 6 frames"
    marks = write_c3d(
        tmp_path / "a.c3d", np.ones((60, 40, 3)), ["LSHO", "RSHO", *(f"M{n}" for n in range(38))]
    )
    marks.write_bytes(marks.read_bytes()[:-4000])
    (pose,) = C3dReader().read(marks)
    assert len(pose) == 53 and pose.provenance["lost"] == "it ends after 53 of 60 frames"


def test_more_frames_than_are_read_are_not_called_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("c3d")
    marks = write_c3d(tmp_path / "a.c3d", np.ones((6, 2, 3)), ["LSHO", "RSHO"])
    bones = write_bvh(tmp_path / "a.bvh", ANGLES)
    for module, reader, path in (("c3d_file", C3dReader(), marks), ("bvh", BvhReader(), bones)):
        monkeypatch.setattr(f"gesture_pose_files.{module}.MAX_FRAMES", 5)
        with pytest.raises(KeypointError, match="more than 5") as caught:
            reader.read(path)
        assert caught.value.code == "E_KEYPOINTS_LIMIT" and caught.value.remedy == "split it"


def plug_in_gait(there: dict[str, np.ndarray], subject: str = "") -> tuple[list[str], np.ndarray]:
    """Names and (T, N, 3) millimetres of markers around the joints of a figure."""
    markers = {}
    for side in ("Left", "Right"):
        for bone, pair in (("Arm", ("SHO",)), ("ForeArm", ("ELB",)), ("Hand", ("WRA", "WRB")),
                           ("UpLeg", ("ASI", "PSI")), ("Leg", ("KNE",)), ("Foot", ("ANK",))):  # fmt: skip
            for name, off in zip(pair, (30, -30), strict=False):
                away = [0, 0, off if len(pair) == 2 else 0]
                markers[f"{subject}{side[0]}{name}"] = there[side + bone] * 10 + away
    markers |= {
        f"{subject}C7": there["Neck"] * 10 + [0, 0, 40],
        f"{subject}CLAV": there["Neck"] * 10 - [0, 0, 40],
    }
    return list(markers), np.stack(list(markers.values()), axis=1)


def test_joints_are_between_their_markers(tmp_path: Path) -> None:
    pytest.importorskip("c3d")
    there = places(ANGLES, "ZXY")
    names, points = plug_in_gait(there)
    points[2, names.index("LWRA")] = np.nan
    pose = depth(write_c3d(tmp_path / "a.c3d", points, names), C3dReader)
    bones = [name for name in OURS if name not in ("Hips", "Head")]
    solid = np.stack([there[name] for name in bones], axis=1)
    marks = depth(write_trc(tmp_path / "a.trc", solid, "cm", [OURS[name] for name in bones]), TrcReader)
    assert np.isnan(pose.keypoints[2, COCO18.index("left_wrist")]).all()  # and no jump to the other marker
    found, wanted = pose.keypoints[[0, 1, 3, 4, 5]], marks.keypoints[[0, 1, 3, 4, 5]]
    np.testing.assert_allclose(found, wanted, atol=2e-4)
    np.testing.assert_allclose(pose.times, np.arange(6) / 50)
    assert pose.provenance["unit"] == "metres" and not pose.provenance["assumed"]  # the file says millimetres


def test_a_marker_that_is_never_seen_takes_no_joint_away(tmp_path: Path) -> None:
    pytest.importorskip("c3d")
    names, points = plug_in_gait(places(ANGLES, "ZXY"))
    points[:, names.index("LWRB")] = np.nan  # a label of the marker set, and no marker
    computed = np.full((len(points), 1, 3), np.nan)
    path = write_c3d(tmp_path / "a.c3d", np.concatenate([computed, points], axis=1), ["LKJC", *names])
    (pose,) = C3dReader().read(path)
    assert pose.seen[:, [COCO18.index("left_wrist"), COCO18.index("left_knee")]].all()


def test_subjects_are_people(tmp_path: Path) -> None:
    pytest.importorskip("c3d")
    there = places(ANGLES, "ZXY")
    (one, first), (two, second) = plug_in_gait(there, "Anna:"), plug_in_gait(there, "Ben:")
    second[:4] = np.nan
    path = write_c3d(
        tmp_path / "a.c3d", np.concatenate([second, first, first[:, :1]], axis=1), [*two, *one, "*137"]
    )
    (pose,) = C3dReader().read(path)
    assert pose.frames_with_pose == 6 and "Anna" in pose.provenance["notes"]
    assert "no person: markers of nobody" in pose.provenance["notes"]
    assert len(C3dReader(people="multi").read(path)) == 2


def test_markers_of_your_own_are_named(tmp_path: Path) -> None:
    pytest.importorskip("c3d")
    names, points = plug_in_gait(places(ANGLES, "ZXY"))
    own = [f"P{n}" for n in range(len(names))]
    path = write_c3d(tmp_path / "a.c3d", points, own)
    with pytest.raises(KeypointError, match="neither a neck nor both shoulders"):
        C3dReader().read(path)
    order = ["left_shoulder", "left_elbow", "left_wrist", "a", "left_hip", "b", "left_knee", "left_ankle"]
    order += [name.replace("left", "right") for name in order[:3]] + ["c", "right_hip", "d", "right_knee"]
    (pose,) = C3dReader(ReadOptions(order=(*order, "right_ankle", "neck", "e"))).read(path)
    assert pose.frames_with_pose == 6
