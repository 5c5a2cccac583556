"""Keypoint arrays in npy and npz: layouts, units, archives of many sequences, hostile headers."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.layout import BY_COUNT, flat_widths
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core.errors import ConfigError, KeypointError
from gesture_core.plugin import registry
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import SKELETONS


def code_of(path: Path, member: str = "") -> str:
    with pytest.raises(KeypointError) as caught:
        ArrayReader().read(path, member)
    assert caught.value.subject and caught.value.code.startswith("E_KEYPOINTS_")
    return caught.value.code


def save(path: Path, array: np.ndarray) -> Path:
    np.save(path, array)
    return path


def test_every_skeleton_has_its_count() -> None:
    assert {kind.name for kind in BY_COUNT.values()} <= set(SKELETONS)
    assert len(flat_widths(ReadOptions())) == 3 * len(BY_COUNT)  # no two layouts share a width


@given(
    joints=st.sampled_from(sorted(BY_COUNT)),
    values=st.sampled_from([2, 3, 4]),
    frames=st.integers(1, 12),
    flat=st.booleans(),
    fortran=st.booleans(),
    dtype=st.sampled_from(["<f4", ">f8", "<f2"]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_every_layout_reads_back(
    tmp_path_factory: pytest.TempPathFactory,
    joints: int, values: int, frames: int, flat: bool, fortran: bool, dtype: str, seed: int,
) -> None:  # fmt: skip
    rng = np.random.default_rng(seed)
    array = rng.uniform(10, 600, (frames, joints, values))
    if values > 2:
        array[..., -1] = rng.uniform(0.1, 1, (frames, joints))
    array = array.astype(dtype)
    missing = rng.random((frames, joints)) < 0.2
    array[missing] = 0
    stored = array.reshape(frames, -1) if flat else array
    path = tmp_path_factory.getbasetemp() / "layout.npy"
    np.save(path, np.asfortranarray(stored) if fortran else stored)
    reader = ArrayReader(ReadOptions(fps=20))
    assert reader.accepts(path) and reader.members(path) == [""]
    (sequence,) = reader.read(path)
    assert sequence.skeleton == BY_COUNT[joints].name
    np.testing.assert_array_equal(sequence.seen, ~missing)
    np.testing.assert_array_equal(sequence.keypoints[~missing], array[~missing][:, :2].astype(np.float32))
    if values > 2:
        np.testing.assert_allclose(sequence.scores[~missing], array[~missing][:, -1].astype(np.float32))
    np.testing.assert_allclose(sequence.times, np.arange(frames) / 20)


def test_media_pipe_shares_become_pixels_of_one_unit(tmp_path: Path) -> None:
    array = np.full((4, 33, 4), 0.5, np.float32)
    array[..., 2], array[..., 3] = -0.3, 0.9
    path = save(tmp_path / "m.npy", array)
    (sequence,) = ArrayReader().read(path)
    assert sequence.keypoints[0, 0].tolist() == [320, 240] and sequence.frame_size is None
    assert "640 x 480" in sequence.provenance["scaled"]
    assumed = sequence.provenance["assumed"]
    assert assumed == "order=blazepose33, axes=xy, unit=shares, frame_size=640x480, fps=30"
    (wide,) = ArrayReader(ReadOptions(frame_size=(1920, 1080))).read(path)
    assert wide.keypoints[0, 0].tolist() == [960, 540]
    (pixels,) = ArrayReader().read(save(tmp_path / "p.npy", array * [400, 400, 1, 1]))
    assert pixels.keypoints[0, 0].tolist() == [200, 200]


def test_depth_is_not_a_score(tmp_path: Path) -> None:
    array = np.random.default_rng(0).uniform(-1, 1, (5, 33, 3))
    (sequence,) = ArrayReader().read(save(tmp_path / "z.npy", array))
    assert (sequence.scores == 1).all()
    visible = np.abs(array)
    (sequence,) = ArrayReader().read(save(tmp_path / "v.npy", visible))
    np.testing.assert_allclose(sequence.scores, visible[..., 2].astype(np.float32))
    assert code_of(save(tmp_path / "xyz.npy", array[:, :18] * 5)) == "E_KEYPOINTS_VALUE"


def test_a_score_of_zero_is_a_missing_joint_wherever_it_lies(tmp_path: Path) -> None:
    array = np.random.default_rng(0).uniform(0.1, 0.9, (6, 25, 3))
    array[:, 4] = -1, -1, 0
    (sequence,) = ArrayReader().read(save(tmp_path / "scaled.npy", array))
    assert not sequence.seen[:, 4].any() and sequence.seen.sum() == 6 * 24
    flat = np.random.default_rng(0).uniform(0.1, 0.9, (6, 33, 3))
    flat[..., 2] = 0  # no depth is told, and no score
    (sequence,) = ArrayReader().read(save(tmp_path / "flat.npy", flat))
    assert sequence.seen.all() and (sequence.scores == 1).all()


def test_zeros_without_scores_are_missing_unless_the_neck_is_the_origin(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).uniform(50, 400, (10, 18, 2))
    pixels[:, 1] = 0  # a neck that is never found, in pixels
    pixels[3] = 0
    (sequence,) = ArrayReader().read(save(tmp_path / "pixels.npy", pixels))
    assert not sequence.seen[:, 1].any() and sequence.seen[[0, 1, 2]][:, 2:].all()
    assert not sequence.seen[3].any()
    centred = pixels - [200, 200]
    centred[:, 1] = 0
    centred[4, 7] = 0  # a wrist before the neck
    centred[3] = 0  # nobody
    (sequence,) = ArrayReader().read(save(tmp_path / "centred.npy", centred))
    assert sequence.seen[:, 1].sum() == 9 and sequence.seen[4, 7] and not sequence.seen[3].any()


def test_our_own_archive(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points, scores = rng.uniform(0, 1, (7, 17, 2)) * 500, rng.uniform(0, 1, (7, 17))
    times = np.cumsum(rng.uniform(0.01, 0.1, 7))
    path = tmp_path / "own.npz"
    np.savez_compressed(
        path, keypoints=points, scores=scores, times=times, skeleton="coco17", frame_size=[640, 480]
    )
    assert ArrayReader().accepts(path) and ArrayReader().members(path) == [""]
    (sequence,) = ArrayReader().read(path)
    assert sequence.skeleton == "coco17" and sequence.frame_size == (640, 480)
    np.testing.assert_allclose(sequence.times, times)
    np.testing.assert_allclose(sequence.scores, scores.astype(np.float32))
    assert sequence.provenance["assumed"] == "", "it says everything itself"
    said = ReadOptions(axes="yx", unit="shares", order=("h36m17",), fps=5)
    (again,) = ArrayReader(said).read(path)
    np.testing.assert_array_equal(again.keypoints, sequence.keypoints)
    np.savez(path, keypoints=points, times=times * 1000)
    assert code_of(path) == "E_KEYPOINTS_TIMES"
    np.savez(path, keypoints=points, scores=scores[:3])
    assert code_of(path) == "E_KEYPOINTS_SHAPE"
    np.savez(path, keypoints=points, times=times[::-1])
    assert code_of(path) == "E_KEYPOINTS_TIMES"
    np.savez(path, keypoints=points, skeleton="coco18")
    assert code_of(path) == "E_KEYPOINTS_SHAPE"
    np.savez(path, keypoints=points, skeleton="octopus")
    assert code_of(path) == "E_KEYPOINTS_SKELETON"


def test_an_archive_of_many_sequences(tmp_path: Path) -> None:
    path = tmp_path / "many.npz"
    sequences = {f"clip/{index}": np.full((index + 2, 18, 3), 0.5) for index in range(5)}
    np.savez(path, allow_pickle=False, fps=np.array(25), **sequences)
    reader = ArrayReader()
    assert reader.members(path) == list(sequences)
    for name, array in sequences.items():
        (sequence,) = reader.read(path, name)
        assert len(sequence) == len(array) and sequence.source.endswith(f"::{name}")
    assert code_of(path) == "E_KEYPOINTS_MEMBER"
    assert code_of(path, "absent") == "E_KEYPOINTS_MEMBER"
    np.savez(path, one=np.full((4, 25, 3), 0.5))
    assert reader.members(path) == [""] and len(reader.read(path)[0]) == 4


class _Evil:
    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, ("evil-was-here",)


def header(shape: str, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


BAD_ARRAYS = {
    "python objects": (None, "E_KEYPOINTS_FORMAT"),
    "a terabyte": (header("(1000000, 18, 10000)") + bytes(100), "E_KEYPOINTS_LIMIT"),
    "more than it holds": (header("(100000, 18, 2)") + bytes(100), "E_KEYPOINTS_BROKEN"),
    "a negative side": (header("(-1, 18, 2)") + bytes(100), "E_KEYPOINTS_FORMAT"),
    "a long side": (header("(" + "9" * 60 + ", 18, 2)"), "E_KEYPOINTS_LIMIT"),
    "no shape": (header("'x'"), "E_KEYPOINTS_FORMAT"),
    "code": (header("__import__('os').mkdir('evil-was-here')"), "E_KEYPOINTS_FORMAT"),
    "nested": (header("(" * 5000)[:10000], "E_KEYPOINTS_FORMAT"),
    "text": (header("(2, 18, 2)", "'<U4'") + bytes(2000), "E_KEYPOINTS_FORMAT"),
    "records": (header("(2, 18, 2)", "[('a', '<f8')]") + bytes(2000), "E_KEYPOINTS_FORMAT"),
    "complex": (header("(2, 18, 2)", "'<c16'") + bytes(2000), "E_KEYPOINTS_FORMAT"),
    "dates": (header("(2, 18, 2)", "'<M8[s]'") + bytes(2000), "E_KEYPOINTS_FORMAT"),
    "nineteen joints": (header("(2, 19, 2)") + bytes(608), "E_KEYPOINTS_SHAPE"),
    "one axis": (header("(36,)") + bytes(288), "E_KEYPOINTS_SHAPE"),
    "no frame": (header("(0, 18, 2)"), "E_KEYPOINTS_EMPTY"),
    "cut in the header": (header("(2, 18, 2)")[:40], "E_KEYPOINTS_FORMAT"),
    "magic only": (b"\x93NUMPY", "E_KEYPOINTS_FORMAT"),
    "version 9": (b"\x93NUMPY\x09\x00" + header("(2, 18, 2)")[8:], "E_KEYPOINTS_FORMAT"),
    "infinite": (header("(1, 18, 2)") + struct.pack("<d", np.inf) * 36, "E_KEYPOINTS_VALUE"),
    "beyond float32": (header("(1, 18, 2)") + struct.pack("<d", 1e300) * 36, "E_KEYPOINTS_VALUE"),
}


@pytest.mark.parametrize("packed", [False, True], ids=["npy", "npz"])
@pytest.mark.parametrize("kind", BAD_ARRAYS)
def test_a_hostile_array_is_a_typed_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, packed: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    data, code = BAD_ARRAYS[kind]
    if data is None:
        buffer = io.BytesIO()
        np.save(buffer, np.array([_Evil()], dtype=object), allow_pickle=True)
        data = buffer.getvalue()
    path = tmp_path / ("x.npz" if packed else "x.npy")
    if packed:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("one.npy", data)
    else:
        path.write_bytes(data)
    assert code_of(path, "one" if packed else "") == code
    assert not (tmp_path / "evil-was-here").exists()


def test_hostile_archives_are_typed_errors(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(b"PK\x03\x04" + bytes(100))
    assert code_of(path) == "E_KEYPOINTS_BROKEN"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "no arrays")
    assert code_of(path) == "E_KEYPOINTS_MEMBER"
    with zipfile.ZipFile(path, "w") as archive:
        for index in range(20_001):
            archive.writestr(f"{index}.npy", b"")
    assert code_of(path) == "E_KEYPOINTS_LIMIT"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../../evil.npy", header("(1, 18, 2)") + bytes(288))
    ArrayReader().read(path, ArrayReader().members(path)[0])  # a name, never a path
    data = bytearray(path.read_bytes())
    data[6] |= 1  # encrypted
    data[data.rindex(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(bytes(data))
    assert code_of(path) == "E_KEYPOINTS_BROKEN"
    (tmp_path / "empty.npy").touch()
    assert code_of(tmp_path / "empty.npy") == "E_KEYPOINTS_EMPTY"
    assert code_of(tmp_path / "absent.npy") == "E_KEYPOINTS_MISSING"
    assert not ArrayReader().accepts(tmp_path / "empty.npy")


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
def test_a_bomb_costs_no_memory(tmp_path: Path) -> None:
    """Hundreds of megabytes of zeros in two: refused by its header; a header that lies is found out."""
    big = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(big, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("a.npy", "w", force_zip64=True) as file,
    ):
        file.write(header("(1400000, 18, 2)"))
        for _ in range(40):
            file.write(bytes(10 << 20))
    lying = tmp_path / "lying.npz"
    with zipfile.ZipFile(lying, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", header("(400000, 18, 2)") + bytes(64))
    script = (
        "import sys\nfrom pathlib import Path\n"
        "from gesture_core.errors import KeypointError\nfrom gesture_pose_files.arrays import ArrayReader\n"
        "for name in sys.argv[1:]:\n"
        "    try:\n        ArrayReader().read(Path(name))\n"
        "    except KeypointError as error:\n        print(error.code)\n"
        "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, big, lying], capture_output=True, text=True, timeout=60
    )
    first, second, peak = done.stdout.split()
    assert (first, second) == ("E_KEYPOINTS_LIMIT", "E_KEYPOINTS_BROKEN")
    assert int(peak) < 200 * 1024


def test_options_are_checked() -> None:
    for options in ({"fps": 30}, {"frame_size": (16, 9)}, {"options": ReadOptions()}):
        with pytest.raises(ConfigError, match="has no option"):
            registry().make("reader", "arrays", options)


def test_the_real_arrays(shared: Path) -> None:
    reader = ArrayReader()
    paths = sorted((shared / "pose_trainer").rglob("*.npy"))
    assert len(paths) == 112
    missing = total = 0
    for path in paths:
        raw = np.load(path)
        (sequence,) = reader.read(path)
        assert sequence.skeleton == "coco18"
        zero = (raw == 0).all(axis=2)
        np.testing.assert_array_equal(sequence.seen, ~zero)
        np.testing.assert_array_equal(sequence.keypoints[~zero], raw[~zero][:, :2].astype(np.float32))
        missing, total = missing + int(zero.sum()), total + zero.size
    assert 0.15 < missing / total < 0.25


def test_the_real_landmarks(shared: Path) -> None:
    path = shared / "body_gesture" / "landmarks_mediapipe33.npz"
    reader = ArrayReader()
    members = reader.members(path)
    assert len(members) == 225 and "S1__d__greeting_1_1m_upper" in members
    raw = np.load(path)
    for name in members[::20]:
        (sequence,) = reader.read(path, name)
        assert sequence.skeleton == "blazepose33" and sequence.seen.all()
        np.testing.assert_allclose(
            sequence.keypoints, raw[name][..., :2] * np.array([640, 480], np.float32), rtol=1e-6
        )
        np.testing.assert_allclose(sequence.scores, raw[name][..., 3])
        neck = sequence.onto("coco18").keypoints[:, 1]
        np.testing.assert_allclose(neck, sequence.keypoints[:, 11:13].mean(axis=1), rtol=1e-5)


PLACES = {
    "nose": (0, -20), "head_top": (0, -40), "head": (0, -30), "neck": (0, 0), "upper_neck": (0, -10),
    "mid_hip": (0, 60), "spine": (0, 30), "shoulder": (20, 0), "elbow": (24, 30), "wrist": (26, 58),
    "hand": (26, 64), "hand_tip": (26, 70), "thumb": (22, 66), "hip": (10, 60), "knee": (11, 105),
    "ankle": (12, 148), "foot": (14, 152), "eye": (3, -24), "ear": (6, -22), "big_toe": (16, 152),
    "small_toe": (18, 151), "heel": (12, 152),
}  # fmt: skip


@pytest.mark.parametrize(("meant", "taken"), [("kinect25", "body25"), ("h36m17", "coco17")])
def test_an_array_in_the_order_of_another_skeleton_of_its_size_is_refused(
    tmp_path: Path, meant: str, taken: str
) -> None:
    rng = np.random.default_rng(0)
    for order in (meant, taken):
        places = []
        for joint in SKELETONS[order].joints:
            side, _, part = joint.partition("_")
            x, y = PLACES[part if side in ("left", "right") else joint]
            places.append((x if side == "left" else -x, y))
        np.save(tmp_path / f"{order}.npy", 300 + np.array(places) + rng.normal(0, 2, (20, len(places), 2)))
    (right,) = ArrayReader().read(tmp_path / f"{taken}.npy")
    assert right.skeleton == taken
    with pytest.raises(KeypointError, match=f"lie as those of {meant}, not of {taken}") as caught:
        ArrayReader().read(tmp_path / f"{meant}.npy")
    assert f"keypoints.order={meant}" in caught.value.remedy
    for order in (meant, taken):  # who says it is believed
        (pose,) = ArrayReader(ReadOptions(order=(order,))).read(tmp_path / f"{meant}.npy")
        assert pose.skeleton == order


def test_the_remedy_names_the_skeletons_of_a_size(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.ones((9, 20, 3)))
    with pytest.raises(KeypointError) as caught:
        ArrayReader().read(tmp_path / "a.npy")
    assert "keypoints.order=kinect20" in caught.value.remedy


def test_an_ear_and_two_shoulders_are_no_leg_of_another_order(tmp_path: Path) -> None:
    points = np.zeros((20, 17, 2))
    points[:, [4, 5, 6]] = (100, 100), (180, 160), (80, 162)
    np.save(tmp_path / "k.npy", points)
    assert ArrayReader().read(tmp_path / "k.npy")[0].skeleton == "coco17"
