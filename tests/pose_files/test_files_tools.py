"""Files of DeepLabCut, SLEAP, pose-format, Sports2D and Pose2Sim, drawn in the layout of each tool."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.deeplabcut import DeepLabCutCsvReader
from gesture_pose_files.hdf5 import Hdf5Reader
from gesture_pose_files.pose_format_file import PoseFormatReader
from gesture_pose_files.trc import TrcReader

from gesture_core.errors import KeypointError
from gesture_core.plugin.interfaces import KeypointReader
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import COCO18
from gesture_core.testing import READER_CHECKS

FRAMES = 9
NAMES = ["nose", "leftShoulder", "rightShoulder", "l_elbow", "R-Wrist", "left hip", "right hip", "tail"]
JOINTS = [
    "nose", "left_shoulder", "right_shoulder", "left_elbow", "right_wrist", "left_hip", "right_hip", "neck",
]  # fmt: skip
# x, y in pixels of a person who looks at the camera: the left is at the larger x.
BODY = np.array([(320, 90), (370, 150), (270, 150), (390, 210), (250, 270), (350, 300), (290, 300), (5, 5)])
POINTS = BODY + np.arange(FRAMES)[:, None, None] * np.array([3.0, 1.0])
SCORES = np.full((FRAMES, len(NAMES)), 0.75)


def check(reader: KeypointReader, path: Path, times: np.ndarray, scores: float = 0.75) -> None:
    assert reader.accepts(path) and reader.members(path) == [""]
    (sequence,) = reader.read(path)
    assert sequence.skeleton == "coco18" and sequence.source == str(path)
    np.testing.assert_allclose(sequence.times, times)
    for index, joint in enumerate(JOINTS[:-1]):
        np.testing.assert_allclose(sequence.keypoints[:, COCO18.index(joint)], POINTS[:, index], atol=1e-3)
    neck = sequence.keypoints[:, COCO18.index("neck")]
    np.testing.assert_allclose(neck, POINTS[:, 1:3].mean(axis=1), atol=1e-3)
    assert sequence.scores[0, 0] == pytest.approx(scores)
    assert sequence.provenance["notes"] == "joints that are not used: tail"


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


FRAME_NUMBERS = np.arange(5, 5 + FRAMES) / 30


def test_deeplabcut_csv(tmp_path: Path) -> None:
    check(DeepLabCutCsvReader(), write_csv(tmp_path / "videoDLC.csv", [""]), FRAME_NUMBERS)


@pytest.mark.parametrize("write", [write_table, write_fixed])
def test_deeplabcut_hdf5(tmp_path: Path, write: Callable[[Path, list[str]], Path]) -> None:
    pytest.importorskip("h5py")
    check(Hdf5Reader(), write(tmp_path / "videoDLC.h5", [""]), FRAME_NUMBERS)


def test_individuals_of_deeplabcut(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    both = ["ind1", "ind2"]
    paths: dict[Path, type[DeepLabCutCsvReader | Hdf5Reader]] = {
        write_csv(tmp_path / "a.csv", both): DeepLabCutCsvReader,
        write_table(tmp_path / "a.h5", both): Hdf5Reader,
        write_fixed(tmp_path / "b.h5", both): Hdf5Reader,
    }
    for path, reader in paths.items():
        one, two = reader(people="multi").read(path)
        assert (one.person, two.person) == (0, 1)
        np.testing.assert_allclose(two.keypoints[:, 0], POINTS[:, 0] + 200, atol=1e-3)
        (single,) = reader().read(path)
        np.testing.assert_allclose(single.keypoints[:, 0], POINTS[:, 0], atol=1e-3)
        assert single.provenance["notes"].endswith("the best of 2 people or tracks")


def test_labelled_pictures_of_deeplabcut(tmp_path: Path) -> None:
    text = write_csv(tmp_path / "a.csv", [""]).read_text().splitlines()
    rows = [row.replace(",", ",,,", 1) for row in text[:3]]
    rows += [
        row.replace(f"{n}", f"labeled-data,video,img{n:04d}.png", 1) for n, row in enumerate(text[3:], 5)
    ]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    check(DeepLabCutCsvReader(), tmp_path / "a.csv", FRAME_NUMBERS)


def test_the_columns_of_a_table_cannot_run_anything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("h5py")
    monkeypatch.chdir(tmp_path)

    class Evil:
        def __reduce__(self) -> tuple[object, ...]:
            return os.mkdir, ("evil-was-here",)

    path = write_table(tmp_path / "a.h5", [""], pickle.dumps(Evil(), 0))
    with pytest.raises(KeypointError) as caught:
        Hdf5Reader().read(path)
    assert caught.value.code == "E_KEYPOINTS_FORMAT" and not (tmp_path / "evil-was-here").exists()


@pytest.mark.parametrize("form", ["link", "virtual", "external"])
def test_hdf5_that_leads_out_of_its_file_is_refused(tmp_path: Path, form: str) -> None:
    h5py = pytest.importorskip("h5py")
    other, path = write_sleap(tmp_path / "other.h5"), write_sleap(tmp_path / "a.h5")
    with h5py.File(path, "a") as file:
        shape = file["tracks"].shape
        del file["tracks"]
        if form == "link":
            file["tracks"] = h5py.ExternalLink(str(other), "tracks")
        elif form == "virtual":
            layout = h5py.VirtualLayout(shape, "f8")
            layout[:] = h5py.VirtualSource(str(other), "tracks", shape)
            file.create_virtual_dataset("tracks", layout)
        else:
            file.create_dataset("tracks", shape, "f8", external=[(str(other), 0, 8 * int(np.prod(shape)))])
    with pytest.raises(KeypointError) as caught:
        Hdf5Reader().read(path)
    assert caught.value.code == "E_KEYPOINTS_FORMAT"


def test_sleap(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    path = write_sleap(tmp_path / "a.analysis.h5")
    (sequence,) = Hdf5Reader().read(path)
    assert not sequence.seen[4, COCO18.index("left_elbow")] and sequence.seen[3, COCO18.index("left_elbow")]
    np.testing.assert_allclose(sequence.keypoints[:, 0], POINTS[:, 0], atol=1e-3)
    np.testing.assert_allclose(sequence.times, np.arange(FRAMES) / 30)
    assert len(Hdf5Reader(people="multi").read(write_sleap(tmp_path / "b.h5", 3))) == 3
    with pytest.raises(KeypointError) as caught:
        write_sleap(path)
        import h5py

        with h5py.File(path, "a") as file:
            file["node_names"][:] = np.array([f"part {n}" for n in range(8)], "S40")
        Hdf5Reader().read(path)
    assert caught.value.code == "E_KEYPOINTS_SKELETON" and "part 0, part 1" in caught.value.cause
    order = ReadOptions(order=(*JOINTS[:-1], "tail"))
    np.testing.assert_allclose(Hdf5Reader(order).read(path)[0].keypoints[:, 0], POINTS[:, 0], atol=1e-3)


def test_other_hdf5_says_what_it_holds(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["weights"] = np.zeros(3)
    with pytest.raises(KeypointError) as caught:
        Hdf5Reader().read(tmp_path / "a.h5")
    assert caught.value.code == "E_KEYPOINTS_FORMAT" and "holds 'weights'" in caught.value.cause


def test_pose_format(tmp_path: Path) -> None:
    pytest.importorskip("pose_format")
    path = write_pose(tmp_path / "a.pose")
    (sequence,) = PoseFormatReader().read(path)
    assert PoseFormatReader().accepts(path) and sequence.frame_size == (640, 480)
    np.testing.assert_allclose(sequence.keypoints[:, 0], POINTS[:, 0], atol=1e-3)
    np.testing.assert_allclose(sequence.times, np.arange(FRAMES) / 25)
    assert sequence.scores[0, 0] == pytest.approx(0.75)
    assert "parts that are not used: LEFT_HAND_LANDMARKS" in sequence.provenance["notes"]
    assert len(PoseFormatReader(people="multi").read(write_pose(tmp_path / "b.pose", 2))) == 2


def test_sports2d_in_pixels(tmp_path: Path) -> None:
    points = np.concatenate([POINTS, np.zeros((FRAMES, len(NAMES), 1))], axis=2)
    check(TrcReader(), write_trc(tmp_path / "a_px.trc", points, "px"), np.arange(FRAMES) / 50, 1.0)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1000.0)])
def test_sports2d_in_metres_has_y_up(tmp_path: Path, unit: str, factor: float) -> None:
    points = np.concatenate([POINTS * [0.01, -0.01], np.zeros((FRAMES, len(NAMES), 1))], axis=2) * factor
    (sequence,) = TrcReader().read(write_trc(tmp_path / "a_m.trc", points, unit))
    np.testing.assert_allclose(sequence.keypoints[:, 0], POINTS[:, 0] * 0.01, rtol=1e-5)
    assert sequence.provenance["unit"] == "metres" and "y points up" in sequence.provenance["notes"]


@pytest.mark.parametrize("up", [1, 2])
@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_pose2sim_is_seen_from_in_front(tmp_path: Path, up: int, turn: float) -> None:
    """Three dimensions, either of which points up, of a person who faces anywhere."""
    flat = POINTS * [0.01, -0.01]
    across, depth = flat[..., 0], np.linspace(0, 0.3, len(NAMES)) * (np.arange(len(NAMES)) > 2)
    level = [across * np.cos(turn) - depth * np.sin(turn), across * np.sin(turn) + depth * np.cos(turn)]
    axes = [level[0], flat[..., 1], level[1]] if up == 1 else [level[0], level[1], flat[..., 1]]
    (sequence,) = TrcReader().read(write_trc(tmp_path / "a.trc", np.stack(axes, axis=2), "m"))
    found = sequence.keypoints[:, COCO18.index("right_wrist")] - sequence.keypoints[:, COCO18.index("neck")]
    np.testing.assert_allclose(found, (POINTS[:, 4] - POINTS[:, 1:3].mean(axis=1)) * 0.01, atol=1e-4)
    assert "seen from in front" in sequence.provenance["notes"]


@pytest.mark.parametrize("check", READER_CHECKS)
@pytest.mark.parametrize("form", ["deeplabcut", "table", "sleap", "pose", "trc"])
def test_each_reader_keeps_the_contract(
    tmp_path: Path, form: str, check: Callable[[KeypointReader, Path], None]
) -> None:
    pytest.importorskip("h5py")
    pytest.importorskip("pose_format")
    flat = np.concatenate([POINTS, np.zeros((FRAMES, len(NAMES), 1))], axis=2)
    makers: dict[str, Callable[[], tuple[KeypointReader, Path]]] = {
        "deeplabcut": lambda: (DeepLabCutCsvReader(), write_csv(tmp_path / "clip.csv", [""])),
        "table": lambda: (Hdf5Reader(), write_table(tmp_path / "clip.h5", [""])),
        "sleap": lambda: (Hdf5Reader(), write_sleap(tmp_path / "clip.h5")),
        "pose": lambda: (PoseFormatReader(), write_pose(tmp_path / "clip.pose")),
        "trc": lambda: (TrcReader(), write_trc(tmp_path / "clip.trc", flat, "px")),
    }
    check(*makers[form]())
