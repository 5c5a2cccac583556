"""Which level of an archive's folders is the label, and when that must be asked."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from gesture_core.errors import ConfigError
from gesture_core.run.inputs import discover
from gesture_core.run.labels import label_folders, label_inputs

GESTURES = ("circle", "clap", "wave")


def archive(root: Path, *places: str) -> Path:
    for place in places:
        for clip in ("1.avi", "2.avi"):
            (root / place).mkdir(parents=True, exist_ok=True)
            (root / place / clip).touch()
    return root


def labels(labels: str, *roots: Path) -> set[str | None]:
    return {item.label for item in label_inputs(discover(roots), labels, roots)}


def two(above: tuple[str, ...], below: tuple[str, ...] = GESTURES) -> tuple[str, ...]:
    return tuple(f"{a}/{b}" for a in above for b in below)


@pytest.mark.parametrize(
    ("places", "remedy"),
    [
        (
            two(("train", "val", "test")),
            "--labels folder:-1 for circle, clap, wave; --labels folder:0 if test, ",
        ),
        (two(("Train", "TEST")), "--labels folder:-1 for circle"),
        (two(("train",)), "--labels folder:-1 for circle"),
        (two(("train_set", "test")), None),
        (two(("training1", "training2")), "--labels folder:-1 for circle"),
        (two(("p1", "p2", "p3")), "--labels folder:-1 for circle"),
        (two(("anna", "ben")), "--labels folder:-1 for circle, clap, wave; --labels folder:0 if anna, ben"),
        (("anna/clap", "anna/wave", "ben/clap", "ben/circle"), "--labels folder:-1 for circle"),
        (two(("S01", "S02"), ("G1", "G2")), "--labels folder:-1 for G1, G2; --labels folder:0 if S01, S02"),
        (two(("anna",)), "--labels folder:-1 for circle"),
        (("2024-01-02/clap", "2024-01-03/wave", "2024-02-03/circle"), "--labels folder:-1 for circle"),
        (("20240102/clap", "20240103/wave"), "--labels folder:-1 for clap, wave"),
        (("P001/clap", "P002/wave", "P003/circle"), "--labels folder:-1 for circle, clap, wave"),
        (two(("data/v1",)), "--labels folder:-1 for circle, clap, wave; --labels folder:0 if data"),
        (two(two(("data/v1",), ("p1", "p2"))), "--labels folder:-1 for circle"),
        (two(("train/p1", "train/p2", "test/p3")), "--labels folder:-1 for circle"),
        (two(two(("train", "test")), ("cam1", "cam2")), "--labels folder:1 for circle"),
        (two(GESTURES, ("indoor", "outdoor")), "--labels folder:0 if circle, clap, wave"),
        (
            two(two(("data/v1",), ("anna", "ben"))),
            "folder:-1 for circle, clap, wave; --labels folder:2 for anna",
        ),
        (
            two(two(("anna", "ben"), ("data/v1",))),
            "--labels folder:-1 for circle, clap, wave; --labels folder:0",
        ),
        (two(two(("p1", "p2"), ("clips",))), "--labels folder:-1 for circle, clap, wave; --labels folder:0"),
        (
            two(two(("data",), ("anna", "ben")), ("v1/circle", "v1/clap")),
            "--labels folder:-1 for circle, clap",
        ),
        (
            ("data/train/s1/wave", "data/train/s1/push", "data/test/s2/wave"),
            "try: --labels folder:-1 for push, wave; --labels folder:0",
        ),
        (two(("data/v1", "data/v2")), "--labels folder:-1 for circle, clap, wave; --labels folder:0 if data"),
        (
            two(two(("anna", "ben")), ("rgb", "depth")),
            "--labels folder:1 for circle, clap, wave; --labels folder:0",
        ),
        (
            two(two(("data/v1",)), ("anna", "ben")),
            "--labels folder:2 for circle, clap, wave; --labels folder:0",
        ),
        (two(two(("anna", "ben")), ("v1",)), "--labels folder:1 for circle, clap, wave; --labels folder:0"),
        (("train", "test"), "a table or a regular expression, or --labels folder:0 if test, train"),
    ],
)
def test_another_level_that_looks_like_the_label_is_asked_about(
    tmp_path: Path, places: tuple[str, ...], remedy: str | None
) -> None:
    root = archive(tmp_path / "archive", *places)
    if remedy is None:
        remedy = "--labels folder:-1 for circle, clap, wave"
    with pytest.raises(ConfigError, match=re.escape(remedy)) as caught:
        labels("folder", root)
    assert caught.value.code == "E_LABELS"
    assert labels("folder:0", root) == {Path(place).parts[0] for place in places}
    if "folder:-1" in remedy:
        assert labels("folder:-1", root) == {Path(place).parts[-1] for place in places}


@pytest.mark.parametrize(
    "places",
    [
        GESTURES,
        two(GESTURES, ("s1", "s2", "s3")),
        two(GESTURES, ("2024-01-01", "2024-01-02")),
        two(("gesture_1", "gesture_2"), ("subject_1", "subject_2")),
        two(GESTURES, ("rgb",)),
        ("1/anna", "2/ben", "3/carl"),
        ("2024-01-02", "2024-01-03"),
        ("clap/deep", "wave"),
        ("clap/anna", "clap/ben", "wave/carl", "circle/dora", "circle/emil"),
        ("test", "wave", "clap"),
    ],
)
def test_the_first_level_is_the_label_where_nothing_speaks_against_it(
    tmp_path: Path, places: tuple[str, ...]
) -> None:
    root = archive(tmp_path / "archive", *places)
    assert labels("folder", root) == {Path(place).parts[0] for place in places}


def test_levels_are_counted_from_both_ends(tmp_path: Path) -> None:
    root = archive(tmp_path / "archive", "train/anna/wave", "test/ben/clap")
    assert labels("folder:0", root) == {"train", "test"}
    assert labels("folder:1", root) == labels("folder:-2", root) == {"anna", "ben"}
    assert labels("folder:2", root) == labels("folder:-1", root) == {"wave", "clap"}
    with pytest.raises(ConfigError, match=r"lies in no folder below .* with number 3"):
        labels("folder:3", root)
    manifest = tmp_path / "list.txt"
    manifest.write_text("archive/train/anna/wave/1.avi\n")
    assert labels("folder:-1", manifest) == {"wave"}


def test_a_pattern_of_label_folders_works_as_their_folder(tmp_path: Path) -> None:
    root = archive(tmp_path / "examples", *GESTURES)
    (root / "README.md").touch()
    by_shell = sorted(root.iterdir())
    assert labels("folder", *by_shell) - {None} == labels("folder", root / "*") - {None} == set(GESTURES)
    with pytest.raises(ConfigError, match=rf"the folder above, {re.escape(str(root))}, if clap is the label"):
        labels("folder", root / "clap")
    assert labels("folder:-1", root / "clap") == {"clap"}
    parts = archive(tmp_path / "archive", *two(("train", "test")))
    assert labels("folder", parts / "train", parts / "test") == set(GESTURES)


@pytest.mark.parametrize(
    "names", [("train", "val"), ("Test", "training"), ("s01", "s02"), ("subject 1", "subject 2")]
)
def test_folders_of_clips_side_by_side_that_are_no_labels_are_asked_about(
    names: tuple[str, str], tmp_path: Path
) -> None:
    root = archive(tmp_path, *names)
    with pytest.raises(ConfigError, match="--labels folder:-1 if") as caught:
        labels("folder", *(root / name for name in names))
    assert caught.value.code == "E_LABELS"
    assert labels("folder:-1", *(root / name for name in names)) == set(names)
    wanted = archive(tmp_path / "others", "take1", "wave")
    assert labels("folder", wanted / "take1", wanted / "wave") == {"take1", "wave"}


def test_labels_on_several_levels_are_said(tmp_path: Path) -> None:
    root = archive(tmp_path / "archive", "s1/circle", "s1/clap", "wave", "nod/take1", "nod/take2")
    with pytest.warns(UserWarning, match="s1 holds the folders circle, clap, where other labels hold clips"):
        assert labels("folder", root) == {"s1", "wave", "nod"}
    assert labels("folder:-1", root) == {"circle", "clap", "wave", "take1", "take2"}
    deeper = archive(tmp_path / "deeper", "data/v1/circle", "data/v1/clap", "wave")
    with pytest.warns(
        UserWarning, match="data holds the folders circle, clap, where other labels hold clips"
    ):
        labels("folder", deeper)


def test_what_systems_and_disks_keep_is_no_label(tmp_path: Path) -> None:
    kept = (
        "@eaDir",
        "#recycle",
        "__MACOSX",
        "$RECYCLE.BIN",
        "System Volume Information",
        "lost+found",
        ".git",
    )
    root = archive(tmp_path / "archive", "wave", "clap", *kept, "wave/@eaDir", "clap/#recycle")
    found = discover([root])
    assert [item.path.parent.name for item in found] == ["clap"] * 2 + ["wave"] * 2
    assert label_folders(found, [root], tmp_path / "run") == {"wave", "clap"}


def test_a_video_and_its_keypoints_are_said_to_be_two_clips(tmp_path: Path) -> None:
    root = archive(tmp_path / "archive", "wave", "clap")
    np.save(root / "wave" / "1.npy", np.ones((9, 17, 3), np.float32))
    with pytest.warns(UserWarning, match=r"one clip is there .* count twice: .*wave/1.avi and .*wave/1.npy"):
        labels("folder", root)
