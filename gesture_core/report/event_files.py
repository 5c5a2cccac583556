"""The events of a run as files for other programs: ELAN, WebVTT, SubRip, Audacity, ActivityNet.

ELAN (Wittenburg et al. 2006), the two subtitle formats and label tracks belong to one recording each, so they
are written as one file for each input, those without events included; ActivityNet's JSON holds all of them.
"""

from __future__ import annotations

import html
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gesture_core.errors import MissingDependencyError, RunFolderError
from gesture_core.files import printable, replacing
from gesture_core.records import Row
from gesture_core.run.addresses import is_address
from gesture_core.run.inputs import VIDEO_SUFFIXES
from gesture_core.video.containers import begins_as_video

FORMATS = ("eaf", "vtt", "srt", "audacity", "activitynet")
_SUFFIXES = {"eaf": ".eaf", "vtt": ".vtt", "srt": ".srt", "audacity": ".txt"}


def write_event_files(
    rows: Iterable[Row],
    format: str,
    target: Path,
    place_of: Callable[[str], Path | None] = lambda name: None,
    *,
    stays: bool = True,
) -> list[Path]:
    """Write the events among ``rows`` in one of `FORMATS`.

    Parameters
    ----------
    rows : iterable of Row
        Of a run of `gesture spot`.
    format : str
    target : Path
        A folder, or for ``activitynet`` a file.
    place_of : callable, optional
        The absolute path of an input by its name, for formats that name the recording.
    stays : bool
        Whether the files stay in ``target``, so that they may say where the recording is from there.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    MissingDependencyError
        Where ELAN or WebVTT is asked for and its library is not installed.
    RunFolderError
        Where no row is an event, and none says that there was none: a run of another command.
    """
    inputs: dict[str, list[Row]] = {}
    spotted = False
    for row in rows:
        spotted |= bool(row.event) or row.code == "E_NO_EVENT"
        events = inputs.setdefault(row.input, [])
        if row.event:
            events.append(row)
    if not spotted:
        raise RunFolderError(
            "the run has no events", remedy="gesture spot, then this command", code="E_NO_RUN"
        )
    if format == "activitynet":
        with replacing(target) as temporary:
            temporary.write_text(json.dumps(activitynet(inputs), ensure_ascii=False, indent=1), "utf-8")
        return [target]
    target.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for name, events in inputs.items():
        path = _free(target, name, _SUFFIXES[format], written)
        with replacing(path) as temporary:
            if format == "eaf":
                _write_elan(_media(name, place_of(name), target if stays else None), events, temporary)
            else:
                _WRITERS[format](events, temporary)
        written.append(path)
    return written


def tiers(events: Sequence[Row]) -> Mapping[str, list[Row]]:
    """Events by tier: one for each person, and a further one where two of a person's events overlap."""
    found: dict[str, list[Row]] = {}
    for event in sorted(events, key=lambda row: (row.person, row.start or 0.0)):
        number = 1
        while True:
            name = f"person {event.person}" + (f" ({number})" if number > 1 else "")
            tier = found.setdefault(name, [])
            if not tier or _milliseconds(tier[-1].end) <= _milliseconds(event.start):
                tier.append(event)
                break
            number += 1
    return found


def activitynet(inputs: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
    """The tree of ActivityNet's detection results (Caba Heilbron et al. 2015)."""
    results = {
        printable(name): [
            {"label": row.label, "segment": [row.start, row.end], "score": row.score} for row in events
        ]
        for name, events in inputs.items()
    }
    return {"version": "VERSION 1.3", "results": results, "external_data": {}}


def _media(name: str, place: Path | None, folder: Path | None) -> tuple[str, str | None] | None:
    """What ELAN is to play: its URL, and where it is from ``folder``; None of what is no video.

    ELAN takes both literally, and writes them so: a blank is a blank.
    """
    if is_address(name):
        return printable(name), None
    if place is None or not (place.suffix.lower() in VIDEO_SUFFIXES or begins_as_video(place)):
        return None
    url = "file:///" + printable(place.as_posix()).lstrip("/")
    try:
        real = place.parent.resolve() / place.name
        near = Path(os.path.relpath(real, folder.resolve())).as_posix() if folder else None
    except ValueError:  # on another drive of Windows
        near = None
    return url, near and printable(near if near.startswith("../") else f"./{near}")


def _write_elan(media: tuple[str, str | None] | None, events: Sequence[Row], path: Path) -> None:
    try:
        from pympi import Elan
    except ImportError:
        raise _missing("ELAN files need pympi-ling") from None
    document = Elan.Eaf(author="gesture-core")
    document.remove_tier("default")
    if media is not None:
        document.add_linked_file(*media, mimetype="video/*")
    every = tiers(events) or {"person 0": []}
    for tier, some in every.items():
        document.add_tier(tier)
        for row in some:
            start, end = _milliseconds(row.start), _milliseconds(row.end)
            document.add_annotation(tier, start, max(end, start + 1), printable(row.label or ""))
    document.to_file(str(path))


def _write_vtt(events: Sequence[Row], path: Path) -> None:
    try:
        import webvtt
    except ImportError:
        raise _missing("WebVTT files need webvtt-py") from None
    document = webvtt.WebVTT()
    for row in _in_order(events):
        text = html.escape(_said(row, events), quote=False)
        document.captions.append(webvtt.Caption(_clock(row.start, "."), _clock(row.end, "."), text))
    with path.open("w", encoding="utf-8") as file:
        document.write(file)


def _write_srt(events: Sequence[Row], path: Path) -> None:
    blocks = [
        f"{number}\n{_clock(row.start, ',')} --> {_clock(row.end, ',')}\n{_said(row, events)}\n"
        for number, row in enumerate(_in_order(events), 1)
    ]
    path.write_text("\n".join(blocks), "utf-8")


def _write_audacity(events: Sequence[Row], path: Path) -> None:
    """A label track: start, end and text, with tabs between them."""
    lines = [
        f"{row.start or 0.0:.6f}\t{row.end or 0.0:.6f}\t{_said(row, events)}\n" for row in _in_order(events)
    ]
    path.write_text("".join(lines), "utf-8")


_WRITERS: Mapping[str, Callable[[Sequence[Row], Path], None]] = {
    "vtt": _write_vtt,
    "srt": _write_srt,
    "audacity": _write_audacity,
}


def _missing(what: str) -> MissingDependencyError:
    return MissingDependencyError(what, remedy="pip install 'gesture-core[events]'")


def _in_order(events: Sequence[Row]) -> list[Row]:
    return sorted(events, key=lambda row: (row.start or 0.0, row.person))


def _said(row: Row, events: Sequence[Row]) -> str:
    """The label, with the person in front where there are several."""
    text = printable(row.label or "").replace("\n", " ")
    return f"person {row.person}: {text}" if len({one.person for one in events}) > 1 else text


def _milliseconds(seconds: float | None) -> int:
    return max(0, round((seconds or 0.0) * 1000))


def _clock(seconds: float | None, point: str) -> str:
    whole, part = divmod(_milliseconds(seconds), 1000)
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}{point}{part:03d}"


def _free(folder: Path, name: str, suffix: str, taken: Sequence[Path]) -> Path:
    """A file of the input's name in ``folder`` that no other input of the run has."""
    path, _, member = name.partition("::")
    stem = printable(Path(path).stem) + (f"-{printable(member).replace('/', '_')}" if member else "")
    number, free = 1, folder / f"{stem}{suffix}"
    while free in taken:
        number += 1
        free = folder / f"{stem}-{number}{suffix}"
    return free
