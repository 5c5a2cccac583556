"""Registers the built-in result writers and execution engines."""

from gesture_core.plugin.specs import Register, hookimpl


@hookimpl
def register_result_writers(register: Register) -> None:
    register("csv", "gesture_core.archive.writers:CsvWriter", summary="comma-separated values")
    register("jsonl", "gesture_core.archive.writers:JsonLinesWriter", summary="one JSON object a line")
    register("parquet", "gesture_core.archive.writers:ParquetWriter", summary="Apache Parquet")


@hookimpl
def register_engines(register: Register) -> None:
    register(
        "processes",
        "gesture_core.archive.processes:ProcessEngine",
        summary="spawned worker processes with time and memory limits",
    )
    register("inline", "gesture_core.archive.inline:InlineEngine", summary="in this process, for debugging")


@hookimpl
def register_keypoint_readers(register: Register) -> None:
    register(
        "store",
        "gesture_core.archive.store:StoreReader",
        summary="keypoint Parquet files written by gesture extract",
    )
