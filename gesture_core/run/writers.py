"""Exports of a run: CSV, JSON lines, Parquet. Each file is whole or not there."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from gesture_core.files import replacing

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
            **{name: pa.int64() for name in ("person", "frames_declared", "frames_read")},
            **{name: pa.int64() for name in ("frames_with_pose", "attempts")},
            **{name: pa.float64() for name in ("distance", "margin", "seconds")},
        }
        schema = pa.schema([(name, types.get(name, pa.string())) for name in columns])
        with replacing(path) as temporary, pq.ParquetWriter(os.fspath(temporary), schema) as writer:
            remaining = iter(rows)
            while batch := list(islice(remaining, 10_000)):
                writer.write_table(pa.Table.from_pylist(batch, schema))
