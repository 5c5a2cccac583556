"""The suite of result writers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gesture_core.errors import GestureError
from gesture_core.plugin.interfaces import ResultWriter
from gesture_core.records import COLUMNS, Row
from gesture_core.testing.answers import ask

_NEIGHBORS = (("wave/anna.mp4", "wave", 0.125), ("clap/ben.mp4", "clap", 0.5))


def draw_rows() -> list[dict[str, Any]]:
    """Rows of every status, with text that is hard on a format and with all that may be None."""
    rows = [
        Row("videos/a.mp4", "00ff", 0, "wave", 0.125, 0.375, _NEIGHBORS, "ok", frames_read=40, seconds=2.0),
        Row("videos/a.mp4", "00ff", 1, None, 3.5, None, _NEIGHBORS, "rejected", "E_REJECTED", "too far"),
        Row("=b|\"c\",\t'd'\n\r\N{SNOWMAN}\U0001f44b.mp4", status="skipped", code="E_NOT_AN_INPUT"),
        Row("d.mp4", status="error", code="E_MEDIA", message="d.mp4: <script>&amp;; try: a|b\\c " * 50),
        Row("e.mp4", "ab", 0, "", 0.0, 0.0, (), "degraded", selected=("nose_x", "nose_y"), attempts=2),
    ]
    return [row.as_record() for row in rows]


def check_writer_file(writer: ResultWriter) -> None:
    """One file of the name that was asked for, with rows or without, whatever stands in them."""
    name = type(writer).__name__
    assert isinstance(writer, ResultWriter), f"{name} has no method write, or no attribute suffix"
    assert isinstance(writer.suffix, str) and writer.suffix.startswith(".") and writer.suffix != ".", (
        f"{name}.suffix is {writer.suffix!r}, expected the end of a file name, such as '.csv'"
    )
    for rows in ([], draw_rows()[:1], draw_rows()):
        _written(writer, rows)


def check_writer_rows(writer: ResultWriter) -> None:
    """Every row leaves its trace in the file, and so does its label; the rows stay as they are."""
    name, rows = type(writer).__name__, draw_rows()
    before = [dict(row) for row in rows]
    whole = _written(writer, rows)
    assert rows == before, f"{name}.write changes the rows that it was given"
    for index, row in enumerate(rows):
        rest = rows[:index] + rows[index + 1 :]
        assert _written(writer, rest) != whole, (
            f"{name}.write gives the same file without row {index + 1}, of status {row['status']}"
        )
    other = [{**rows[0], "label": "clap"}, *rows[1:]]
    assert _written(writer, other) != whole, f"{name}.write gives the same file for another label"


def check_writer_errors(writer: ResultWriter) -> None:
    """What goes wrong is raised: a file that lacks rows must not pass for a whole one."""
    name = type(writer).__name__

    def broken() -> Iterator[dict[str, Any]]:
        yield draw_rows()[0]
        raise OSError("the journal cannot be read")

    with TemporaryDirectory() as folder:
        try:
            writer.write(broken(), COLUMNS, Path(folder, f"rows{writer.suffix}"))
        except (OSError, GestureError):
            pass
        except Exception as error:
            raise AssertionError(
                f"{name}.write raises {type(error).__name__} where a row raised an OSError: {error}"
            ) from error
        else:
            raise AssertionError(f"{name}.write goes on as if nothing were wrong where a row cannot be read")
        taken = Path(folder, f"taken{writer.suffix}")
        taken.mkdir()
        try:
            writer.write(iter(draw_rows()), COLUMNS, taken)
        except (OSError, GestureError):
            return
        except Exception as error:
            raise AssertionError(
                f"{name}.write raises {type(error).__name__} where the file cannot be written: {error}; "
                "expected an OSError or a GestureError"
            ) from error
        raise AssertionError(f"{name}.write goes on as if nothing were wrong where there is a folder")


def _written(writer: ResultWriter, rows: list[dict[str, Any]]) -> bytes:
    """The bytes that ``writer`` makes of ``rows``, which it can read only once."""
    name = type(writer).__name__
    with TemporaryDirectory() as folder:
        path = Path(folder, f"rows{writer.suffix}")
        ask(writer.write, iter(rows), COLUMNS, path)
        found = sorted(file.name for file in Path(folder).iterdir())
        assert found == [path.name], f"{name}.write was asked for {path.name} and leaves {found}"
        return path.read_bytes()


WRITER_CHECKS: tuple[Callable[[ResultWriter], None], ...] = (
    check_writer_file,
    check_writer_rows,
    check_writer_errors,
)
"""The suite of result writers."""
