"""Files and their names: where the package keeps things, how untrusted files are opened and read, how
files are written whole or not at all, their content hashes, and how a name is printed. Beside them, on how
many cores this process may compute.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import secrets
import stat as modes
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from gesture_core.errors import ConfigError, GestureError, InputError

if TYPE_CHECKING:
    import numpy as np

TEMPORARY = ".tmp-"
"""In the name of every file that has not taken its place yet."""
_PIECE = 8 << 20
_READ = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""Opening a named pipe would otherwise wait for somebody who writes."""
_UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters, line and paragraph separators, changes of the writing direction, half characters."""


def cache_dir() -> Path:
    """Folder of what may be deleted, keypoints above all: ``$GESTURE_CACHE``, or the user's cache folder."""
    override = os.environ.get("GESTURE_CACHE")
    if override:
        return Path(override).expanduser()
    import platformdirs

    return Path(platformdirs.user_cache_dir("gesture-core", appauthor=False))


def switched_on(variable: str) -> bool:
    """Whether an environment variable asks for something.

    ``GESTURE_NO_CACHE`` for work to be done again whose result is in the cache, ``GESTURE_TRACEBACK`` for the
    places where errors were raised, ``GESTURE_OFFLINE`` for no downloads.
    """
    return os.environ.get(variable, "").lower() not in ("", "0", "false", "no")


def models_dir() -> Path:
    """Folder of added model files: ``$GESTURE_MODELS``, or ``models`` in the user's data folder."""
    override = os.environ.get("GESTURE_MODELS")
    if override:
        return Path(override).expanduser()
    import platformdirs

    return Path(platformdirs.user_data_dir("gesture-core", appauthor=False)) / "models"


def printable(name: str | os.PathLike[str]) -> str:
    """A name as text that can be shown and stored anywhere.

    Bytes of a file name that are no UTF-8 become ``\\xNN``; so does whatever would move a cursor, break a
    line or turn the writing direction.
    """
    return _UNPRINTABLE.sub(_escaped, os.fspath(name))


def _escaped(found: re.Match[str]) -> str:
    code = ord(found[0])
    # Python keeps a byte that is no UTF-8 as half a character.
    return f"\\x{code - 0xDC00:02x}" if 0xDC80 <= code <= 0xDCFF else ascii(found[0])[1:-1]


def unreadable(path: Path) -> tuple[str, str] | None:
    """Why ``path`` is no regular file: cause and remedy; None where it is one.

    Links are followed, wherever they lead: archives of git-annex, DataLad and DVC, and the caches of hubs,
    consist of them. What the system makes up (``/proc``, ``/sys``) counts as no file, as it may have no end.
    """
    return look_at(path)[1]


def look_at(path: Path) -> tuple[str, tuple[str, str] | None]:
    """The `stamp` of a regular file, or why it is none as `unreadable` says it, by one look at it."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return "", _lost(path) if path.is_symlink() else ("no such file", "check the path")
    except OSError as error:
        if error.errno == errno.ELOOP:
            return "", ("is a link that leads back to itself", "the file itself in its place")
        return "", (f"cannot be looked at: {error.strerror}", "check its permissions")
    return _stamp(status), _no_content(status)


def _lost(link: Path) -> tuple[str, str]:
    """Cause and remedy of a link that leads nowhere."""
    target = link.readlink().as_posix()
    for mark, remedy in _KEEPERS.items():
        if mark in target:
            return "is a link to content that is not here", remedy.format(name=printable(link.name))
    return f"is a link that leads nowhere, to {printable(target)}", "the file itself, or another link"


def _no_content(status: os.stat_result) -> tuple[str, str] | None:
    if not modes.S_ISREG(status.st_mode):
        return "is not a regular file", "leave it out"
    return made_up(status)


def made_up(status: os.stat_result) -> tuple[str, str] | None:
    """Cause and remedy of a file or folder that the system makes up, as in ``/proc``; None for any other."""
    if status.st_dev in _made_up():
        return "is made up by the system, and holds no recording", "leave it out"
    return None


_SYSTEM = frozenset("@eadir @recycle #recycle #snapshot __macosx $recycle.bin lost+found".split()) | {
    "system volume information"
}


def passed_over(name: str) -> bool:
    """Whether a file or folder is hidden, or called as what systems and disks keep to themselves."""
    return name.startswith(".") or name.casefold() in _SYSTEM


@cache
def _made_up() -> frozenset[int]:
    """Devices of file systems whose files are no files."""
    found = set()
    for place in ("/proc", "/sys", "/sys/fs/cgroup", "/sys/kernel/debug", "/sys/kernel/tracing"):
        with suppress(OSError):
            found.add(os.stat(place).st_dev)  # noqa: PTH116 - a name of Linux
    return frozenset(found) - {os.stat(os.sep).st_dev}  # noqa: PTH116


_KEEPERS = {
    "annex/objects/": "git annex get {name}, or datalad get {name}",
    ".dvc/": "dvc pull",
    "dvc/": "dvc pull",
    "blobs/": "downloading it again, it lies in the cache of a hub",
}
"""What keeps the content of links, by a part of where they lead, and how to get it."""
_POINTERS = {
    b"version https://git-lfs": ("Git LFS", "git lfs pull"),
    b"/annex/objects/": ("git-annex", "git annex get {name}"),
}
_LONGEST_POINTER = 1024


def _pointer(path: Path, head: bytes) -> tuple[str, str] | None:
    """Cause and remedy where a file that begins with ``head`` only stands for content that is elsewhere."""
    for mark, (keeper, remedy) in _POINTERS.items():
        if head.startswith(mark):
            cause = f"is a pointer of {keeper}, and its content is not here"
            return cause, remedy.format(name=printable(path.name))
    return None


def pointer(path: Path) -> tuple[str, str] | None:
    """Cause and remedy where a regular file only stands for content that is elsewhere."""
    if path.suffix == ".dvc":
        absent = not path.with_suffix("").exists()
        return ("is a pointer of DVC, and its content is not here", "dvc pull") if absent else None
    with suppress(OSError):
        if path.stat().st_size < _LONGEST_POINTER:
            with path.open("rb") as file:
                return _pointer(path, file.read(64))
    return None


def open_regular(path: Path, limit: int, error: type[GestureError], codes: tuple[str, str, str]) -> BinaryIO:
    """Open the regular file ``path`` of at most ``limit`` bytes for reading.

    Parameters
    ----------
    path : Path
    limit : int
        Bytes.
    error : type of GestureError
        What is raised.
    codes : three str
        Where there is no such file, for what is no regular file (see `unreadable`), only a pointer to one or
        may not be read, for a larger one.

    Raises
    ------
    GestureError
        With one of ``codes``.
    """
    name = printable(path)
    missing, closed, too_large = codes
    try:
        descriptor = os.open(path, _READ)
    except FileNotFoundError as cause:
        fault = unreadable(path) or ("no such file", "check the path")
        raise error(fault[0], subject=name, remedy=fault[1], code=missing) from cause
    except (OSError, ValueError) as cause:
        text = cause.strerror if isinstance(cause, OSError) else str(cause)
        raise error(
            f"cannot be opened: {text}",
            subject=name,
            remedy="check its permissions",
            code=closed,
        ) from cause
    status = os.fstat(descriptor)
    broken = _no_content(status)
    if broken is None and status.st_size < _LONGEST_POINTER:
        broken = _pointer(path, os.read(descriptor, 64))
        os.lseek(descriptor, 0, os.SEEK_SET)
    if broken:
        os.close(descriptor)
        raise error(broken[0], subject=name, remedy=broken[1], code=closed)
    if status.st_size > limit:
        os.close(descriptor)
        raise error(
            f"has {status.st_size} bytes, more than the {limit} that such a file may have",
            subject=name,
            code=too_large,
        )
    return os.fdopen(descriptor, "rb")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its place when the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays: a writer may choose by it what it writes.
    temporary = path.with_name(f".{secrets.token_hex(8)}{TEMPORARY}{path.name[-40:]}")
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
        if os.name == "posix":  # Windows cannot open a folder, and renames there are journalled
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    finally:
        temporary.unlink(missing_ok=True)


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays of numbers and texts to a file in the form of ``.npz``, whatever its name."""
    import numpy as np

    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def read_arrays(path: Path, limit: int) -> dict[str, np.ndarray]:
    """What `write_arrays` wrote, of at most ``limit`` bytes once unpacked. Nothing is unpickled.

    Raises
    ------
    InputError
        ``E_NOT_FOUND``, ``E_READ``, or ``E_INPUT`` where it is no such file.
    """
    import zipfile

    import numpy as np

    with open_regular(path, limit, InputError, ("E_NOT_FOUND", "E_READ", "E_INPUT")) as file:
        try:
            with zipfile.ZipFile(file) as members:
                size = sum(member.file_size for member in members.infolist())
            if size > limit:
                raise ValueError(f"{size} bytes, at most {limit}")
            file.seek(0)
            with np.load(file, allow_pickle=False) as found:
                return {name: found[name] for name in found.files}
        # A damaged header may ask for anything: a method that nobody knows, a key, all memory.
        except (
            *(ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile, zlib.error),
            *(NotImplementedError, RuntimeError, MemoryError),
        ) as error:
            cause = f"is no file of arrays: {error}"
            raise InputError(cause, subject=printable(path), code="E_INPUT") from error


def content_sha256(path: Path, on_piece: Callable[[], None] = lambda: None) -> str:
    """SHA-256 of a file, or of the names and hashes of the regular files directly in a folder.

    ``on_piece`` is called as pieces are read, as a sign of progress. Raises OSError.
    """
    if path.is_dir():
        digest = hashlib.sha256()
        for entry in _regular_files(path):
            digest.update(os.fsencode(entry.name) + b"\0" + content_sha256(entry, on_piece).encode() + b"\n")
        return digest.hexdigest()
    if fault := unreadable(path):
        raise OSError(errno.EINVAL, fault[0], os.fspath(path))
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
            on_piece()
    return digest.hexdigest()


def stamp(path: Path) -> str:
    """What changes when a file, or a regular file directly in a folder, is written, added or renamed.

    Raises OSError where the path cannot be looked at.
    """
    found = path.stat()
    if modes.S_ISDIR(found.st_mode):
        digest = hashlib.sha256()
        for entry in _regular_files(path):
            digest.update(os.fsencode(entry.name) + b"\0" + stamp(entry).encode())
        return digest.hexdigest()
    return _stamp(found)


def _stamp(status: os.stat_result) -> str:
    return f"[{status.st_size}, {status.st_mtime_ns}, {status.st_ctime_ns}]"


def _regular_files(folder: Path) -> Iterator[Path]:
    for entry in sorted(folder.iterdir(), key=lambda entry: os.fsencode(entry.name)):
        if unreadable(entry) is None:  # a link that leads nowhere holds nothing
            yield entry


@cache
def code_sha256(module: str) -> str:
    """A hash of the Python files in the folder of ``module``; empty for what pip has put into its place.

    An installation that can be edited keeps its version while its code changes.
    """
    import importlib.util

    try:
        found = importlib.util.find_spec(module)
    except (Exception, SystemExit):  # noqa: BLE001 - it imports the packages above, which may raise anything
        return ""
    if found is None or not found.origin or {"site-packages", "dist-packages"} & {*Path(found.origin).parts}:
        return ""
    place, digest = Path(found.origin), hashlib.sha256()
    alone = "." not in module and place.name != "__init__.py"
    for file in [place] if alone else sorted(place.parent.rglob("*.py")):
        with suppress(OSError):  # it goes while we look
            digest.update(file.relative_to(place.parent).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def tree_sha256(tree: Any) -> str:
    """SHA-256 of a tree of plain values, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(tree, sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def check_local(path: Path, what: str) -> None:
    """Raise ``E_OUT`` where a path to be written to is an address: a folder ``s3:`` is what nobody means."""
    if re.match(r"[A-Za-z][\w+.-]+:/", path.as_posix()):
        raise ConfigError(
            f"{what} is an address", remedy="a place on this machine, and gesture export --to ADDRESS",
            code="E_OUT",
        )  # fmt: skip


def usable_cores() -> int:
    """Cores that this process may use, where the system says; else all of the machine's."""
    if hasattr(os, "sched_getaffinity"):  # Linux; neither macOS nor Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
