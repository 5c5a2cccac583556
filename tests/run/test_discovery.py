"""What the user typed becomes a stable list of inputs, each once, under any name."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable
from gesture_core.run.inputs import discover
from gesture_core.run.labels import label_inputs
from gesture_core.run.tables import read_labels


def names(*sources: str | Path, avoid: Path | None = None) -> list[str]:
    return [Path(item.name).name for item in discover([str(s) for s in sources], avoid=avoid)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("b.mp4", "a.MP4", "sub/c.avi", "notes.txt", ".hidden.mp4", "table.csv"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"path,other\nnothing,here\n" if name.endswith("csv") else b"x")
    return tmp_path


def test_a_folder_is_walked_in_a_stable_order(folder: Path) -> None:
    items = discover([str(folder)])
    assert [Path(i.name).name for i in items] == ["a.MP4", "b.mp4", "notes.txt", "c.avi", "table.csv"]
    assert [i.kind for i in items] == ["video", "video", "other", "video", "other"]
    assert all(i.fault for i in items if i.kind == "other")


def test_the_run_folder_is_not_walked_into(folder: Path) -> None:
    assert names(folder, avoid=folder / "sub") == ["a.MP4", "b.mp4", "notes.txt", "table.csv"]


def test_an_input_named_twice_counts_once(folder: Path) -> None:
    assert names(folder / "b.mp4", folder / "*.mp4", folder / "sub") == ["b.mp4", "c.avi"]


def test_links_back_to_a_folder_above_end(folder: Path) -> None:
    (folder / "sub" / "loop").symlink_to(folder, target_is_directory=True)
    assert (
        names(folder)
        == names(folder, avoid=folder / "nothing")
        == ["a.MP4", "b.mp4", "notes.txt", "c.avi", "table.csv"]
    )


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="only Linux makes up such folders")
def test_what_the_system_makes_up_is_not_walked_into(folder: Path) -> None:
    (folder / "sub" / "system").symlink_to("/proc/self", target_is_directory=True)
    made_up = [item for item in discover([str(folder)]) if item.kind == "broken"]
    assert [(item.path.name, item.code) for item in made_up] == [("system", "E_READ")]
    assert "made up by the system" in made_up[0].fault
    assert [item.kind for item in discover(["/proc/self"])] == ["broken"], "one row that says so"


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_quoted_path_in_a_table_keeps_its_line_break(tmp_path: Path, ends: str) -> None:
    odd = tmp_path / "two\nlines.mp4"
    for path in (odd, tmp_path / "plain.mp4"):
        path.write_bytes(b"")
    manifest = tmp_path / "list.csv"
    manifest.write_bytes(
        ends.join(["path,label", '"two\nlines.mp4",wave', "", "plain.mp4,clap", ""]).encode()
    )
    found = {item.path: item.label for item in discover([manifest])}
    assert found == {odd: "wave", tmp_path / "plain.mp4": "clap"}
    assert read_labels(manifest) == ([("two\nlines.mp4", "wave"), ("plain.mp4", "clap")], True)
    bare = tmp_path / "bare.csv"
    bare.write_text('"two\nlines.mp4",wave\nplain.mp4,clap\n')
    assert read_labels(bare)[0] == read_labels(manifest)[0]


def test_text_and_csv_manifests(folder: Path) -> None:
    (folder / "list.txt").write_text("# comment\nb.mp4\n\nsub\n")
    assert names(folder / "list.txt") == ["b.mp4", "c.avi"]
    (folder / "list.csv").write_text("path,label\nb.mp4,wave\nsub/c.avi,clap\n")
    items = discover([str(folder / "list.csv")])
    assert [i.label for i in items] == ["wave", "clap"]
    assert [i.label for i in label_inputs(items, "folder", [folder])] == ["wave", "clap"]
    (folder / "list.txt").write_text("absent.mp4\n")
    with pytest.raises(InputError, match=r"absent\.mp4: .*list\.txt, which is read as a list of paths"):
        names(folder / "list.txt")


def test_what_does_not_exist_is_a_usage_error(folder: Path) -> None:
    for source in ("absent", "*.xyz"):
        with pytest.raises(InputError) as caught:
            names(folder / source)
        assert caught.value.code == "E_NOT_FOUND"


def test_labels_from_folders_tables_and_expressions(folder: Path) -> None:
    root = folder / "examples"
    for name in ("wave/1.mp4", "clap/deep/2.mp4"):
        (root / name).parent.mkdir(parents=True)
        (root / name).write_bytes(b"x")
    items = discover([str(root)])
    assert [i.label for i in label_inputs(items, "folder", [root])] == ["clap", "wave"]
    (folder / "labels.csv").write_text("path,label\nexamples/wave/1.mp4,A\nexamples/clap/deep/2.mp4,B\n")
    assert [i.label for i in label_inputs(items, str(folder / "labels.csv"), [root])] == ["B", "A"]
    assert [i.label for i in label_inputs(items, r"(?P<label>\d)\.mp4$", [root])] == ["2", "1"]
    for bad in ("(", "nogroup", r"(z+)", str(folder / "absent.csv")):
        with pytest.raises(ConfigError):
            label_inputs(items, bad, [root])
    with pytest.raises(ConfigError, match="no label"):
        label_inputs(discover([str(folder / "b.mp4")]), "folder", [folder])


@pytest.mark.skipif(os.name != "posix", reason="other systems have no such names")
def test_any_bytes_may_stand_in_a_name(tmp_path: Path) -> None:
    odd = [
        b"\xff\xfe.mp4",
        b"-dash.mp4",
        b"new\nline.mp4",
        b"quote'\".mp4",
        b"%d.mp4",
        b"a:b.mp4",
        b" s .mp4",
    ]
    for name in odd:
        (tmp_path / os.fsdecode(name)).write_bytes(b"x")
    items = discover([tmp_path])
    assert {os.fsencode(item.path.name) for item in items} == set(odd)
    assert len({item.key for item in items}) == len(odd)
    for item in items:
        item.name.encode("utf-8")
    assert printable(os.fsdecode(b"\xff.mp4")) == "\\xff.mp4"


def test_keypoint_files_and_folders_are_inputs(drawn: DemoArchive, tmp_path: Path) -> None:
    shutil.copytree(drawn.video_keypoints, tmp_path / "k")
    shutil.copy(drawn.videos / "clip_01.mp4", tmp_path / "k")
    items = discover([str(tmp_path / "k")])
    assert {item.kind for item in items} == {"video", "keypoints"}
    assert len(items) == 13
    assert {item.reader for item in items} == {"", "openpose-json"}


def test_an_expression_is_searched_in_the_name_and_in_the_path_only_if_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "lab" / "run_1" / "x").mkdir(parents=True)
    for name in ("Clip.avi", "raise-arms_1.avi"):
        (tmp_path / "lab" / "run_1" / "x" / name).touch()
    items = discover([tmp_path / "lab"])
    with pytest.raises(ConfigError, match=r"no label for .*Clip\.avi.*searched in the whole path"):
        label_inputs(items, r"(?P<label>[a-z]+)_[0-9]", [tmp_path])
    assert [i.label for i in label_inputs(items[1:], r"^(?P<label>[a-z-]+)_[0-9]", [tmp_path])] == [
        "raise-arms"
    ]
    assert [i.label for i in label_inputs(items, r"lab/(?P<label>[a-z]+)_", [tmp_path])] == ["run", "run"]


def test_an_expression_is_searched_in_the_name_of_a_sequence(tmp_path: Path) -> None:
    points = np.ones((9, 18, 2))
    arrays: dict[str, Any] = {"wave_1": points, "Clip": points}
    np.savez(tmp_path / "set_1.npz", **arrays)
    items = discover([tmp_path])
    assert [i.label for i in label_inputs(items[:1], "([a-z]+)_", [tmp_path])] == ["wave"]
    with pytest.raises(ConfigError, match="Clip"):
        label_inputs(items, "([a-z]+)_", [tmp_path])
    assert [i.label for i in label_inputs(items, "([a-z]+)_1.npz::", [tmp_path])] == ["set", "set"]


def test_frames_right_in_the_folder_of_a_label_are_told_where_they_belong(
    drawn: DemoArchive, tmp_path: Path
) -> None:
    shutil.copytree(drawn.example_keypoints / "wave" / "1", tmp_path / "wave")
    with pytest.raises(ConfigError, match=r"a folder for each clip, such as .*/wave/1/\*_keypoints\.json"):
        label_inputs(discover([tmp_path]), "folder", [tmp_path])
