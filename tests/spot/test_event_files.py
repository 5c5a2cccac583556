"""Events as files of other programs, and annotations read back."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.report.event_files import tiers, write_event_files
from gesture_core.run.annotations import annotation_files, read_annotations, unknown_labels
from gesture_core.spot.evaluation import Annotation
from gesture_core.types import Row

ROWS = [
    Row("a/one.mp4", label="wave", status="ok", start=1.0, end=2.5, score=0.5, event=1, seconds=60),
    Row("a/one.mp4", label="clap", status="ok", start=2.2, end=3.25, score=0.25, event=2, seconds=60),
    Row(
        "a/one.mp4",
        label="a <b> & -->",
        status="ok",
        start=4,
        end=5,
        score=0.1,
        person=1,
        event=1,
        seconds=60,
    ),
    Row("b/one.mp4", label="wave", status="ok", start=3661.0, end=3662.0, score=0.9, event=1, seconds=4000),
    Row("c/none.mp4", status="rejected", code="E_NO_EVENT", seconds=10),
]


@pytest.mark.parametrize("format", ["eaf", "vtt"])
def test_a_file_for_each_input_that_is_read_back(format: str, tmp_path: Path) -> None:
    pytest.importorskip({"eaf": "pympi", "vtt": "webvtt"}[format])
    written = write_event_files(ROWS, format, tmp_path / "out")
    assert [path.name for path in written] == [f"one.{format}", f"one-2.{format}", f"none.{format}"]
    marks = list(read_annotations([written[0]], ROWS[:3]))
    said = [row.label if format == "eaf" else f"person {row.person}: {row.label}" for row in ROWS[:3]]
    assert sorted((m.start, m.end, m.label) for m in marks) == [
        (row.start, row.end, label) for row, label in zip(ROWS[:3], said, strict=True)
    ]
    assert list(read_annotations([written[2]], ROWS)) == []


def test_elan_finds_the_recording_from_anywhere_and_beside_the_file(tmp_path: Path) -> None:
    pympi = pytest.importorskip("pympi")
    places = {"a/one.mp4": tmp_path / "my videos" / "one é.mp4", "c/none.mp4": tmp_path / "out" / "none"}
    places["c/none.mp4"].mkdir(parents=True)

    def media(stays: bool) -> list[list[dict[str, str]]]:
        written = write_event_files(ROWS, "eaf", tmp_path / "out", places.get, stays=stays)
        return [pympi.Elan.Eaf(str(path)).media_descriptors for path in written]

    ((one,), gone, keypoints) = media(True)
    assert one["MEDIA_URL"] == f"file://{tmp_path.as_posix()}/my videos/one é.mp4"
    assert one["RELATIVE_MEDIA_URL"] == "../my videos/one é.mp4"
    assert gone == keypoints == [], "what is no video cannot be played"
    assert "RELATIVE_MEDIA_URL" not in media(False)[0][0]
    (path,) = write_event_files([Row("s3://a/b.mp4", code="E_NO_EVENT")], "eaf", tmp_path / "out")
    (far,) = pympi.Elan.Eaf(str(path)).media_descriptors
    assert far["MEDIA_URL"] == "s3://a/b.mp4"


def test_elan_has_a_tier_for_each_person_and_for_what_overlaps() -> None:
    found = tiers(ROWS[:3])
    assert {name: [row.label for row in rows] for name, rows in found.items()} == {
        "person 0": ["wave"],
        "person 0 (2)": ["clap"],
        "person 1": ["a <b> & -->"],
    }


def test_subrip_audacity_and_activitynet(tmp_path: Path) -> None:
    written = write_event_files(ROWS, "srt", tmp_path)
    assert written[1].read_text("utf-8") == "1\n01:01:01,000 --> 01:01:02,000\nwave\n"
    written = write_event_files(ROWS, "audacity", tmp_path / "tracks")
    assert [path.name for path in written] == ["one.txt", "one-2.txt", "none.txt"]
    assert written[0].read_text("utf-8").splitlines()[0] == "1.000000\t2.500000\tperson 0: wave"
    (path,) = write_event_files(ROWS, "activitynet", tmp_path / "events.json")
    results = json.loads(path.read_text("utf-8"))["results"]
    assert results["b/one.mp4"] == [{"label": "wave", "segment": [3661.0, 3662.0], "score": 0.9}]
    assert results["c/none.mp4"] == []


def test_a_run_without_events_is_refused(tmp_path: Path) -> None:
    with pytest.raises(GestureError, match="gesture spot"):
        write_event_files([Row("a.mp4", label="wave", status="ok")], "srt", tmp_path)


def test_annotations_in_a_table(tmp_path: Path) -> None:
    table = tmp_path / "marks.csv"
    table.write_text("path,start,end,label\na/one.mp4,1,2,wave\nnone,3,,clap\n", "utf-8")
    marks = list(read_annotations([table], ROWS))
    assert [(m.input, m.start, m.end, m.label) for m in marks] == [
        ("a/one.mp4", 1, 2, "wave"),
        ("c/none.mp4", 3, 3, "clap"),
    ]


def test_a_table_with_semicolons_has_decimal_commas(tmp_path: Path) -> None:
    table = tmp_path / "marks.csv"
    table.write_text("input;start;end;label\na/one.mp4;1,25;2.5;wave\nnone;3;;clap\n", "utf-8-sig")
    marks = list(read_annotations([table], ROWS))
    assert [(m.start, m.end, m.label) for m in marks] == [(1.25, 2.5, "wave"), (3, 3, "clap")]


def test_annotations_that_are_not_there_are_not_found(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="E_NOT_FOUND"):
        annotation_files(tmp_path / "no.csv")


def test_labels_that_no_event_can_have_are_said(tmp_path: Path) -> None:
    marks = [Annotation("a", n, n + 1, label) for n, label in enumerate("wave Wave Wave winken".split())]
    with pytest.warns(UserWarning, match=r"3 of 4 .*'Wave' \(2, did you mean wave\?\), 'winken' \(1") as said:
        assert unknown_labels(marks, {"wave", "clap"}, "m.csv") == {"Wave": 2, "winken": 1}
    assert str(said[0].message).endswith("the run has clap, wave")
    assert unknown_labels(marks[:1], {"wave"}, "m.csv") == {} == unknown_labels([], {"wave"}, "m.csv")
    with pytest.raises(ConfigError, match=r"E_LABELS .*did you mean wave.*clap, wave"):
        unknown_labels(marks[1:], {"wave", "clap"}, "m.csv")


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("path,start,end,label\nelse,1,2,wave\n", "no input of the run"),
        ("path,start,end,label\none,1,2,wave\n", "may be"),
        ("path,start,end,label\nnone,soon,2,wave\n", "line 2"),
        ("path,start,end,label\nnone,3,2,wave\n", "line 2: its end 2 lies before its start 3"),
        ("path;start;end;label\nnone;2,9;0,0;wave\n", "line 2: its end 0 lies before its start 2.9"),
        ("path,start,end,label\nnone,-1,2,wave\n", "line 2: -1 lies before the start of the recording"),
        ("path,start,end,label\nnone,nan,2,wave\n", "line 2: has no time"),
        ('path,start,end,label\nnone,"1,5",2,wave\n', "line 2: has no time"),
        ("path,begin,label\nnone,3,wave\n", "columns"),
    ],
)
def test_annotations_that_cannot_be_used_are_refused(text: str, cause: str, tmp_path: Path) -> None:
    table = tmp_path / "marks.csv"
    table.write_text(text, "utf-8")
    with pytest.raises((InputError, ConfigError), match=cause):
        list(read_annotations([table], ROWS))


def test_one_recording_marked_in_two_files_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("pympi")
    pytest.importorskip("webvtt")
    for format in ("eaf", "vtt"):
        write_event_files(ROWS[3:], format, tmp_path)
    with pytest.raises(ConfigError, match="two files"):
        list(read_annotations(annotation_files(tmp_path), ROWS[3:]))


@pytest.mark.parametrize("name", ["none.eaf", "none.vtt"])
def test_files_of_another_kind_are_refused(name: str, tmp_path: Path) -> None:
    pytest.importorskip("pympi")
    pytest.importorskip("webvtt")
    (tmp_path / name).write_text("no such thing", "utf-8")
    with pytest.raises(InputError, match="is no"):
        list(read_annotations(annotation_files(tmp_path), ROWS))
