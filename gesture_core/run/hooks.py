"""Registers the built-in classifiers, result writers and execution engines."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_classifiers(register: Register) -> None:
    register(
        "nearest",
        "gesture_core.classify.classifiers:Nearest",
        summary="the vote of the nearest examples (Cover and Hart 1967)",
    )
    register(
        "weighed",
        "gesture_core.classify.classifiers:Weighed",
        summary="all examples, by a linear discriminant on their similarities (Pekalska and Duin 2002)",
    )
    register(
        "rocket",
        "gesture_core.classify.rocket:Rocket",
        summary="the signals themselves, by random convolutions (Dempster, Schmidt and Webb 2021)",
    )
    register("blend", "gesture_core.classify.rocket:Blend", summary="weighed, and a quarter as much rocket")


@hookimpl
def register_result_writers(register: Register) -> None:
    register("csv", "gesture_core.run.export:CsvWriter", summary="comma-separated values")
    register("jsonl", "gesture_core.run.export:JsonLinesWriter", summary="one JSON object a line")
    register("parquet", "gesture_core.run.export:ParquetWriter", summary="Apache Parquet")
    register(
        "datasets",
        "gesture_core.report.dataset_files:DatasetsWriter",
        summary="Parquet for the library datasets, label as ClassLabel",
    )
    register(
        "coco", "gesture_core.report.dataset_files:CocoWriter", summary="COCO's JSON, gestures as categories"
    )
    register(
        "fiftyone",
        "gesture_core.report.dataset_files:FiftyOneWriter",
        summary="labels of FiftyOne's temporal detections",
    )


@hookimpl
def register_engines(register: Register) -> None:
    register(
        "processes",
        "gesture_core.run.workers.engines:ProcessEngine",
        summary="worker processes with time and memory limits",
    )
    register(
        "inline", "gesture_core.run.workers.engines:InlineEngine", summary="in this process, for debugging"
    )


@hookimpl
def register_keypoint_readers(register: Register) -> None:
    register(
        "store",
        "gesture_core.run.store:StoreReader",
        summary="keypoint Parquet files written by gesture extract",
        suffixes=(".parquet",),
    )
