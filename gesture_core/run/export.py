"""What a run leaves as files: rows by any result writer, and the keypoints of `gesture extract`."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import shutil
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import PluginError, RunFolderError, WorkerError
from gesture_core.files import replacing
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import COLUMNS, INTEGERS, REALS, Job, decoded, encoded
from gesture_core.run.inputs import Input
from gesture_core.run.results import Results, open_results
from gesture_core.run.workers.engines import Assistant
from gesture_core.settings import LimitSettings

if TYPE_CHECKING:
    from gesture_core.run.workers.worker import Worker

_SECONDS_BETWEEN_SIGNS = 0.5
_LONGEST = 120
_ODD = re.compile(r"[^\w .=@+-]|^\.+$")


def export_rows(run: Path, format: str, path: Path | None, limits: LimitSettings) -> Path:
    """Write the rows of ``run`` to ``path`` or ``<run>/results.<suffix>``; the file is whole or not there.

    The result writer runs in a worker process, under ``limits``.

    Raises
    ------
    RunFolderError
        Where there is no run.
    PluginError
        Where the writer is unknown, raises, ends its process, or writes nothing.
    """
    entry = registry().find("writer", format)
    with open_results(run):
        pass  # where there is no run, no folder is made for it either
    with Assistant(Job({}, ""), limits) as assistant:
        try:
            target = path or run / f"results{assistant.ask('suffix', {'format': format})}"
            with replacing(target) as temporary:
                task = {"run": encoded(run), "format": format, "path": encoded(temporary)}
                assistant.ask("write_rows", task, retry=False)
        except WorkerError as error:
            raise PluginError(
                f"{entry}: {error.cause}",
                kept="every row of the run",
                remedy="another --format, or report it",
                code=error.code,
            ) from error
    return target


def suffix(worker: Worker, format: str) -> str:
    """What the names of the files that a result writer writes end in."""
    with calling(registry().find("writer", format)):
        return str(registry().make("writer", format).suffix)


def write_rows(worker: Worker, run: str, format: str, path: str) -> None:
    """Write the rows of a run to a file."""
    entry, target = registry().find("writer", format), decoded(path)
    writer = registry().make("writer", format)

    def records() -> Iterator[dict[str, Any]]:
        last = time.monotonic()
        with results.failures():
            for row in results.rows():
                yield row.as_record()
                if time.monotonic() - last > _SECONDS_BETWEEN_SIGNS:
                    worker.alive()
                    last = time.monotonic()

    kept, remedy = "every row of the run", "another --format, or report it"
    try:
        with (
            open_results(decoded(run)) as results,
            calling(entry, kept=kept, remedy=remedy, passing=(OSError,)),
        ):
            writer.write(records(), COLUMNS, target)
    except OSError as error:
        cause = f"the file cannot be written: {error.strerror or error}"
        remedy = "another place (--to FILE), its permissions or free space there"
        raise RunFolderError(cause, kept=kept, remedy=remedy, code="E_RUN_WRITE") from error
    if not target.is_file():
        raise PluginError(f"{entry} wrote no file", kept=kept, code="E_PLUGIN_CONTRACT")


_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""What a cell begins with that a spreadsheet may run: the list of OWASP, "CSV Injection"."""
_NUMBERS = re.compile(r"-?[\d.]+(e[-+]?\d+)?( -?[\d.]+(e[-+]?\d+)?)*")
"""What none would run: a box that reaches beyond the picture, or is in metres."""


class CsvWriter:
    """Comma-separated values (RFC 4180), UTF-8. Text that a spreadsheet would run gets a ``'``."""

    suffix = ".csv"

    def write(self, rows: Iterable[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows`` to ``path``."""
        with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            for row in rows:
                writer.writerow([_cell(row[name]) for name in columns])


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, str) and value.startswith(_FORMULA) and not _NUMBERS.fullmatch(value):
        return "'" + value
    return value


class JsonLinesWriter:
    """One JSON object a line; ``neighbors`` and ``selected`` are lists."""

    suffix = ".jsonl"

    def write(self, rows: Iterable[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows`` to ``path``."""
        with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
            for row in rows:
                file.write(json_line({name: row[name] for name in columns}) + "\n")


def json_line(record: dict[str, Any]) -> str:
    """A record of the result as one line of JSON."""
    tree = dict(record)
    tree["neighbors"] = json.loads(tree["neighbors"])
    tree["selected"] = tree["selected"].split()
    return json.dumps(tree, ensure_ascii=False)


class ParquetWriter:
    """Apache Parquet with typed columns."""

    suffix = ".parquet"

    def write(self, rows: Iterable[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows`` to ``path``."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        types = {**dict.fromkeys(INTEGERS, pa.int64()), **dict.fromkeys(REALS, pa.float64())}
        schema = pa.schema([(name, types.get(name, pa.string())) for name in columns])
        with replacing(path) as temporary, pq.ParquetWriter(os.fspath(temporary), schema) as writer:
            remaining = iter(rows)
            while batch := list(islice(remaining, 10_000)):
                writer.write_table(pa.Table.from_pylist(batch, schema))


class KeypointFiles:
    """The folder ``<out>/keypoints/``: one file for each input that has keypoints, as the results know them.

    Parameters
    ----------
    out : Path
        The run folder.
    results : Results
    inputs : sequence of Input
        Of this run.
    sources : sequence of str
        What they were found in.
    """

    def __init__(self, out: Path, results: Results, inputs: Sequence[Input], sources: Sequence[str]) -> None:
        self._folder, self._removed = out / "keypoints", out / "removed"
        self._results = results
        self._inputs = {item.place for item in inputs}
        self._known, own = results.published(), {item.key for item in inputs}
        others = [file for key, file in self._known.items() if key not in own]
        self._names = file_names(inputs, sources, others)
        self._claims = Counter(self._known.values())

    def lacking(self) -> set[bytes]:
        """Keys of inputs that have rows with keypoints, and no file of the right name."""
        return {
            key
            for key in self._results.with_keypoints() & self._names.keys()
            if self._known.get(key) != self._names[key] or not (self._folder / self._names[key]).is_file()
        }

    def put(self, item: Input, stored: Path) -> None:
        """Copy a file of the keypoint store to its place."""
        name = self._names[item.key]
        if self._known.get(item.key) != name:
            self._drop(self._known.keys() & {item.key})
            self._claims[name] += 1
        self._results.publish(item.key, name)  # first, so that no file is ever unknown
        self._known[item.key] = name
        with replacing(self._folder / name) as temporary:
            shutil.copyfile(stored, temporary)

    def sweep(self) -> None:
        """Take out the files of inputs that have no keypoints any more, unless they are inputs themselves.

        They go to ``<out>/removed/``: where the video is deleted, its keypoints are all that is left of it.
        """
        self._drop(self._known.keys() - self._results.with_keypoints(), self._removed)

    def _drop(self, keys: Iterable[bytes], to: Path | None = None) -> None:
        gone = []
        for key in keys:
            path = self._folder / self._known[key]
            if os.fsencode(os.path.normpath(path.absolute())) in self._inputs:
                continue
            name = self._known.pop(key)
            self._claims[name] -= 1
            if not self._claims[name]:  # another source may have given it to another input by now
                take_out(path, None if to is None else to / name)
            gone.append(key)
        if gone:
            self._results.retract(gone)


def take_out(path: Path, to: Path | None) -> None:
    """Move a file, if it is there, or delete it."""
    if to is None or not path.is_file():
        path.unlink(missing_ok=True)
        return
    to.parent.mkdir(parents=True, exist_ok=True)
    path.replace(to)


def file_names(items: Sequence[Input], sources: Sequence[str], taken: Iterable[str] = ()) -> dict[bytes, str]:
    """Name of each input's file below ``keypoints/``, by the input's key.

    The folders below a source are kept: ``videos/a/b.mp4`` becomes ``a/b.mp4.parquet``. Names that
    another input claims too or that are ``taken``, that are long, or that hold odd characters get a hash
    of the input's path.
    """
    plain = {item.key: _place(item, [Path(source) for source in sources]) for item in items}
    claims = Counter(f"{path}.parquet".casefold() for path in plain.values())
    claims.update(name.casefold() for name in taken)
    return {
        item.key: f"{place if _plain(place, claims) else _hashed(place, item)}.parquet"
        for item in items
        for place in [plain[item.key]]
    }


def _place(item: Input, roots: Sequence[Path]) -> Path:
    inside = next(
        (item.path.relative_to(r) for r in roots if item.path != r and item.path.is_relative_to(r)), None
    )
    place = inside if inside is not None else Path(item.path.name or "input")
    return place.with_name(f"{place.name}{f'.{item.member}' if item.member else ''}".replace("/", "_"))


def _plain(path: Path, claims: Counter[str]) -> bool:
    ordinary = all(len(part) <= _LONGEST and not _ODD.search(part) for part in path.parts)
    return ordinary and claims[f"{path}.parquet".casefold()] == 1


def _hashed(path: Path, item: Input) -> Path:
    stem = _ODD.sub("_", os.fsencode(path.name).decode("ascii", "replace"))[:_LONGEST]
    return Path(f"{stem}-{hashlib.sha256(item.key).hexdigest()[:12]}")
