"""The rows of a run for tools that look at data sets and train on them: COCO's JSON, FiftyOne's, and Parquet
as the library `datasets` reads it.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any

from gesture_core.files import replacing
from gesture_core.records import INTEGERS, REALS

_FACTS = ("status", "code", "person", "event", "start", "end", "distance", "margin", "confidence")
"""What both JSON files keep of a row beside its label, under the names of the columns."""


def _sureness(row: dict[str, Any]) -> float | None:
    """0 to 1: the score of an event, otherwise the probability of the label where the run has one."""
    sure: float | None = row["score"] if row["event"] else row["confidence"]
    return sure


class CocoWriter:
    """COCO's JSON (Lin et al. 2014) with inputs in the place of images: what pycocotools indexes.

    An annotation is a row with a label: its gesture as the category, where the person was as the ``bbox`` in
    pixels, ``start`` and ``end`` in seconds. Rows without a label are in the list ``unlabelled``.
    """

    suffix = ".coco.json"

    def write(self, rows: Iterable[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows`` to ``path``."""
        images: dict[str, int] = {}
        named: dict[str, int] = {}
        annotations: list[dict[str, Any]] = []
        unlabelled: list[dict[str, Any]] = []
        for row in rows:
            image = images.setdefault(row["input"], len(images) + 1)
            facts = {"image_id": image} | {name: row[name] for name in _FACTS}
            if row["label"] is None:
                unlabelled.append(facts | {"message": row["message"]})
                continue
            left, top, right, bottom = map(float, row["box"].split() or ("nan",) * 4)
            known = right >= left and bottom >= top
            place = {"bbox": [left, top, right - left, bottom - top], "iscrowd": 0} if known else {}
            place |= {"area": (right - left) * (bottom - top)} if known else {}
            label = named.setdefault(row["label"], len(named) + 1)
            number = {"id": len(annotations) + 1, "category_id": label, "score": _sureness(row)}
            annotations.append(number | facts | place)
        _write_json(
            {
                "info": {"description": "gestures that gesture-core recognised"},
                "images": [{"id": number, "file_name": name} for name, number in images.items()],
                "categories": [{"id": number, "name": name} for name, number in named.items()],
                "annotations": annotations,
                "unlabelled": unlabelled,
            },
            path,
        )


class FiftyOneWriter:
    """Labels as FiftyOne's type of data set ``FiftyOneTemporalDetectionDataset`` has them.

    They are by the name of the input without its ending, as FiftyOne calls a video; names that differ in
    nothing else keep it, as FiftyOne knows only one of the two. Every row with a label is a temporal
    detection, with its time in seconds. An input without any has an empty list, and why is in ``unlabelled``.
    """

    suffix = ".fiftyone.json"

    def write(self, rows: Iterable[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows`` to ``path``."""
        labels: dict[str, list[dict[str, Any]]] = {}
        unlabelled: dict[str, list[dict[str, Any]]] = {}
        for row in rows:
            found = labels.setdefault(row["input"], [])
            facts = {name: row[name] for name in _FACTS if name != "confidence"}  # it has a place of its own
            if row["label"] is None:
                unlabelled.setdefault(row["input"], []).append(facts | {"message": row["message"]})
                continue
            when = [row["start"] or 0.0, row["seconds"] if row["end"] is None else row["end"]]
            one = {"label": row["label"], "timestamps": when, "attributes": facts}
            sure = _sureness(row)
            found.append(one if sure is None else one | {"confidence": sure})
        classes = sorted({one["label"] for found in labels.values() for one in found})
        stems = {name: name.removesuffix(PurePosixPath(name).suffix) for name in labels}
        times = Counter(stems.values())
        called = {name: stem if times[stem] == 1 else name for name, stem in stems.items()}
        named = {called[name]: found for name, found in labels.items()}
        why = {called[name]: reasons for name, reasons in unlabelled.items()}
        _write_json({"classes": classes, "labels": named, "unlabelled": why}, path)


def _write_json(tree: dict[str, Any], path: Path) -> None:
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        json.dump(tree, file, ensure_ascii=False, allow_nan=False, indent=1)


class DatasetsWriter:
    """Parquet as the library `datasets` writes it: ``label`` is a `ClassLabel`, lists are lists.

    ``load_dataset("parquet", data_files=…)`` finds the names of the labels in the file.
    """

    suffix = ".datasets.parquet"

    def write(self, rows: Iterable[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows`` to ``path``."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        neighbor = [("example", "string"), ("label", "string"), ("distance", "float64")]
        types: dict[str, tuple[pa.DataType, Any]] = {
            "neighbors": (
                pa.list_(pa.struct([(name, _arrow(kind)) for name, kind in neighbor])),
                [{name: _value(kind) for name, kind in neighbor}],
            ),
            "selected": (pa.list_(pa.string()), {"feature": _value("string"), "_type": "Sequence"}),
            "box": (pa.list_(pa.float64()), {"feature": _value("float64"), "_type": "Sequence"}),
        }
        for name in columns:
            kind = "int64" if name in INTEGERS else "float64" if name in REALS else "string"
            types.setdefault(name, (_arrow(kind), _value(kind)))
        schema = pa.schema([(name, types[name][0]) for name in columns])
        remaining, batches = iter(rows), []
        while batch := list(islice(remaining, 10_000)):
            batches.append(pa.RecordBatch.from_pylist([_lists(row) for row in batch], schema))
        table = pa.Table.from_batches(batches, schema)
        # Which labels there are is known at the end only.
        names = sorted({name for name in table["label"].to_pylist() if name is not None})
        numbers = {name: number for number, name in enumerate(names)}
        place = columns.index("label")
        codes = [None if name is None else numbers[name] for name in table["label"].to_pylist()]
        table = table.set_column(place, "label", pa.array(codes, pa.int64()))
        features = {name: types[name][1] for name in columns}
        features["label"] = {"names": names, "_type": "ClassLabel"} if names else _value("int64")
        said = {"huggingface": json.dumps({"info": {"features": features}})}
        with replacing(path) as temporary:
            pq.write_table(table.replace_schema_metadata(said), os.fspath(temporary))


def _arrow(kind: str) -> Any:
    import pyarrow as pa

    return {"string": pa.string(), "int64": pa.int64(), "float64": pa.float64()}[kind]


def _value(kind: str) -> dict[str, str]:
    return {"dtype": kind, "_type": "Value"}


def _lists(row: dict[str, Any]) -> dict[str, Any]:
    neighbors = [
        {"example": example, "label": label, "distance": distance}
        for example, label, distance in json.loads(row["neighbors"])
    ]
    box = [float(edge) for edge in row["box"].split()]
    return {**row, "neighbors": neighbors, "selected": row["selected"].split(), "box": box}
