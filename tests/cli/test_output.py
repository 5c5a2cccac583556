"""What a terminal shows of a result: the table, the label of the nearest example, the reasons."""

from __future__ import annotations

from dataclasses import replace

import pytest
from rich.console import Console

from gesture_core.cli import output
from gesture_core.cli.output import counted, named, print_reasons, row_table
from gesture_core.types import Row


def rows() -> list[Row]:
    clears = "in/c\x1b[2J.mp4"
    near = (("examples/wave/1.mp4", "wave", 0.25),)
    return [
        Row("in/a.mp4", label="wave", distance=0.25, margin=0.5, neighbors=near, status="ok"),
        Row("in/b.mp4", status="skipped", code="E_NOT_AN_INPUT", message="in/b.mp4: neither"),
        Row(clears, person=2, status="error", code="E_MEDIA_BROKEN", message=f"{clears}: no"),
    ]


def test_the_table_names_the_label_of_the_nearest_example(capsys: pytest.CaptureFixture[str]) -> None:
    row_table(rows())
    said = capsys.readouterr().out
    assert "wave/1.mp4" in said and "examples/" not in said and "in/" not in said
    assert "0.250" in said and "#2" in said and "error E_MEDIA_BROKEN" in said
    assert "\x1b" not in said
    row_table([Row("a.mp4", neighbors=(("persons/anna/wave_1.mp4", "wave", 0.2),), status="ok")])
    said = capsys.readouterr().out
    assert "wave_1.mp4" in said and "anna" not in said, "a folder that is no label tells nothing"


def test_where_rows_have_a_confidence_it_is_in_the_place_of_the_margin(
    capsys: pytest.CaptureFixture[str],
) -> None:
    row_table([Row("a.mp4", label="wave", distance=0.2, margin=0.5, confidence=0.875, status="ok")])
    said = capsys.readouterr().out
    assert "confidence" in said and "0.875" in said and "margin" not in said
    row_table([Row("a.mp4", label="wave", distance=0.2, margin=0.5, score=0.625, status="ok")])
    said = capsys.readouterr().out
    assert "score" in said and "0.625" in said and "margin" not in said


def test_keypoints_have_a_table_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    row_table(
        [
            Row(
                "in/a.mp4",
                frames_read=80,
                frames_looked_at=40,
                frames_with_pose=38,
                seconds=1.95,
                status="ok",
            ),
            *rows(),
        ],
        what="keypoints",
    )
    said = capsys.readouterr().out
    assert "label" not in said and "with a pose" in said
    assert [cell for cell in said.splitlines()[3].split() if cell] == ["a.mp4", "80", "40", "38", "1.9", "ok"]


def test_reasons_stand_below_the_worst_first(capsys: pytest.CaptureFixture[str]) -> None:
    print_reasons(rows())
    first, second = capsys.readouterr().out.splitlines()
    assert first == "error E_MEDIA_BROKEN in/c\\x1b[2J.mp4: no"
    assert second == "skipped E_NOT_AN_INPUT in/b.mp4: neither"
    print_reasons([replace(row, message=f"{n}") for n in range(30) for row in rows()[2:]])
    assert "… and 10 more reasons" in capsys.readouterr().out.splitlines()[-1]


def test_what_several_rows_say_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    other = [
        Row(f"q/{n}.csv", status="error", code="E_DIMENSIONS", message=f"q/{n}.csv: has no z") for n in "abc"
    ]
    print_reasons([*other, replace(other[0], person=1), replace(other[2], message="q/c.csv: has no x")])
    assert capsys.readouterr().out.splitlines() == [
        "4 error E_DIMENSIONS has no z",
        "  q/a.csv, q/b.csv, q/c.csv",
        "error E_DIMENSIONS q/c.csv: has no x",
    ]


def test_rows_without_a_label_for_one_reason_are_one_group(capsys: pytest.CaptureFixture[str]) -> None:
    near = (("examples/wave/1.mp4", "wave", 0.25),)
    far = [
        Row(f"in/{n}.mp4", distance=0.9, neighbors=near, status="rejected", code="E_REJECTED", message="far")
        for n in range(3)
    ]
    print_reasons(
        [
            *rows(),
            *far,
            *(Row(f"in/{n}.md", status="skipped", code="E_NOT_AN_INPUT", message="n") for n in "xy"),
        ]
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("error E_MEDIA_BROKEN") and lines[1].startswith("3 rejected E_REJECTED: ")
    assert (
        "would have been" in "\n".join(lines)
        and sum("wave" in line and "0.900" in line for line in lines) == 3
    )
    assert lines[-2].startswith("3 skipped E_NOT_AN_INPUT: ") and lines[-1] == "  b.mp4, x.md, y.md"


def test_clips_of_one_name_carry_their_folders(capsys: pytest.CaptureFixture[str]) -> None:
    paths = ("ex/wave/anna/1.mp4", "ex/wave/ben/1.mp4", "ex/clap/2.mp4")
    row_table(
        [
            Row(f"{n}", neighbors=((path, path.split("/")[1], 0.1),), status="ok")
            for n, path in enumerate(paths)
        ]
    )
    shown = capsys.readouterr().out
    assert " anna/1.mp4" in shown and " ben/1.mp4" in shown and " clap/2.mp4" in shown


def test_words() -> None:
    assert [counted(n, "row") for n in (0, 1, 2)] == ["0 rows", "1 row", "2 rows"]
    assert named(["a", "b"]) == "a, b"
    assert named([str(n) for n in range(8)], 3, " ") == "0 1 2, and 5 more"


@pytest.mark.parametrize("width", [60, 100])
def test_numbers_and_their_headings_are_whole_in_a_narrow_terminal(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def console(*, stderr: bool = False) -> Console:
        return Console(width=width, highlight=False, emoji=False)

    monkeypatch.setattr(output, "console", console)
    near = (("zip://ex/wave/1.mp4::file:///tmp/ex.zip", "wave", 0.1),)
    name = "monday/a-rather-long-name.mp4"
    row_table([Row(name, label="wave", neighbors=near, distance=0.125, margin=0.75, status="ok")])
    shown = capsys.readouterr().out
    assert all(word in shown for word in ("distance", "margin", "0.125", "0.750", "wave/1.mp4"))
    assert max(map(len, shown.splitlines())) <= width
