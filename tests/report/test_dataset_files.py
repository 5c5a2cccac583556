"""The rows of a run as data sets of other tools: everything is there, as those tools read it."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq

from gesture_core.records import COLUMNS, Row
from gesture_core.report.dataset_files import CocoWriter, DatasetsWriter, FiftyOneWriter

ROWS = [
    Row("a.mp4", "00", 0, "wave", 0.25, 0.5, (("w/1.mp4", "wave", 0.25),), "ok", start=0.5, end=2.0,
        box=(10.0, 20.0, 110.0, 220.0), frames_read=40, seconds=2.5, selected=("nose_x",)),
    Row("a.mp4", "00", 1, None, 3.0, 0.1, (), "rejected", "E_REJECTED", "too far", start=0.0, end=1.0),
    Row("long.mp4", "01", 0, "clap", 0.4, None, (), "ok", start=3.0, end=4.5, event=1, score=0.75),
    Row('<img onerror="x">.mp4', status="skipped", code="E_NOT_AN_INPUT", message="neither"),
]  # fmt: skip
RECORDS = [row.as_record() for row in ROWS]


def test_coco_has_a_category_for_each_gesture_and_what_has_none_says_why(tmp_path: Path) -> None:
    CocoWriter().write(iter(RECORDS), COLUMNS, tmp_path / "k.json")
    tree = json.loads((tmp_path / "k.json").read_text("utf-8"))
    images = {one["id"]: one["file_name"] for one in tree["images"]}
    assert list(images.values()) == ["a.mp4", "long.mp4", '<img onerror="x">.mp4']
    gestures = {one["id"]: one["name"] for one in tree["categories"]}
    wave, clap = tree["annotations"]
    assert (images[wave["image_id"]], gestures[wave["category_id"]]) == ("a.mp4", "wave")
    assert wave["bbox"] == [10, 20, 100, 200] and wave["area"] == 20_000 and wave["start"] == 0.5
    assert clap["score"] == 0.75 and "bbox" not in clap and clap["event"] == 1
    assert [(one["code"], one["message"]) for one in tree["unlabelled"]] == [
        ("E_REJECTED", "too far"),
        ("E_NOT_AN_INPUT", "neither"),
    ]


def test_fiftyone_has_the_times_of_every_label(tmp_path: Path) -> None:
    FiftyOneWriter().write(iter(RECORDS), COLUMNS, tmp_path / "k.json")
    tree = json.loads((tmp_path / "k.json").read_text("utf-8"))
    assert tree["classes"] == ["clap", "wave"]
    assert [(one["label"], one["timestamps"]) for one in tree["labels"]["a"]] == [("wave", [0.5, 2.0])]
    (event,) = tree["labels"]["long"]
    assert event["timestamps"] == [3.0, 4.5] and event["confidence"] == 0.75
    assert not {"label", "support", "timestamps", "confidence"} & set(event["attributes"]), "given twice"
    assert tree["labels"]['<img onerror="x">'] == []
    assert tree["unlabelled"]["a"][0]["code"] == "E_REJECTED"
    FiftyOneWriter().write(iter([*RECORDS, Row("a.avi").as_record()]), COLUMNS, tmp_path / "k.json")
    tree = json.loads((tmp_path / "k.json").read_text("utf-8"))
    assert {"a.mp4", "a.avi", "long"} < set(tree["labels"]), "a label goes to no other video"


def test_the_parquet_says_which_labels_its_numbers_are(tmp_path: Path) -> None:
    DatasetsWriter().write(iter(RECORDS), COLUMNS, tmp_path / "k.parquet")
    table = pq.read_table(tmp_path / "k.parquet")
    features = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
    assert list(features) == table.column_names == list(COLUMNS)
    names = features["label"]["names"]
    assert features["label"]["_type"] == "ClassLabel" and names == ["clap", "wave"]
    rows = table.to_pylist()
    assert [None if row["label"] is None else names[row["label"]] for row in rows] == [
        "wave", None, "clap", None,
    ]  # fmt: skip
    assert rows[0]["neighbors"] == [{"example": "w/1.mp4", "label": "wave", "distance": 0.25}]
    assert rows[0]["box"] == [10, 20, 110, 220] and rows[0]["selected"] == ["nose_x"]
    assert [row["input"] for row in rows] == [row.input for row in ROWS]
