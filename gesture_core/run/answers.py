"""What a person said about the rows of a run: a table of its own in ``run.db``, never over the rows."""

from __future__ import annotations

import csv
import os
import sqlite3
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gesture_core.errors import InputError, RunFolderError
from gesture_core.files import replacing
from gesture_core.records import Row
from gesture_core.run.results import DATABASE, open_results

NONE = "_none"
"""The label of a clip that shows none of the gestures."""
_TABLE = """
CREATE TABLE IF NOT EXISTS answers (
  key BLOB NOT NULL, person INTEGER NOT NULL, event INTEGER NOT NULL, mark TEXT NOT NULL, label TEXT,
  PRIMARY KEY (key, person, event)
)
"""


@dataclass(frozen=True)
class Answered:
    """A row of a run, and what a person said of it.

    Attributes
    ----------
    key : bytes
        Of the input.
    row : Row
        As the machine left it.
    label : str or None
        None for none of the gestures.
    """

    key: bytes
    row: Row
    label: str | None

    @property
    def place(self) -> Path:
        """Where the input is."""
        return Path(os.fsdecode(self.key.partition(b"\0")[0]))

    @property
    def member(self) -> str:
        """The sequence in a file of several; empty where it is all of the file."""
        return self.key.partition(b"\0")[2].decode("utf-8", "surrogatepass")

    @property
    def whole(self) -> bool:
        """The answer is about all of the input and its first person, as the label of an example is."""
        return not (self.row.event or self.row.person or self.member)


class Answers:
    """The answers about a run, open for reading and writing by any thread. Use as a context manager.

    Parameters
    ----------
    run : Path
        The run folder.

    Raises
    ------
    RunFolderError
        Where there is no run, or its file cannot be written.
    """

    def __init__(self, run: Path) -> None:
        with open_results(run) as results, results.failures():
            self.rows = list(results.keyed_rows())
        self._lock = threading.Lock()
        self._path = run / DATABASE
        try:
            self._db = sqlite3.connect(self._path, isolation_level=None, timeout=10, check_same_thread=False)
            self._db.execute(_TABLE)
        except sqlite3.Error as error:
            raise self._failed(error) from error

    def __enter__(self) -> Answers:
        return self

    def __exit__(self, *_: object) -> None:
        self._db.close()

    def give(self, place: int, label: str | None) -> None:
        """Keep an answer about the row at ``place`` among `rows`; it replaces an earlier one."""
        key, row = self.rows[place]
        self._write(
            "INSERT OR REPLACE INTO answers VALUES (?, ?, ?, ?, ?)",
            (key, row.person, row.event, _mark(row), label),
        )

    def take_back(self, place: int) -> None:
        """Forget the answer about a row."""
        key, row = self.rows[place]
        query = "DELETE FROM answers WHERE key = ? AND person = ? AND event = ?"
        self._write(query, (key, row.person, row.event))

    def given(self) -> dict[int, str | None]:
        """The answers by the places of their rows; those about what is not there any more are left out."""
        try:
            with self._lock:
                found = self._db.execute("SELECT key, person, event, mark, label FROM answers").fetchall()
        except sqlite3.Error as error:
            raise self._failed(error) from error
        labels = {tuple(about): label for *about, label in found}
        marks = [(key, row.person, row.event, _mark(row)) for key, row in self.rows]
        return {place: labels[mark] for place, mark in enumerate(marks) if mark in labels}

    def answered(self) -> list[Answered]:
        """The rows that were answered, in the order of the rows."""
        return [Answered(*self.rows[place], label) for place, label in self.given().items()]

    def _write(self, query: str, values: Sequence[object]) -> None:
        try:
            with self._lock:
                self._db.execute(query, values)
        except sqlite3.Error as error:
            raise self._failed(error) from error

    def _failed(self, error: sqlite3.Error) -> RunFolderError:
        return RunFolderError(
            f"answers cannot be kept: {error}",
            subject=str(self._path),
            kept="the answers before",
            remedy="its permissions, and free space there",
            code="E_RUN_WRITE",
        )


def _mark(row: Row) -> str:
    """What changes when an answer is not about the same any more: the content, or where an event is."""
    return f"{row.sha256} {row.start} {row.end}" if row.event else row.sha256


def write_answers(answered: Sequence[Answered], path: Path) -> Path:
    """Write answers as a table that `gesture classify` takes as a source of examples, and as ``--labels``.

    Answers about a part of an input have no ``path``: nobody takes their labels for that of the whole.

    Raises
    ------
    InputError
        ``E_EMPTY`` where nothing was answered.
    """
    if not answered:
        raise InputError("nothing was answered yet", remedy="gesture review RUN", code="E_EMPTY")
    with (  # a name of other bytes stays as it is, as tables of paths are read
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="") as file,
    ):
        table = csv.writer(file)
        table.writerow(("path", "label", "input", "person", "start", "end", "recognised_as", "status"))
        for one in answered:
            name = os.fspath(one.place) + (f"::{one.member}" if one.member else "")
            row, times = one.row, ("", "")
            if row.event:
                times = (f"{row.start:.3f}", f"{row.end:.3f}")
            label = NONE if one.label is None else one.label
            path_of_all = name if one.whole else ""
            table.writerow((path_of_all, label, name, row.person, *times, row.label or "", row.status))
    return path
