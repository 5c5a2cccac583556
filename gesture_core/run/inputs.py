"""From what the user typed to a list of inputs, in a stable order: files, folders, globs, manifests."""

from __future__ import annotations

import errno
import glob
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from gesture_core.errors import GestureError, InputError
from gesture_core.files import look_at, made_up, passed_over, pointer, printable
from gesture_core.records import Job
from gesture_core.run.addresses import drop, entries, fetch, is_address, local_path, shown
from gesture_core.run.readers import Readers, is_text_of_series
from gesture_core.run.results import OWN_FILES
from gesture_core.run.workers.engines import Assistant
from gesture_core.settings import Settings
from gesture_core.video.containers import PICTURES, begins_as_video

VIDEO_SUFFIXES = frozenset(
    ".mp4 .m4v .mov .qt .avi .mkv .webm .flv .f4v .wmv .asf .mpg .mpeg .m2v .vob .ts .mts .m2ts "
    ".3gp .3g2 .ogv .ogg .mxf .dv .gif .264 .h264 .265 .h265 .hevc .mjpg .mjpeg .y4m".split()
)
SOUND_SUFFIXES = frozenset(".m4a .m4b .m4r .mka .weba .oga .opus .spx .wma .mp3 .wav .flac .aac".split())
PICTURE_SUFFIXES = frozenset(".jpg .jpeg .png .bmp .ppm .tif .tiff .webp".split())
# What lies beside clips and never is one: notes, subtitles, thumbnails, and what file managers leave.
COMPANIONS = frozenset(
    ".txt .md .log .pdf .html .srt .vtt .ass .jpg .jpeg .png .xml .yaml .yml .toml .ini .db .lnk".split()
)
_MANIFESTS = (".txt", ".csv")
_KEPT = 1 << 30
"""Bytes of fetched files that stay until their turn comes; further ones are fetched again."""
_NAMED = 5  # files that a message lists
FRAMES = (
    "a video of the frames, if it is one of them (ffmpeg -framerate 25 -i %04d.jpg clip.mp4), "
    "or --preset pose, if it shows a posture"
)
"""What to try with a picture."""


@dataclass(frozen=True, slots=True)
class Input:
    """One thing to classify, or one example. There may be a million of them.

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
    code, fault, remedy : str
        Why it cannot be read, where that is already known, and what helps.
    stamp : str
        From `files.stamp`, when a run began; empty where the file could not be looked at.
    sha256 : str
        Content hash of an example, at that time; empty where it could not be read.
    address : str
        Where fsspec finds it; empty for a file. It is at ``path`` once it is fetched.
    key : bytes
        Identity inside a run: the exact bytes of the absolute path, and the member.
    """

    path: Path
    name: str
    kind: str
    member: str = ""
    reader: str = ""
    label: str | None = None
    code: str = ""
    fault: str = ""
    remedy: str = ""
    stamp: str = ""
    sha256: str = ""
    address: str = field(default="", repr=False)
    key: bytes = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        where = shown(self.address) if self.address else os.path.abspath(self.path)  # noqa: PTH100 - ten times as fast as pathlib
        place = os.fsencode(where)
        object.__setattr__(self, "key", place + b"\0" + self.member.encode("utf-8", "surrogatepass"))

    @property
    def readable(self) -> bool:
        """It is a video, or keypoints that somebody reads."""
        return self.kind in ("video", "keypoints")

    @property
    def place(self) -> bytes:
        """The exact bytes of the absolute path."""
        return self.key.partition(b"\0")[0]

    def error(self) -> InputError:
        """Why it is broken, as an error."""
        remedy = self.remedy or "repairing it"
        return InputError(self.fault, subject=self.name, remedy=remedy, code=self.code or None)


def discover(
    sources: Sequence[str | os.PathLike[str]],
    *,
    avoid: Path | None = None,
    assistant: Assistant | None = None,
    settings: Settings | None = None,
) -> list[Input]:
    """Inputs in ``sources``: files, folders (walked), globs, or text and CSV manifests.

    Parameters
    ----------
    sources : sequence of path
        A text manifest (``.txt``) has one path or address a line; a CSV manifest has a column ``path`` and
        perhaps ``label``. Relative paths in it start at its own folder.
    avoid : Path, optional
        A folder that is not walked into: the run folder.
    assistant : Assistant, optional
        Where keypoint readers are asked what is theirs; one of its own by default, with the ``settings``.
    settings : Settings, optional
        What files leave open may decide who reads them.

    Returns
    -------
    list of Input
        Each once, sorted by name within a folder. What is hidden (`files.passed_over`) and the journals
        of runs are left out. A pattern that matches nothing is ``broken`` where another holds anything.

    Warns
    -----
    UserWarning
        Where one of several sources holds nothing.

    Raises
    ------
    InputError
        Where a source or a path in a manifest does not exist, no pattern matches anything, or a path is
        listed with two labels.
    """
    if assistant is None:
        settings = settings or Settings()
        with Assistant(Job(settings.as_dict(), ""), settings.limits) as own:
            return discover(sources, avoid=avoid, assistant=own)
    walk = Walk(avoid, Readers(assistant))
    found: dict[bytes, Input] = {}
    empty = []
    for source in sources:
        text = os.fspath(source)
        before, items = walk.passed, list(walk.source(text))
        if not items and walk.passed == before:
            empty.append(shown(text))
        for item in items:
            known = found.setdefault(item.key, item)
            if known.label and item.label and known.label != item.label:
                raise InputError(
                    f"is listed as {known.label} and as {item.label}",
                    subject=item.name,
                    remedy="one line for it in the manifest",
                    code="E_CONTRADICTION",
                )
            if item.readable and known.address != item.address:
                raise InputError(
                    "is listed with two queries, and a query is not kept",
                    subject=item.name,
                    remedy="addresses that differ before the ?",
                    code="E_CONTRADICTION",
                )
    if found and all(item.code == "E_NOT_FOUND" for item in found.values()):
        raise first.error() if (first := next(iter(found.values()))).address else _not_found(first.path)
    if empty and found:
        warnings.warn(f"holds nothing to read: {', '.join(empty)}", stacklevel=2)
    return list(found.values())


def discover_readable(
    sources: Sequence[str | os.PathLike[str]], *, avoid: Path | None = None, settings: Settings | None = None
) -> list[Input]:
    """As `discover`, without what nobody reads, of which a UserWarning tells; an InputError for nothing."""
    every = discover(sources, avoid=avoid, settings=settings)
    found = [item for item in every if item.kind != "other"]
    if not found:
        raise InputError(
            "holds no video or keypoint file",
            subject=", ".join(shown(os.fspath(source)) for source in sources),
            remedy="another path",
            code="E_EMPTY",
        )
    if others := [item.name for item in every if item.kind == "other"]:
        some = ", ".join(others[:_NAMED]) + (", …" if others[_NAMED:] else "")
        count = f"{len(others)} file{'s' if others[1:] else ''}"
        warnings.warn(f"left out as neither video nor keypoints: {count}, {some}", stacklevel=3)
    return found


class Walk:
    """Remembers which folders it has been in, so that no link leads round in circles."""

    def __init__(self, avoid: Path | None, readers: Readers) -> None:
        self._avoid = _identity(avoid) if avoid and avoid.exists() else None
        self._readers = readers
        self._been: set[tuple[int, int]] = set()
        self._fetched = 0
        self.passed = 0
        """Folders that were not entered, since they had been entered before."""

    def source(self, text: str) -> Iterator[Input]:
        """Inputs of something that the user named: an address, a path, a glob or a manifest."""
        if is_address(text):
            yield from self.address(text)
            return
        entries, path = None, Path(local_path(text))
        if path.suffix.lower() in _MANIFESTS and path.is_file() and not self._is_text_of_keypoints(path):
            from gesture_core.run.tables import read_manifest

            entries = None if self._may_be_video(path) else read_manifest(path)
        if entries is not None:
            for entry, label in entries:
                if isinstance(entry, Path) and not exists(entry):
                    raise _not_found(
                        entry, f"in {printable(os.fspath(path))}, which is read as a list of paths"
                    )
                if label:  # a folder inside another one has been walked into, by another label perhaps
                    self._been.clear()
                for item in self.address(entry) if isinstance(entry, str) else self.path(entry):
                    yield replace(item, label=label) if label else item
        elif exists(path):
            yield from self.path(path)
        else:
            if not glob.has_magic(os.fspath(path)):
                raise _not_found(path)
            matches = sorted(glob.glob(os.fspath(path), recursive=True))  # noqa: PTH207
            if not matches:  # of several patterns, as a set of cameras has them, one may match nothing
                yield _broken(path, "E_NOT_FOUND", "nothing matches", "another pattern")
            for match in matches:
                yield from self.path(Path(match))

    def _is_text_of_keypoints(self, path: Path) -> bool:
        """Whether a text, which may be a list of paths, is what a keypoint reader takes."""
        return path.suffix.lower() == ".txt" and bool(self._readers.of(path)[0])

    def address(self, source: str) -> Iterator[Input]:
        """Inputs of an address. Only what is no video by its name is fetched now, to see whose it is."""
        nobodys = (COMPANIONS | PICTURE_SUFFIXES | SOUND_SUFFIXES) - self._readers.suffixes
        for path, entry in entries(source):
            about = {"name": shown(entry.address), "address": entry.address, "stamp": entry.stamp}
            if self._is_video(path) or path.suffix.lower() in nobodys:
                yield Input(path, kind="video" if self._is_video(path) else "other", **about)
                continue
            try:
                fetch(entry, path)
            except InputError as error:
                fault = error.message.removeprefix(f"{error.subject}: ")
                yield Input(path, kind="broken", code=error.code, fault=fault, **about)
                continue
            found = list(self._file(path))
            for item in found:
                name = about["name"] + (f"::{printable(item.member)}" if item.member else "")
                yield replace(item, name=name, address=entry.address, stamp=entry.stamp)
            self._fetched += entry.size or 0
            if self._fetched > _KEPT or not any(item.readable for item in found):
                drop(path)

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
            if fault := made_up(folder.stat()):
                yield _broken(folder, "E_READ", *fault)
                return
            identity = _identity(folder)
            if identity == self._avoid or identity in self._been:
                self.passed += 1
                return
            self._been.add(identity)
            names, folders, lost = list[str](), set[str](), False
            with os.scandir(folder) as found:  # which knows most folders without a look at them
                for one in found:
                    if not passed_over(one.name) and one.name not in OWN_FILES:
                        names.append(one.name)
                        with suppress(OSError):  # a link into a folder that is closed to us is a row, too
                            folders |= {one.name} if one.is_dir() else set()
        except OSError as error:
            yield _broken(folder, "E_READ", f"cannot be listed: {error.strerror}")
            return
        entries = [(folder / name, name in folders) for name in sorted(names, key=os.fsencode)]
        files = [entry for entry, is_folder in entries if not is_folder and not self._is_video(entry)]
        self._readers.expect(files)
        reader, fault = self._readers.of(folder, {file.suffix.lower() for file in files})
        if reader:
            yield from self._members(folder, reader)
        for entry, is_folder in entries:
            if is_folder:
                yield entry
            else:
                own = entry.suffix.lower() in COMPANIONS or self._readers.may_take(reader, entry)
                beside = bool(reader) and own
                for item in self._file(entry, say_why=not (beside or fault)):
                    if item.kind == "other" and fault:  # its folder may have been one of keypoint files
                        yield replace(item, kind="broken", code=fault[0], fault=f"of its folder, {fault[1]}")
                    elif item.readable or not beside or (item.kind == "broken" and not lost):
                        lost |= beside and item.kind == "broken"  # of a folder's frames, the first one
                        yield item

    def _file(self, path: Path, *, say_why: bool = True) -> Iterator[Input]:
        name = printable(os.fspath(path))
        stamp, fault = look_at(path)
        if fault:
            yield _broken(path, "E_READ", *fault)
        elif self._is_video(path):
            yield Input(path, name, "video", stamp=stamp)
        else:
            reader, trouble = self._readers.of(path)
            if reader:
                yield from self._members(path, reader)
            elif self._may_be_video(path):
                yield Input(path, name, "video", stamp=stamp)
            elif trouble:
                yield _broken(path, *trouble)
            elif path.suffix.lower() in self._readers.suffixes | {".dvc"} and (fault := pointer(path)):
                yield _broken(path, "E_READ", *fault)
            else:
                yield Input(path, name, "other", fault=self._readers.why_not(path) if say_why else "")

    def _is_video(self, path: Path) -> bool:
        if self._readers.channels:
            return False
        suffix = path.suffix.lower()
        named = suffix in VIDEO_SUFFIXES or (self._readers.pictures and suffix in PICTURES)
        return named and not (suffix == ".ts" and is_text_of_series(path))

    def _may_be_video(self, path: Path) -> bool:
        """Whether what no reader takes is a video by its first bytes, whatever it is called but sound."""
        sound = path.suffix.lower() in SOUND_SUFFIXES
        return not (sound or self._readers.channels) and begins_as_video(path)

    def _members(self, path: Path, reader: str) -> Iterator[Input]:
        name = printable(os.fspath(path))
        try:
            members = self._readers.members(reader, path)
        except GestureError as error:
            yield _broken(path, error.code, error.cause, error.remedy)
            return
        for member in members:
            shown = f"{name}::{printable(member)}" if member else name
            # The files of collections of series say the label of each: it stands before its number.
            label = member.rpartition("/")[0] if self._readers.channels else ""
            yield Input(path, shown, "keypoints", member, reader, label or None)


def exists(path: Path) -> bool:
    """Whether there is anything, be it a link that leads nowhere."""
    try:
        return path.exists() or path.is_symlink()
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        return False


def _not_found(path: Path, where: str = "") -> InputError:
    missing = "nothing matches" if glob.has_magic(os.fspath(path)) else "no such file or folder"
    return InputError(
        f"{missing}{f', {where}' if where else ''}", subject=printable(os.fspath(path)),
        remedy=FRAMES if "%" in path.name else "check the path", code="E_NOT_FOUND",
    )  # fmt: skip


def _broken(path: Path, code: str, fault: str, remedy: str = "") -> Input:
    return Input(path, printable(os.fspath(path)), "broken", code=code, fault=fault, remedy=remedy)


def _identity(folder: Path) -> tuple[int, int]:
    """The same for all ways that lead to one folder."""
    found = folder.stat()
    return found.st_dev, found.st_ino
