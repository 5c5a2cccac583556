"""The rows of a run as a file: the result writers of the package, and writing by any of them."""

from __future__ import annotations

import csv
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from gesture_core.errors import PluginError, RunFolderError, WorkerError
from gesture_core.files import replacing
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import COLUMNS, Job
from gesture_core.run.results import open_results
from gesture_core.run.workers.engines import Assistant
from gesture_core.run.workers.functions import encoded
from gesture_core.settings import LimitSettings

_SECONDS_BETWEEN_SIGNS = 0.5


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


def write_rows(run: Path, format: str, path: Path, alive: Callable[[], None] = lambda: None) -> None:
    """Write the rows of ``run`` to ``path`` in this process; ``alive`` is called now and then."""
    entry = registry().find("writer", format)
    writer = registry().make("writer", format)

    def records() -> Iterator[dict[str, Any]]:
        last = time.monotonic()
        with results.failures():
            for row in results.rows():
                yield row.as_record()
                if time.monotonic() - last > _SECONDS_BETWEEN_SIGNS:
                    alive()
                    last = time.monotonic()

    kept, remedy = "every row of the run", "another --format, or report it"
    try:
        with open_results(run) as results, calling(entry, kept=kept, remedy=remedy, passing=(OSError,)):
            writer.write(records(), COLUMNS, path)
    except OSError as error:
        cause = f"the file cannot be written: {error.strerror or error}"
        raise RunFolderError(cause, kept=kept, remedy="free space there", code="E_RUN_WRITE") from error
    if not path.is_file():
        raise PluginError(f"{entry} wrote no file", kept=kept, code="E_PLUGIN_CONTRACT")


_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""What a cell begins with that a spreadsheet may run: the list of OWASP, "CSV Injection"."""


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
    if isinstance(value, str) and value.startswith(_FORMULA):
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

        types = {
            **{name: pa.int64() for name in ("person", "event", "frames_declared", "frames_read")},
            **{name: pa.int64() for name in ("frames_looked_at", "frames_with_pose", "attempts")},
            **{name: pa.float64() for name in ("start", "end", "score", "distance", "margin", "seconds")},
        }
        schema = pa.schema([(name, types.get(name, pa.string())) for name in columns])
        with replacing(path) as temporary, pq.ParquetWriter(os.fspath(temporary), schema) as writer:
            remaining = iter(rows)
            while batch := list(islice(remaining, 10_000)):
                writer.write_table(pa.Table.from_pylist(batch, schema))
