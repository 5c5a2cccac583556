"""From what the user typed to a list of inputs, in a stable order."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gesture_core.archive.labels import printable, read_manifest
from gesture_core.errors import GestureError, InputError, PluginError
from gesture_core.plugin import registry

VIDEO_SUFFIXES = frozenset(
    ".mp4 .m4v .mov .qt .avi .mkv .webm .flv .f4v .wmv .asf .mpg .mpeg .m2v .vob .ts .mts .m2ts "
    ".3gp .3g2 .ogv .ogg .mxf .dv .gif .264 .h264 .265 .h265 .hevc .mjpg .mjpeg .y4m".split()
)


@dataclass(frozen=True)
class Input:
    """One thing to classify, or one example.

    Attributes
    ----------
    path : Path
        File or folder.
    name : str
        As shown to the user; bytes that are no UTF-8 are escaped.
    kind : "video", "keypoints", "broken" or "other"
        What nobody reads is ``other`` and gets a row with the status ``skipped``; what should be
        readable and is not is ``broken`` and gets an error.
    member : str
        The sequence inside a file or folder that holds several.
    reader : str
        Name of the keypoint reader.
    label : str or None
        The gesture, for examples and labelled archives.
    code, fault : str
        Why it cannot be read, where that is already known.
    """

    path: Path
    name: str
    kind: str
    member: str = ""
    reader: str = ""
    label: str | None = None
    code: str = ""
    fault: str = ""

    @property
    def key(self) -> bytes:
        """Identity inside a run: the exact bytes of the absolute path, and the member."""
        return self.place + b"\0" + self.member.encode("utf-8", "surrogatepass")

    @property
    def place(self) -> bytes:
        """The exact bytes of the absolute path."""
        return os.fsencode(os.path.normpath(self.path.absolute()))


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
    walk = _Walk(avoid.resolve() if avoid else None)
    found: dict[bytes, Input] = {}
    for source in sources:
        for item in walk.source(Path(source)):
            found.setdefault(item.key, item)
    return list(found.values())


class _Walk:
    """Remembers which folders it has been in, so that no link leads round in circles."""

    def __init__(self, avoid: Path | None) -> None:
        self._avoid = avoid
        self._been: set[Path] = set()

    def source(self, path: Path) -> Iterator[Input]:
        """Inputs of something that the user named: a path, a glob or a manifest."""
        if path.is_file() and (entries := read_manifest(path)) is not None:
            for entry, label in entries:
                if not entry.exists():
                    raise _not_found(entry, f"listed in {printable(os.fspath(path))}")
                for item in self.path(entry):
                    yield replace(item, label=label) if label else item
        elif path.exists():
            yield from self.path(path)
        else:
            text = os.fspath(path)
            matches = sorted(glob.glob(text, recursive=True)) if glob.has_magic(text) else []  # noqa: PTH207
            if not matches:
                raise _not_found(path)
            for match in matches:
                yield from self.path(Path(match))

    def path(self, path: Path) -> Iterator[Input]:
        """Inputs in a file or folder."""
        if path.is_dir():
            yield from self._folder(path)
        else:
            yield from _file(path)

    def _folder(self, folder: Path) -> Iterator[Input]:
        real = folder.resolve()
        if real == self._avoid or real in self._been:
            return
        self._been.add(real)
        try:
            entries = sorted(folder.iterdir(), key=lambda entry: os.fsencode(entry.name))
        except OSError as error:
            yield _broken(folder, "E_READ", f"cannot be listed: {error.strerror}")
            return
        reader, _ = _reader(folder)
        if reader:
            yield from _members(folder, reader)
        for entry in entries:
            if entry.name.startswith("."):
                continue
            if entry.is_dir():
                yield from self._folder(entry)
                continue
            # What nobody else reads in a folder of keypoint files belongs to that folder.
            yield from (item for item in _file(entry) if not (reader and item.kind == "other"))


def _not_found(path: Path, where: str = "") -> InputError:
    return InputError(
        f"no such file or folder{f', {where}' if where else ''}",
        subject=printable(os.fspath(path)),
        remedy="check the path",
        code="E_NOT_FOUND",
    )


def _broken(path: Path, code: str, fault: str) -> Input:
    return Input(path, printable(os.fspath(path)), "broken", code=code, fault=fault)


def _file(path: Path) -> Iterator[Input]:
    name = printable(os.fspath(path))
    if not path.is_file():
        dangling = path.is_symlink() and not path.exists()
        yield _broken(path, "E_READ", "leads nowhere" if dangling else "is not a regular file")
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
        yield _broken(path, error.code, error.cause)
        return
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
        origin = registry().find("reader", reader).origin
        yield _broken(path, "E_PLUGIN_RAISED", f"{origin} raised {type(error).__name__}: {error}")
        return
    for member in members:
        shown = f"{name}::{printable(member)}" if member else name
        yield Input(path, shown, "keypoints", member, reader)
