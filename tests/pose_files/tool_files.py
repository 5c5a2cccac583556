"""Writes files as DeepLabCut, SLEAP, pose-format, Pose2Sim and motion captures do, for tests."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np

FRAMES = 9
NAMES = ["nose", "leftShoulder", "rightShoulder", "l_elbow", "R-Wrist", "left hip", "right hip", "tail"]
JOINTS = [
    "nose", "left_shoulder", "right_shoulder", "left_elbow", "right_wrist", "left_hip", "right_hip", "neck",
]  # fmt: skip
# x, y in pixels of a person who looks at the camera: the left is at the larger x.
BODY = np.array([(320, 90), (370, 150), (270, 150), (390, 210), (250, 270), (350, 300), (290, 300), (5, 5)])
POINTS = BODY + np.arange(FRAMES)[:, None, None] * np.array([3.0, 1.0])
SCORES = np.full((FRAMES, len(NAMES)), 0.75)


def columns(individuals: list[str]) -> list[tuple[str, ...]]:
    return [
        ("DLC_x", *([one] if one else []), part, coord)
        for one in individuals for part in NAMES for coord in ("x", "y", "likelihood")
    ]  # fmt: skip


def values(people: int) -> np.ndarray:
    one = np.concatenate([POINTS, SCORES[..., None]], axis=2).reshape(FRAMES, -1)
    other = np.concatenate([POINTS + 200, SCORES[..., None] / 2], axis=2).reshape(FRAMES, -1)
    return np.hstack([one, other][:people])


def write_csv(path: Path, individuals: list[str]) -> Path:
    names = columns(individuals)
    levels = ["scorer", *(["individuals"] if individuals[0] else []), "bodyparts", "coords"]
    head = [",".join([level, *(name[n] for name in names)]) for n, level in enumerate(levels)]
    table = values(len(individuals))
    rows = [f"{number},{','.join(map(str, row))}" for number, row in enumerate(table, 5)]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


def write_table(path: Path, individuals: list[str], kind: bytes | None = None) -> Path:
    """As ``DataFrame.to_hdf(key="df_with_missing", format="table")`` does."""
    import h5py

    table = values(len(individuals))
    records = np.zeros(FRAMES, [("index", "<i8"), ("values_block_0", "<f8", (table.shape[1],))])
    records["index"], records["values_block_0"] = np.arange(5, 5 + FRAMES), table
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        held = group.create_dataset("table", data=records)
        labels = kind if kind is not None else pickle.dumps(columns(individuals), 0)
        held.attrs["values_block_0_kind"] = np.bytes_(labels)
    return path


def write_fixed(path: Path, individuals: list[str]) -> Path:
    """As ``DataFrame.to_hdf(key="df_with_missing", format="fixed")`` does."""
    import h5py

    names = columns(individuals)
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame")
        group.attrs["nblocks"] = np.int64(1)
        group.attrs["block0_items_nlevels"] = np.int64(len(names[0]))
        for level in range(len(names[0])):
            known = sorted({name[level] for name in names})
            group[f"block0_items_level{level}"] = np.array(known, "S40")
            group[f"block0_items_label{level}"] = np.array([known.index(n[level]) for n in names], "i1")
        group["block0_values"], group["axis1"] = values(len(individuals)), np.arange(5, 5 + FRAMES)
    return path


def write_sleap(path: Path, tracks: int = 1) -> Path:
    import h5py

    points = np.stack([POINTS + 200 * track for track in range(tracks)])
    points[:, 4, 3] = np.nan
    with h5py.File(path, "w") as file:
        file["node_names"] = np.array(NAMES, "S40")
        file["track_names"] = np.array([f"track_{n}" for n in range(tracks)], "S40")
        file["tracks"] = points.transpose(0, 3, 2, 1)
        file["point_scores"] = np.stack([SCORES.T / (track + 1) for track in range(tracks)])
        file["track_occupancy"] = np.ones((FRAMES, tracks), "u1")
    return path


def write_trc(path: Path, points: np.ndarray, unit: str, names: list[str] = NAMES) -> Path:
    rows = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"50\t50\t{len(points)}\t{len(names)}\t{unit}\t50\t0\t{len(points)}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{n + 1}" for n in range(len(names)) for axis in "XYZ"),
        "",
    ]
    for number, frame in enumerate(points):
        rows.append("\t".join([str(number + 1), str(number / 50 + 2), *map(str, frame.reshape(-1))]))
    path.write_text("\n".join(rows) + "\n")
    return path


# Of a figure that looks along z, its left at larger x: parent, and place from there in centimetres.
BONES = {
    "Hips": ("", (0, 100, 0)), "Neck": ("Hips", (0, 50, 0)), "Head": ("Neck", (0, 20, 2)),
    "LeftShoulder": ("Neck", (5, -2, 0)), "LeftArm": ("LeftShoulder", (15, 0, 0)),
    "LeftForeArm": ("LeftArm", (28, 0, 0)), "LeftHand": ("LeftForeArm", (25, 0, 1)),
    "RightShoulder": ("Neck", (-5, -2, 0)), "RightArm": ("RightShoulder", (-15, 0, 0)),
    "RightForeArm": ("RightArm", (-28, 0, 0)), "RightHand": ("RightForeArm", (-25, 0, 1)),
    "LeftUpLeg": ("Hips", (10, -5, 0)), "LeftLeg": ("LeftUpLeg", (0, -42, 1)),
    "LeftFoot": ("LeftLeg", (0, -40, 0)),
    "RightUpLeg": ("Hips", (-10, -5, 0)), "RightLeg": ("RightUpLeg", (0, -42, 1)),
    "RightFoot": ("RightLeg", (0, -40, 0)),
}  # fmt: skip


def write_bvh(path: Path, angles: np.ndarray, order: str = "ZXY", prefix: str = "") -> Path:
    """A file of (T, 17, 3) ``angles`` in degrees, of `BONES` in their order, around the axes of ``order``."""
    lines, axes = ["HIERARCHY"], " ".join(f"{axis}rotation" for axis in order)

    def add(name: str) -> None:
        parent, place = BONES[name]
        root = not parent
        lines.append(f"{'JOINT' if parent else 'ROOT'} {prefix}{name}" + (" {" if root else ""))
        lines.extend([] if root else ["{"])
        lines.append(f"OFFSET {' '.join(map(str, place))}")
        lines.append(f"CHANNELS 6 Xposition Yposition Zposition {axes}" if root else f"CHANNELS 3 {axes}")
        under = [child for child, (above, _) in BONES.items() if above == name]
        for child in under:
            add(child)
        lines.extend([] if under else ["End Site", "{", "OFFSET 0 5 0", "}"])
        lines.append("}")

    add("Hips")
    lines += ["MOTION", f"Frames: {len(angles)}", "Frame Time: 0.02"]
    lines += [" ".join(map(str, [3, 100, -7, *frame.reshape(-1)])) for frame in angles]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_c3d(path: Path, points: np.ndarray, names: list[str]) -> Path:
    """A file of (T, N, 3) ``points`` in millimetres, NaN where a marker is lost."""
    import c3d

    writer = c3d.Writer(point_rate=50)
    for frame in points:
        rows = np.zeros((len(names), 5), np.float32)
        rows[:, :3] = np.nan_to_num(frame)
        rows[:, 3] = np.where(np.isfinite(frame).all(axis=1), 0, -1)
        writer.add_frames([(rows, np.array([]))])
    writer.set_point_labels(names)
    with path.open("wb") as file:
        writer.write(file)
    return path


def write_pose(path: Path, people: int = 1) -> Path:
    from pose_format import Pose
    from pose_format.numpy import NumPyPoseBody
    from pose_format.pose_header import PoseHeader, PoseHeaderComponent, PoseHeaderDimensions

    hand = ["WRIST", "THUMB_TIP"]
    parts = [
        PoseHeaderComponent("LEFT_HAND_LANDMARKS", hand, [(0, 1)], [(0, 0, 0)], "XYZC"),
        PoseHeaderComponent("POSE_LANDMARKS", NAMES, [(0, 1)], [(0, 0, 0)], "XYZC"),
    ]
    data = np.zeros((FRAMES, people, len(hand) + len(NAMES), 3), np.float32)
    confidence = np.full(data.shape[:3], 0.3, np.float32)
    for person in range(people):
        data[:, person, 2:, :2] = POINTS + 200 * person
        confidence[:, person, 2:] = SCORES / (person + 1)
    header = PoseHeader(0.2, PoseHeaderDimensions(640, 480, 100), parts)
    with path.open("wb") as file:
        Pose(header, NumPyPoseBody(25.0, data, confidence)).write(file)
    return path
