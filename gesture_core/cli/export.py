"""``gesture export``: the rows of a run as a file, or its events as files of other programs."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.cli.flags import UNSAID
from gesture_core.cli.output import check_file, check_folder, counted
from gesture_core.errors import ConfigError
from gesture_core.plugin import registry
from gesture_core.settings import load_settings


def export(
    run: Path,
    /,
    *,
    format: str | None = None,
    to: Annotated[str, UNSAID, Parameter(name=["--to", "-o"], allow_leading_hyphen=True)] = "",
) -> None:
    """Write the rows of a run as a table or a data set, or its events for ELAN and as subtitles.

    Parameters
    ----------
    run
        The run folder.
    format
        csv, parquet, jsonl, coco, fiftyone or datasets (Parquet with ClassLabel), or a result writer of a
        plugin; by default as --to ends, or csv. The events of gesture spot also as eaf (ELAN), vtt, srt or
        audacity (label tracks), a file for each input, or activitynet (one JSON file).
    to
        The file, - for standard output, or an address (s3://…); <run>/results.<format> by default. Where each
        input has a file, a folder, <run>/events by default.
    """
    from gesture_core.run.addresses import is_address, local_path, put, shown

    place = local_path(to)
    if not is_address(to):
        _export(run, format, place)
        return
    if to.startswith("memory://"):
        remedy = "a file, or the address of a store"
        raise ConfigError(f"--to {to} would be gone with this command", remedy=remedy, code="E_OUT")
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / Path(place).name
        _export(run, format, str(written), said=False)
        put(written, to)
    print(shown(to))


def _export(run: Path, format: str | None, to: str, said: bool = True) -> None:
    """Write a table or events to a place on this machine, and say where unless that is for a while."""
    from gesture_core.report.event_files import FORMATS
    from gesture_core.run.export import export_rows

    if format in FORMATS:
        _export_events(run, format, to, said)
        return
    if format:
        registry().find("writer", format, FORMATS)
    limits = load_settings().limits
    if to != "-":
        target = Path(to) if to else None
        if target is not None:
            check_file(target, flag="--to")
        ending = target.suffix.lower().removeprefix(".") if target else ""
        names = registry().names("writer")
        if ending and not format and ending not in names:
            if ending in FORMATS:  # what the name would be of, a file for each input, is not said by one name
                cause = f"--to {target}: {ending} is a file for each input"
                raise ConfigError(cause, remedy=f"--format {ending} --to FOLDER", code="E_OPTION")
            raise ConfigError(
                f"--to {target}: no result writer is called {ending!r}",
                remedy=f"--format with one of {', '.join([*names, *FORMATS])}",
                code="E_OPTION",
            )
        written = export_rows(run, format or ending or "csv", target, limits)
        if said:
            print(written)
        return
    with tempfile.TemporaryDirectory() as folder:
        written = export_rows(run, format or "csv", Path(folder) / "rows", limits)
        with written.open("rb") as file:
            if sys.stdout.isatty() and b"\0" in file.read(1 << 16):
                raise ConfigError(f"{format} is not text", remedy="--to FILE, or a pipe", code="E_OPTION")
            file.seek(0)
            shutil.copyfileobj(file, sys.stdout.buffer)


def _export_events(run: Path, format: str, to: str, said: bool) -> None:
    """Write the events of a run."""
    from gesture_core.report.event_files import write_event_files
    from gesture_core.run.results import open_results

    one = format == "activitynet"
    if to == "-":
        place = "FILE" if one else "FOLDER"
        raise ConfigError(f"--to - with --format {format}", remedy=f"--to {place}", code="E_OPTION")
    target = Path(to) if to else run / ("events.json" if one else "events")
    check_file(target, flag="--to") if one else check_folder(target, flag="--to")
    with open_results(run) as results, results.failures():
        written = write_event_files(
            results.rows(), format, target, results.place_of, stays=said
        )  # what goes to an address lies here for a while
    if said:
        print(written[0] if len(written) == 1 else f"{target}: {counted(len(written), 'file')}")
