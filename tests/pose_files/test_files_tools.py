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
from tool_files import (
    FRAMES,
    JOINTS,
    NAMES,
    POINTS,
    write_csv,
    write_fixed,
    write_pose,
    write_sleap,
    write_table,
    write_trc,
)  # fmt: skip

from gesture_core.errors import KeypointError
from gesture_core.plugin.interfaces import KeypointReader
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import COCO18
from gesture_core.testing import READER_CHECKS


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
def test_tables_in_hdf5_keep_the_contract(
    tmp_path: Path, check: Callable[[KeypointReader, Path], None]
) -> None:
    pytest.importorskip("h5py")
    check(Hdf5Reader(), write_table(tmp_path / "clip.h5", [""]))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_a_third_coordinate_is_kept_where_it_is_wanted(order: tuple[int, ...], tmp_path: Path) -> None:
    """Whatever axis of the file is up, y points down, x to who looks's right, and z away."""
    from gesture_core.run.store import read_keypoints, write_keypoints

    depth = np.linspace(0, 40, POINTS[..., 0].size).reshape(POINTS.shape[:2])
    solid = np.stack([POINTS[..., 0], -POINTS[..., 1], depth], axis=2)[..., order]
    path = write_trc(tmp_path / "clip.trc", solid, "mm")
    (flat,) = TrcReader().read(path)
    (deep,) = TrcReader(ReadOptions(depth=True)).read(path)
    assert flat.keypoints.shape[2] == 2 and deep.keypoints.shape[2] == 3
    np.testing.assert_array_equal(flat.keypoints, deep.flat.keypoints)
    write_keypoints(tmp_path / "stored.parquet", [deep], {})
    (again,) = read_keypoints(tmp_path / "stored.parquet").sequences
    np.testing.assert_array_equal(again.keypoints, deep.keypoints)


def test_arrays_with_and_without_a_third_coordinate(tmp_path: Path) -> None:
    from gesture_core.plugin.registry import registry

    values = np.random.default_rng(0).uniform(0.2, 0.8, (5, 33, 4)).astype(np.float32)
    np.save(tmp_path / "marks.npy", values)
    np.save(tmp_path / "flat.npy", values[..., :2])
    reader = registry().make("reader", "arrays", options=ReadOptions(depth=True, frame_size=(640, 480)))
    (pose,) = reader.read(tmp_path / "marks.npy")
    np.testing.assert_allclose(pose.keypoints, values[..., :3] * [640, 480, 640], rtol=1e-5)
    with pytest.raises(KeypointError, match="no third coordinate"):
        reader.read(tmp_path / "flat.npy")
