"""From what the user typed to a list of inputs, in a stable order."""

from __future__ import annotations

import errno
import glob
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gesture_core.errors import GestureError, InputError
from gesture_core.files import printable
from gesture_core.run import journal, lock
from gesture_core.run.manifests import read_manifest
from gesture_core.run.readers import Readers
from gesture_core.run.sandbox import Sandbox
from gesture_core.settings import LimitSettings

VIDEO_SUFFIXES = frozenset(
    ".mp4 .m4v .mov .qt .avi .mkv .webm .flv .f4v .wmv .asf .mpg .mpeg .m2v .vob .ts .mts .m2ts "
    ".3gp .3g2 .ogv .ogg .mxf .dv .gif .264 .h264 .265 .h265 .hevc .mjpg .mjpeg .y4m".split()
)
PICTURE_SUFFIXES = frozenset(".jpg .jpeg .png .bmp .ppm .tif .tiff .webp".split())
FRAMES = "a video of the frames, if it is one of them (ffmpeg -framerate 25 -i %04d.jpg clip.mp4)"
"""What to try with a picture."""
_OWN_FILES = frozenset(
    {journal.FILE_NAME, *(f"{journal.FILE_NAME}{end}" for end in ("-wal", "-shm")), lock.FILE_NAME}
)
"""What a run leaves in its folder besides its result, which may lie among videos or examples."""


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


def discover(
    sources: Sequence[str | os.PathLike[str]], *, avoid: Path | None = None, readers: Readers | None = None
) -> list[Input]:
    """Inputs in ``sources``: files, folders (walked), globs, or text and CSV manifests.

    Parameters
    ----------
    sources : sequence of path
        A text manifest (``.txt``) has one path a line; a CSV manifest has a column ``path`` and
        perhaps ``label``. Relative paths in it start at its own folder.
    avoid : Path, optional
        A folder that is not walked into: the run folder.
    readers : Readers, optional
        Who is asked what is a keypoint file; by default those of third parties in a process of their own.

    Returns
    -------
    list of Input
        Each once, sorted by name within a folder. Names that begin with a dot, and the journals of
        runs, are passed over.

    Raises
    ------
    InputError
        Where a source or a path in a manifest does not exist, or is listed with two labels.
    """
    if readers is None:
        with Sandbox(LimitSettings()) as sandbox:
            return discover(sources, avoid=avoid, readers=Readers(sandbox))
    walk = _Walk(avoid, readers)
    found: dict[bytes, Input] = {}
    for source in sources:
        if "://" in os.fspath(source):
            raise InputError(
                "is an address", subject=str(source), remedy="downloading it first", code="E_NOT_FOUND"
            )
        for item in walk.source(Path(source)):
            known = found.setdefault(item.key, item)
            if known.label and item.label and known.label != item.label:
                raise InputError(
                    f"is listed as {known.label} and as {item.label}",
                    subject=item.name,
                    remedy="one line for it in the manifest",
                    code="E_CONTRADICTION",
                )
    return list(found.values())


class _Walk:
    """Remembers which folders it has been in, so that no link leads round in circles."""

    def __init__(self, avoid: Path | None, readers: Readers) -> None:
        self._avoid = _identity(avoid) if avoid and avoid.exists() else None
        self._readers = readers
        self._been: set[tuple[int, int]] = set()

    def source(self, path: Path) -> Iterator[Input]:
        """Inputs of something that the user named: a path, a glob or a manifest."""
        if path.is_file() and (entries := read_manifest(path)) is not None:
            for entry, label in entries:
                if not _exists(entry):
                    raise _not_found(
                        entry, f"in {printable(os.fspath(path))}, which is read as a list of paths"
                    )
                if label:  # a folder inside another one has been walked into, by another label perhaps
                    self._been.clear()
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
        if not path.is_dir():
            yield from self._file(path)
            return
        # Folders may be nested deeper than functions can be.
        open_folders = [self._folder(path)]
        while open_folders:
            item = next(open_folders[-1], None)
            if item is None:
                open_folders.pop()
            elif isinstance(item, Path):
                open_folders.append(self._folder(item))
            else:
                yield item

    def _folder(self, folder: Path) -> Iterator[Input | Path]:
        """What is directly in a folder: inputs, and folders to go into."""
        try:
            identity = _identity(folder)
            if identity == self._avoid or identity in self._been:
                return
            self._been.add(identity)
            entries = sorted(folder.iterdir(), key=lambda entry: os.fsencode(entry.name))
            folders = {entry for entry in entries if _is_folder(entry)}
        except OSError as error:
            yield _broken(folder, "E_READ", f"cannot be listed: {error.strerror}")
            return
        entries = [e for e in entries if not e.name.startswith(".") and e.name not in _OWN_FILES]
        self._readers.expect([folder, *(e for e in entries if e not in folders and not _is_video(e))])
        reader, fault = self._readers.of(folder)
        if reader:
            yield from self._members(folder, reader)
        for entry in entries:
            if entry in folders:
                yield entry
            else:
                for item in self._file(entry):
                    if item.kind != "other":
                        yield item
                    elif fault:  # it may have been a folder of keypoint files; nobody can say
                        yield replace(item, kind="broken", code=fault[0], fault=f"of its folder, {fault[1]}")
                    elif not reader:  # in a folder of keypoint files it belongs to that folder
                        yield item

    def _file(self, path: Path) -> Iterator[Input]:
        name = printable(os.fspath(path))
        try:
            fault = "" if path.is_file() else "is not a regular file" if path.exists() else "leads nowhere"
        except OSError as error:
            fault = f"cannot be looked at: {error.strerror}"
        if fault:
            yield _broken(path, "E_READ", fault)
        elif _is_video(path):
            yield Input(path, name, "video")
        else:
            reader, trouble = self._readers.of(path)
            if reader:
                yield from self._members(path, reader)
            elif trouble:
                yield _broken(path, *trouble)
            else:
                yield Input(path, name, "other", fault="neither a video nor a keypoint file")

    def _members(self, path: Path, reader: str) -> Iterator[Input]:
        name = printable(os.fspath(path))
        try:
            members = self._readers.members(reader, path)
        except GestureError as error:
            yield _broken(path, error.code, error.cause)
            return
        for member in members:
            shown = f"{name}::{printable(member)}" if member else name
            yield Input(path, shown, "keypoints", member, reader)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        return False


def _not_found(path: Path, where: str = "") -> InputError:
    missing = "nothing matches" if glob.has_magic(os.fspath(path)) else "no such file or folder"
    return InputError(
        f"{missing}{f', {where}' if where else ''}",
        subject=printable(os.fspath(path)),
        remedy="check the path",
        code="E_NOT_FOUND",
    )


def _broken(path: Path, code: str, fault: str) -> Input:
    return Input(path, printable(os.fspath(path)), "broken", code=code, fault=fault)


def _identity(folder: Path) -> tuple[int, int]:
    """The same for all ways that lead to one folder."""
    found = folder.stat()
    return found.st_dev, found.st_ino


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:  # a link into a folder that is closed to us; it is a row like any other
        return False


def _is_video(path: Path) -> bool:
    return path.suffix.lower() in VIDEO_SUFFIXES
