"""What a person said about the rows of a run, and the clips that become examples by it.

Answers are a table of its own in ``run.db``, never over the rows.
"""

from __future__ import annotations

import csv
import os
import shutil
import sqlite3
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gesture_core.classify.comparison import compare
from gesture_core.errors import InputError, RunFolderError
from gesture_core.files import replacing
from gesture_core.records import Row
from gesture_core.run.addresses import fetch, look
from gesture_core.run.extract import Listener, people_of
from gesture_core.run.found_again import find_inputs
from gesture_core.run.inputs import Input
from gesture_core.run.results import DATABASE, open_results
from gesture_core.run.workers.decision import open_fitted
from gesture_core.signals.chain import Chain
from gesture_core.types import Signals

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
    def place(self) -> str:
        """Where the input is: a path or an address."""
        return os.fsdecode(self.key.partition(b"\0")[0])

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
            name = one.place + (f"::{one.member}" if one.member else "")
            row, times = one.row, ("", "")
            if row.event:
                times = (f"{row.start:.3f}", f"{row.end:.3f}")
            label = NONE if one.label is None else one.label
            path_of_all = name if one.whole else ""
            table.writerow((path_of_all, label, name, row.person, *times, row.label or "", row.status))
    return path


@dataclass(frozen=True)
class Corrections:
    """What became of answers.

    Attributes
    ----------
    added : tuple of Path
        The new examples, those first that change most decisions.
    redundant : int
        Clips whose label the examples give already, with those that were added.
    left_out : mapping
        Why answers cannot become examples, and of how many.
    """

    added: tuple[Path, ...]
    redundant: int
    left_out: Mapping[str, int]


def add_corrections(
    run: Path, folder: Path, *, most: int | None = None, listener: Listener | None = None
) -> Corrections:
    """Put clips that a person corrected into ``folder``/<label>/, as few of them as decide.

    Parameters
    ----------
    run : Path
        A run folder with answers.
    folder : Path
        Of the examples.
    most : int, optional
        How many at most.
    listener : Listener, optional
        Told about keypoints that have to be extracted again.

    Raises
    ------
    InputError
        ``E_EMPTY`` where nothing was answered.
    RunFolderError
        ``E_NO_RUN`` where the run has no fitted examples to compare with.
    """
    with Answers(run) as answers:
        answered = answers.answered()
    if not answered:
        raise InputError("nothing was answered yet", remedy="gesture review RUN", code="E_EMPTY")
    left_out: dict[str, int] = {}
    usable: list[Answered] = []
    for one in answered:
        reason = _reason(one)
        if reason:
            left_out[reason] = left_out.get(reason, 0) + 1
        else:
            usable.append(one)
    if not usable:
        return Corrections((), 0, left_out)
    with open_results(run) as results:
        recognizer = open_fitted(
            run, results.get("fingerprint") or "", results.configuration.get("examples", ())
        )
        rows = {key: row for key, row in results.keyed_rows() if not row.person}
    if recognizer is None:
        raise RunFolderError(
            "holds no fitted examples",
            subject=str(run),
            kept="the answers",
            remedy="gesture classify once more, with --overwrite (keypoints and answers are kept)",
            code="E_NO_RUN",
        )
    keys = {row.input: key for key, row in rows.items() if row.distance is not None}
    places = {name: os.fsdecode(key.partition(b"\0")[0]) for name, key in keys.items()}
    there = find_inputs(places, recognizer.settings)
    items = {keys[name]: item for name, item in there.items() if isinstance(item, Input)}
    own = {item.key: key for key, item in items.items()}
    chain = Chain.from_settings(recognizer.settings)
    signals: dict[bytes, Signals] = {}
    for item, found, people in people_of(list(items.values()), recognizer.settings, listener=listener):
        if people and found.sha256 == rows[own[item.key]].sha256:
            signals[own[item.key]] = chain(people[0])
    lost = [one for one in usable if one.key not in signals]
    if lost:
        left_out["the clip is not what the run saw, or nobody is in it"] = len(lost)
    usable = [one for one in usable if one.key in signals]
    labels = [str(one.label) for one in usable]
    chosen = choose(
        recognizer.distances(list(signals.values())),
        [rows[key].label or "" for key in signals],
        compare(list(signals.values()), [signals[one.key] for one in usable], recognizer.settings),
        labels,
        [list(signals).index(one.key) for one in usable],
        most,
    )
    added = [_copy(items[usable[place].key], folder / labels[place]) for place in chosen]
    return Corrections(tuple(added), len(usable) - len(chosen), left_out)


def choose(
    known: np.ndarray,
    said: Sequence[str],
    new: np.ndarray,
    new_labels: Sequence[str],
    own: Sequence[int],
    most: int | None = None,
) -> list[int]:
    """Which corrected clips to add, those first that change most decisions.

    A clip is added only where the run, or a clip added before it that is nearer than all examples, says
    another label, as in the condensed nearest neighbour rule (Hart 1968): what is already known makes the
    library no better.

    Parameters
    ----------
    known : (Q, N) float array
        Distances of all clips of the run to the examples.
    said : sequence of Q str
        What the run says that each clip is; empty where it has no label.
    new : (Q, C) float array
        The same to the corrected clips.
    own : sequence of C int
        The row of each corrected clip.
    most : int, optional
        How many at most.

    Returns
    -------
    list of int
        Positions among the corrected clips.
    """
    nearest, label = known.min(axis=1), np.array(said, object)
    chosen: list[int] = []
    while len(chosen) < (len(new_labels) if most is None else most):
        open_ones = [c for c in range(len(new_labels)) if c not in chosen and label[own[c]] != new_labels[c]]
        if not open_ones:
            break
        changed = [((new[:, c] < nearest) & (label != new_labels[c])).sum() for c in open_ones]
        best = open_ones[int(np.argmax(changed))]
        chosen.append(best)
        closer = new[:, best] < nearest
        nearest = np.where(closer, new[:, best], nearest)
        label = np.where(closer, new_labels[best], label)
    return chosen


def _reason(one: Answered) -> str:
    """Why an answer is no example; empty where it may be one."""
    if one.label is None:
        return "none of the gestures"
    if one.row.event:
        return "an event of a recording: gesture cut makes clips of events"
    if one.row.person:
        return "one of several people in the input"
    if one.member:
        return "one of several sequences in a file"
    if set(one.label) & set("/\\") or one.label.startswith("."):
        return "a label that no folder of examples can have: gesture review --export makes a table of them"
    return ""


def _copy(item: Input, folder: Path) -> Path:
    """A copy of an input in a folder of examples: the same bytes on disk where that can be."""
    folder.mkdir(parents=True, exist_ok=True)
    if item.address:  # it was deleted when its keypoints had been read
        fetch(look(item.address), item.path)
    number, target = 1, folder / item.path.name
    while target.exists():
        if target.is_file() and item.path.is_file() and target.samefile(item.path):
            return target
        number += 1
        target = folder / f"{item.path.stem}-{number}{item.path.suffix}"
    if item.path.is_dir():
        shutil.copytree(item.path, target)
        return target
    try:
        os.link(item.path, target)
    except OSError:  # another disk, or one without links
        shutil.copy2(item.path, target)
    return target
