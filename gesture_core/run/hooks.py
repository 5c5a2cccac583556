"""Registers the built-in result writers and execution engines."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_result_writers(register: Register) -> None:
    register("csv", "gesture_core.run.writers:CsvWriter", summary="comma-separated values")
    register("jsonl", "gesture_core.run.writers:JsonLinesWriter", summary="one JSON object a line")
    register("parquet", "gesture_core.run.writers:ParquetWriter", summary="Apache Parquet")


@hookimpl
def register_engines(register: Register) -> None:
    register(
        "processes",
        "gesture_core.run.processes:ProcessEngine",
        summary="spawned worker processes with time and memory limits",
    )
    register("inline", "gesture_core.run.inline:InlineEngine", summary="in this process, for debugging")


@hookimpl
def register_keypoint_readers(register: Register) -> None:
    register(
        "store",
        "gesture_core.run.store:StoreReader",
        summary="keypoint Parquet files written by gesture extract",
    )
