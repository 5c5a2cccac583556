"""Labels from tables as people write them: other separators, capitals, spaces, accents, mistakes."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Literal

import pytest

from gesture_core.errors import ConfigError, InputError
from gesture_core.run.inputs import Input, discover
from gesture_core.run.labels import label_inputs
from gesture_core.run.tables import read_labels


@pytest.fixture
def clips(tmp_path: Path) -> list[Input]:
    """``wave/bén 2.avi`` and ``clap/1.avi``."""
    for name in ("wave/bén 2.avi", "clap/1.avi"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    return discover([tmp_path])


def labels(clips: list[Input], table: Path, text: str) -> list[str | None]:
    table.write_text(text, encoding="utf-8")
    return [item.label for item in label_inputs(clips, str(table), [table.parent])]


@pytest.mark.parametrize(
    "text",
    [
        "path;label\nclap/1.avi;no\nwave/bén 2.avi;yes\n",
        "path\tlabel\r\nclap/1.avi\tno\r\nwave/bén 2.avi\tyes\r\n",
        "\ufefflabel,File\nno,clap/1.avi\n yes ,wave/bén 2.avi\n\n",
        'Path, Label\nclap/1.avi, no\n"wave/bén 2.avi", yes\n',
        unicodedata.normalize("NFD", "path,label\nclap/1.avi,no\nwave/bén 2.avi,yes\n"),
    ],
)
def test_tables_of_spreadsheets_and_other_systems(clips: list[Input], tmp_path: Path, text: str) -> None:
    assert labels(clips, tmp_path / "labels.csv", text) == ["no", "yes"]
    if text == unicodedata.normalize("NFC", text):  # a path that is opened is spelled as it is
        assert {item.label for item in discover([tmp_path / "labels.csv"])} == {"no", "yes"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("path,label\nclap/1.avi,no\n", "has no line for it"),
        ("path,label\nclap/1.avi,no\nwave/ben 2.avi,yes\n", r"has no line for it.*'wave/ben 2\.avi' is near"),
        ("path,label\nclap/1.avi,no\nwave/bén 2.avi,\n", "its line there has no label"),
        ("path,word,kind\nclap/1.avi,no,1\n", r"no column 'label', but path, word, kind.*--label-columns"),
        ("where,label\nclap/1.avi,no\n", r"no column 'path', but where, label.*--label-columns"),
        ("path,class,sign\nclap/1.avi,0,no\n", r"no column 'label', but path, class, sign"),
        ("a,b\nc,d\n", r"has no header, and no line about any input: its first line is 'a,b'"),
        ("", "is empty"),
    ],
)
def test_what_a_table_lacks_is_said(clips: list[Input], tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        labels(clips, tmp_path / "labels.csv", text)
    assert caught.value.code == "E_LABELS"


def test_a_line_is_near_by_its_own_path_and_not_by_the_folder_of_all(
    clips: list[Input], tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match="has no line for it; try"):
        labels(clips, tmp_path / "labels.csv", "path,label\nclap/1.avi,no\n")


def test_other_encodings_and_endless_names_are_mistakes(clips: list[Input], tmp_path: Path) -> None:
    table = tmp_path / "labels.csv"
    text = "path,label\nclap/1.avi,no\n"
    table.write_bytes(text.encode("utf-16"))
    with pytest.raises(ConfigError, match=r"is not text in UTF-8; try: saving it as UTF-8"):
        label_inputs(clips, str(table), [tmp_path])
    for name, data in (("a.csv", text.encode() + b"clap\0/2.avi,no\n"), ("a.txt", "clap".encode("utf-16"))):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=r"E_MANIFEST .*is not text in UTF-8; try: saving it as UTF-8"):
            discover([tmp_path / name])
    (tmp_path / "a.csv").write_bytes(text.replace("no", "grüßen").encode("cp1252"))
    with pytest.raises(InputError, match=r"E_MANIFEST .*is not text in UTF-8"):
        discover([tmp_path / "a.csv"])
    (tmp_path / "a.csv").write_text(f"{text}{'x' * 300},no\n")
    with pytest.raises(InputError, match=r"E_NOT_FOUND .*no such file"):
        discover([tmp_path / "a.csv"])


def test_two_labels_for_one_clip_are_refused(clips: list[Input], tmp_path: Path) -> None:
    twice = "path,label\nclap/1.avi,no\nwave/bén 2.avi,yes\n./clap/1.avi,{}\n"
    assert labels(clips, tmp_path / "labels.csv", twice.format("no")) == ["no", "yes"]
    with pytest.raises(InputError, match=r"is listed as no and as yes.*one line for it") as caught:
        labels(clips, tmp_path / "labels.csv", twice.format("yes"))
    assert caught.value.code == "E_CONTRADICTION"


def test_one_word_spelled_in_two_ways_is_one_label(tmp_path: Path) -> None:
    forms: tuple[Literal["NFC", "NFD"], ...] = ("NFC", "NFD")
    for number, form in enumerate(forms):
        folder = tmp_path / str(number) / unicodedata.normalize(form, "grüßen")
        folder.mkdir(parents=True)
        (folder / "1.avi").touch()
    roots = [tmp_path / "0", tmp_path / "1"]
    found = label_inputs(discover(roots), "folder", roots)
    assert [item.label for item in found] == [unicodedata.normalize("NFC", "grüßen")] * 2


@pytest.mark.parametrize(
    ("name", "expression", "found"),
    [
        ("张三挥手1.avi", "(挥手)", "挥手"),  # words without spaces between them
        ("手势wave_1.avi", "(wave)_", "wave"),
        ("andrés01.avi", "s([0-9]+)", "01"),
    ],
)
def test_a_label_beside_another_writing_is_whole(
    tmp_path: Path, name: str, expression: str, found: str
) -> None:
    (tmp_path / name).touch()
    assert label_inputs(discover([tmp_path]), expression, [tmp_path])[0].label == found


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("expression", ["(?P<label>[a-z]+)_", "^(?P<label>[a-z]+)", "([a-z]+)_1"])
def test_half_a_word_is_no_label(tmp_path: Path, form: Literal["NFC", "NFD"], expression: str) -> None:
    (tmp_path / unicodedata.normalize(form, "grüßen_1.avi")).touch()
    items = discover([tmp_path])
    with pytest.raises(ConfigError, match=r"E_LABELS .* finds '(gr|gru|en)' inside a word of .*avi; try: "):
        label_inputs(items, expression, [tmp_path])
    assert [item.label for item in label_inputs(items, r"^(?P<label>.+?)_", [tmp_path])] == ["grüßen"]
    (tmp_path / "waves_1.avi").touch()
    assert label_inputs(discover([tmp_path / "waves_1.avi"]), "(wave)", [tmp_path])[0].label == "wave"


def test_a_folder_inside_another_keeps_its_own_line(clips: list[Input], tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text("path,label\n.,all\nclap,clap\n")
    with pytest.raises(InputError, match=r"1\.avi: is listed as all and as clap"):
        discover([tmp_path / "list.csv"])


def test_a_clip_above_the_folders_of_labels_is_told_so(clips: list[Input]) -> None:
    with pytest.raises(ConfigError, match=r"it lies in no folder below .*clap"):
        label_inputs(clips, "folder", [clips[0].path.parent])


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("filename,class\nclap/1.avi,no\nwave/bén 2.avi,yes\n", ""),
        ("\ufefffilename;class;x\nclap/1.avi;no;1\nwave/bén 2.avi;yes;2\n", ""),
        (",path,label\n0,clap/1.avi,no\n1,wave/bén 2.avi,yes\n", ""),
        ("video_id,label\nclap/1,no\nwave/bén 2,yes\n", ""),
        ("video_id,label\n1,no\nbén 2,yes\n", ""),
        ("path,signer,sign\nclap/1.avi,7,no\nwave/bén 2.avi,8,yes\n", ""),
        ("path,label\nclap\\1.avi,no\nwave\\bén 2.avi,yes\n", ""),
        ("clap/1.avi,no\nwave/bén 2.avi,yes\n", ""),
        ("clap/1.avi\tno\nwave/bén 2.avi\tyes\n", ""),
        ("where;what\nclap/1.avi;no\nwave/bén 2.avi;yes\n", "where,what"),
        ("Id,Where,What\n1,clap/1.avi,no\n2,wave/bén 2.avi,yes\n", "WHERE, what"),
        ("no,7,clap/1.avi\nyes,8,wave/bén 2.avi\n", "3,1"),
        ("path,label,gesture\nclap/1.avi,0,no\nwave/bén 2.avi,1,yes\n", "path,gesture"),
        ("# of June\n\n# by me\npath,label\nclap/1.avi,no\nwave/bén 2.avi,yes\n", ""),
    ],
)
def test_tables_of_others(clips: list[Input], tmp_path: Path, text: str, columns: str) -> None:
    table = tmp_path / "labels.csv"
    table.write_text(text, encoding="utf-8")
    found = label_inputs(clips, str(table), [tmp_path], columns)
    assert [item.label for item in found] == ["no", "yes"]


def test_a_table_in_another_folder_and_of_another_computer(clips: list[Input], tmp_path: Path) -> None:
    table = tmp_path / "tables" / "labels.tsv"
    table.parent.mkdir()
    assert labels(clips, table, "path\tlabel\nclap/1.avi\tno\nwave/bén 2.avi\tyes\n") == ["no", "yes"]
    for root in ("/data/archive/", "D:\\data\\", "https://host/data/", "file:///data/"):
        text = f"path\tlabel\n{root}clap/1.avi\tno\n{root}wave/bén 2.avi\tyes\n"
        with pytest.warns(
            UserWarning, match="2 of 2 inputs were found by the end of a path that is not here"
        ):
            assert labels(clips, table, text) == ["no", "yes"]
    with pytest.raises(ConfigError, match="no line for it"):
        labels(clips, table, "path\tlabel\nclap/1.avi\tno\nhands/bén 2.avi\tyes\n")


def test_space_separates_only_where_it_always_does(tmp_path: Path) -> None:
    (tmp_path / "a.avi").touch()
    items, table = discover([tmp_path]), tmp_path / "labels.csv"
    assert labels(items, table, "path label\na.avi no\n") == ["no"]
    with pytest.raises(ConfigError, match="no column 'path'"):
        labels(items, table, "path label\na.avi no\nb c.avi yes\n")


def test_one_line_is_about_one_clip(tmp_path: Path) -> None:
    for name in ("a/1.avi", "b/1.avi"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    items = discover([tmp_path])
    with pytest.raises(ConfigError, match=r"one line, 1, could be about .*a/1\.avi and .*b/1\.avi"):
        labels(items, tmp_path / "labels.csv", "name,label\n1,no\n")
    with pytest.raises(InputError, match="is listed as no and as yes"):
        labels(items, tmp_path / "labels.csv", "name,label\n1,no\n1.avi,yes\n1,yes\n")
    assert labels(items, tmp_path / "labels.csv", "name,label\na/1,no\nb/1,yes\n") == ["no", "yes"]


@pytest.mark.parametrize("columns", ["path", "path,", "a,b,c"])
def test_columns_are_two(clips: list[Input], tmp_path: Path, columns: str) -> None:
    (tmp_path / "labels.csv").write_text("path,label\nclap/1.avi,no\n")
    with pytest.raises(ConfigError) as caught:
        label_inputs(clips, str(tmp_path / "labels.csv"), [tmp_path], columns)
    assert caught.value.code == "E_OPTION"
    with pytest.raises(ConfigError, match="has no column 'z'"):
        label_inputs(clips, str(tmp_path / "labels.csv"), [tmp_path], "path,z")
    with pytest.raises(ConfigError, match="without a table"):
        label_inputs(clips, "folder", [tmp_path], "path,label")


def test_manifests_with_separators_of_windows(clips: list[Input], tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text("path,label\nclap\\1.avi,no\n")
    assert [item.label for item in discover([tmp_path / "list.csv"])] == ["no"]
    (tmp_path / "list.txt").write_text("clap\\1.avi\n", newline="\r\n")
    assert len(discover([tmp_path / "list.txt"])) == 1


def test_a_list_of_videos_is_one_of_their_keypoints(clips: list[Input], tmp_path: Path) -> None:
    text = "path,label\nclap/1.mov,no\nwave/bén 2.mp4,yes\n"
    with pytest.warns(UserWarning, match="2 of 2 inputs .* or of a video of their name"):
        assert labels(clips, tmp_path / "labels.csv", text) == ["no", "yes"]
    with pytest.raises(ConfigError, match="no line for it"):
        labels(clips, tmp_path / "labels.csv", "path,label\nclap/1.txt,no\nwave/bén 2.txt,yes\n")


def test_a_remark_above_a_table_is_no_file_of_such_a_name(tmp_path: Path) -> None:
    table = tmp_path / "labels.csv"
    table.write_text("# made by hand, in May\n#path,label\n#1.mp4,wave\n# 2.mp4,up\n")
    assert read_labels(table)[0] == [("#1.mp4", "wave"), ("# 2.mp4", "up")]


def test_lines_about_clips_that_are_not_there_are_said(clips: list[Input], tmp_path: Path) -> None:
    text = "path,label\nclap/1.avi,no\nwave/bén 2,yes\nwave/3.avi,yes\nwave/4.avi,yes\n"
    with pytest.warns(UserWarning, match=r"2 of 4 lines are about no input here, the first is wave/3\.avi"):
        assert labels(clips, tmp_path / "labels.csv", text) == ["no", "yes"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("labels.xlsx", "is a file, and no table of text"),
        ("labels", "is a folder"),
        ("no.tsv", "no such file"),
    ],
)
def test_what_is_no_table_is_no_expression_either(
    clips: list[Input], tmp_path: Path, name: str, said: str
) -> None:
    (tmp_path / "labels.xlsx").write_bytes(b"PK")
    (tmp_path / "labels").mkdir()
    with pytest.raises(ConfigError, match=said):
        label_inputs(clips, str(tmp_path / name), [tmp_path])
