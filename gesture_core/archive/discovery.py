"""From what the user typed to a list of inputs, in a stable order."""

from __future__ import annotations

import csv
import glob
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gesture_core.errors import ConfigError, GestureError, InputError, PluginError
from gesture_core.plugin import registry

VIDEO_SUFFIXES = frozenset(
    ".mp4 .m4v .mov .qt .avi .mkv .webm .flv .f4v .wmv .asf .mpg .mpeg .m2v .vob .ts .mts .m2ts "
    ".3gp .3g2 .ogv .ogg .mxf .dv .gif .264 .h264 .265 .h265 .hevc .mjpg .mjpeg .y4m".split()
)
_MANIFEST_COLUMNS = ("path", "input", "file", "video")


@dataclass(frozen=True)
class Input:
    """One thing to classify, or one example.

    Attributes
    ----------
    path : Path
        File or folder.
    name : str
        As shown to the user; bytes that are no UTF-8 are escaped.
    kind : "video", "keypoints" or "other"
        Anything but the first two gets a row with the status ``skipped``.
    member : str
        The sequence inside a file or folder that holds several.
    reader : str
        Name of the keypoint reader.
    label : str or None
        The gesture, for examples and labelled archives.
    fault : str
        Why it cannot be read, where that is already known.
    """

    path: Path
    name: str
    kind: str
    member: str = ""
    reader: str = ""
    label: str | None = None
    fault: str = ""

    @property
    def key(self) -> bytes:
        """Identity inside a run: the exact bytes of the path, and the member."""
        return os.fsencode(self.path.absolute()) + (b"\0" + self.member.encode("utf-8", "surrogatepass"))


def printable(text: str) -> str:
    """``text`` with bytes that are no UTF-8 written as ``\\xNN``, fit for SQLite and terminals."""
    return os.fsencode(text).decode("utf-8", "backslashreplace") if os.name == "posix" else text


def discover(sources: Sequence[str | os.PathLike[str]], *, avoid: Path | None = None) -> list[Input]:
    """Inputs in ``sources``: files, folders (walked), globs, or text and CSV manifests.

    Parameters
    ----------
    sources : sequence of path
        A text manifest (``.txt``) has one path a line; a CSV manifest has a column ``path`` and
        perhaps ``label``. Relative paths in it start at its own folder.
    avoid : Path, optional
        A folder that is not walked into: the run folder.

    Returns
    -------
    list of Input
        Each once, sorted by name within a folder. Names that begin with a dot are passed over.

    Raises
    ------
    InputError
        Where a source or a path in a manifest does not exist.
    """
    found: dict[bytes, Input] = {}
    for source in sources:
        for item in _source(Path(source), avoid.resolve() if avoid else None):
            found.setdefault(item.key, item)
    return list(found.values())


def _source(path: Path, avoid: Path | None) -> Iterator[Input]:
    if not path.exists():
        text = os.fspath(path)
        matches = sorted(glob.glob(text, recursive=True)) if glob.has_magic(text) else []  # noqa: PTH207
        if not matches:
            raise InputError(
                "no such file or folder", subject=printable(text), remedy="check the path", code="E_NOT_FOUND"
            )
        for match in matches:
            yield from _source(Path(match), avoid)
    elif path.is_dir():
        yield from _folder(path, avoid, frozenset())
    elif (entries := _manifest(path)) is not None:
        for entry, label in entries:
            for item in _source(entry, avoid):
                yield replace(item, label=label) if label else item
    else:
        yield from _file(path)


def _folder(folder: Path, avoid: Path | None, above: frozenset[Path]) -> Iterator[Input]:
    real = folder.resolve()
    if real == avoid or real in above:  # the run itself, or a link back to a folder above
        return
    reader, _ = _reader(folder)
    if reader:
        yield from _members(folder, reader)
        return
    try:
        entries = sorted(folder.iterdir(), key=lambda entry: os.fsencode(entry.name))
    except OSError as error:
        yield Input(
            folder, printable(os.fspath(folder)), "other", fault=f"cannot be listed: {error.strerror}"
        )
        return
    for entry in entries:
        if entry.name.startswith("."):
            continue
        if entry.is_dir():
            yield from _folder(entry, avoid, above | {real})
        else:
            yield from _file(entry)


def _file(path: Path) -> Iterator[Input]:
    name = printable(os.fspath(path))
    if not path.is_file():
        yield Input(path, name, "other", fault="not a regular file")
    elif path.suffix.lower() in VIDEO_SUFFIXES:
        yield Input(path, name, "video")
    else:
        reader, broken = _reader(path)
        if reader:
            yield from _members(path, reader)
        else:
            yield Input(path, name, "other", fault=f"neither a video nor a keypoint file{broken}")


def _reader(path: Path) -> tuple[str, str]:
    """Name of the keypoint reader that accepts ``path``, or none and which readers are broken."""
    plugins = registry()
    broken = ""
    for name in plugins.names("reader", usable=True):
        try:
            if plugins.make("reader", name).accepts(path):
                return name, ""
        except PluginError as error:
            broken += f"; {error.cause}"
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
            origin = plugins.find("reader", name).origin
            broken += f"; reader {name!r} of {origin} raised {type(error).__name__}: {error}"
    return "", broken


def _members(path: Path, reader: str) -> Iterator[Input]:
    name = printable(os.fspath(path))
    try:
        members = registry().make("reader", reader).members(path)
    except GestureError as error:
        yield Input(path, name, "other", fault=f"{error.code} {error.cause}")
        return
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
        origin = registry().find("reader", reader).origin
        yield Input(path, name, "other", fault=f"{origin} raised {type(error).__name__}: {error}")
        return
    for member in members:
        shown = f"{name}::{printable(member)}" if member else name
        yield Input(path, shown, "keypoints", member, reader)


def _manifest(path: Path) -> list[tuple[Path, str | None]] | None:
    """Paths and labels listed in ``path``; None where it is no manifest."""
    suffix = path.suffix.lower()
    if suffix not in (".txt", ".csv"):
        return None
    with path.open(encoding="utf-8", errors="surrogateescape", newline="") as file:
        if suffix == ".txt":
            lines = [line.rstrip("\r\n") for line in file]
            return [(path.parent / line, None) for line in lines if line.strip() and not line.startswith("#")]
        rows = csv.DictReader(file)
        column = next((c for c in _MANIFEST_COLUMNS if c in (rows.fieldnames or ())), None)
        if column is None:
            return None
        return [(path.parent / row[column], row.get("label") or None) for row in rows if row[column]]


def label_inputs(items: Sequence[Input], labels: str, roots: Sequence[str | os.PathLike[str]]) -> list[Input]:
    """Give each input its label.

    Parameters
    ----------
    items : sequence of Input
    labels : str
        ``folder``: the first folder below its root. A path to a ``.csv`` file with the columns
        ``path`` and ``label``. Otherwise a regular expression whose group ``label``, or first
        group, is searched in the name.
    roots : sequence of path
        The sources that the inputs were found in.

    Raises
    ------
    ConfigError
        Where the expression is wrong, or an input gets no label; a label from a manifest is kept.
    """
    find = _labeller(labels, [Path(root) for root in roots])
    labelled = []
    for item in items:
        label = item.label or find(item)
        if not label:
            raise ConfigError(
                f"no label for {item.name} by {labels!r}",
                remedy="examples/<label>/<clip>, a CSV file with path and label, or a regular expression",
                code="E_LABELS",
            )
        labelled.append(replace(item, label=label))
    return labelled


def _labeller(labels: str, roots: Sequence[Path]):  # type: ignore[no-untyped-def]
    if labels == "folder":
        return lambda item: _folder_label(item.path, roots)
    if labels.lower().endswith(".csv"):
        try:
            entries = _manifest(Path(labels)) or []
        except OSError as error:
            raise ConfigError(f"cannot be read: {error.strerror}", subject=labels, code="E_LABELS") from None
        table = {path.resolve(): label for path, label in entries}
        return lambda item: table.get(item.path.resolve())
    try:
        pattern = re.compile(labels)
    except re.error as error:
        raise ConfigError(f"labels {labels!r} is no regular expression: {error}", code="E_LABELS") from None
    if not pattern.groups:
        raise ConfigError(f"labels {labels!r} has no group", remedy="(?P<label>…)", code="E_LABELS")

    def search(item: Input) -> str | None:
        match = pattern.search(item.member or item.path.name) or pattern.search(item.name)
        return match.groupdict().get("label") or match.group(1) if match else None

    return search


def _folder_label(path: Path, roots: Sequence[Path]) -> str | None:
    for root in roots:
        if path.is_relative_to(root):
            parts = path.relative_to(root).parts
            if len(parts) > 1:
                return printable(parts[0])
    return None
