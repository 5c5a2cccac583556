"""Archives that are no folders: what fsspec lists and reads (``s3://``, ``https://``, ``zip::``, …).

An object is fetched when its turn comes, and deleted when its keypoints are in the store. Credentials are
found by the library itself; an address that holds some is refused, and a query, which may be a signature, is
never shown or kept.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from gesture_core.errors import GestureError, InputError, MissingDependencyError, described
from gesture_core.files import cache_dir, content_sha256, passed_over, printable, replacing

_EXTRAS = {
    "s3": "s3", "s3a": "s3", "gs": "gcs", "gcs": "gcs", "az": "azure", "abfs": "azure", "abfss": "azure",
    "http": "http", "https": "http", "hf": "hf",
}  # fmt: skip
"""What to install for a protocol; for others fsspec alone may do."""
_NO_QUERY = frozenset("file local memory zip tar s3 s3a gs gcs hf".split())
"""Where a ``?`` is a letter of a name as any other."""
_NO_SERVER = frozenset("file local memory zip tar abfs abfss az".split())
"""Where what stands in front of the first slash, with an ``@`` perhaps, is no name with its password."""
_VERSIONS = ("LastModified", "Last-Modified", "last_modified", "updated", "mtime", "created", "CRC")
"""What may change with the content of an object, by the names that file systems give it."""
_MD5, _SHA256 = re.compile(r"[0-9a-f]{32}"), re.compile(r"[0-9a-f]{64}")
_ATTEMPTS = 3
_LONGEST = 200
_OWN = os.urandom(4).hex()
_FOLDERS: set[str] = set()
"""Of what this process has fetched, which end with it."""
_LINK = re.compile(r"::(?=[A-Za-z][\w+.-]*://)")
"""What chains two addresses; any other ``::`` is part of a name."""
_USER = re.compile("://[^/]*@")
_QUERY = re.compile(r"(://[^\s'\"?]*)\?[^\s'\"]+")


@dataclass(frozen=True)
class Entry:
    """One object, as its file system describes it.

    Attributes
    ----------
    address : str
    size : int or None
    stamp : str
        Changes when the object is replaced.
    md5 : str
        Of its content, where its ETag is one by its form; see `sha256_of`.
    """

    address: str
    size: int | None
    stamp: str
    md5: str


def is_address(source: object) -> bool:
    """Whether a source is no path, which ``file://`` is: ``s3://bucket``, ``zip://*.mp4::s3://bucket/a.zip``."""
    text = str(source)
    return "://" in text and not (text.startswith("file://") and len(_LINK.split(text)) == 1)


def shown(address: str) -> str:
    """An address as it may be printed and kept: without a password, or a query, which may be a signature."""
    if not is_address(address):
        return printable(address)
    return printable("::".join(_parted(part)[0] for part in _LINK.split(address)))


def _parted(part: str) -> tuple[str, str]:
    """A part of an address without its query, name and password, and that query."""
    kind = part.partition("://")[0]
    plain, _, query = (part, "", "") if kind in _NO_QUERY else part.partition("?")
    return plain if kind in _NO_SERVER else _USER.sub("://", plain), query


def local_path(source: str) -> str:
    """A source as a path: what a ``file://`` stands for; of an address the folder of what is fetched.

    That is of this process alone: another run of the same archive deletes nothing that this one reads.
    """
    if not is_address(source):
        from urllib.request import url2pathname

        found = re.match("file://(localhost(?=/))?", source)
        return url2pathname(source[found.end() :]) if found else source
    parts, name = _LINK.split(_root(shown(source))), "all"
    for place, part in enumerate(parts):
        kind, _, path = part.partition("://")
        above, _, last = path.rstrip("/").rpartition("/")
        if last:
            parts[place], name = f"{kind}://{above}", last
            break
    digest = hashlib.sha256("::".join(parts).encode()).hexdigest()[:16]
    # Names are those that folders have there, and side by side as there: they may be labels.
    folder = cache_dir() / "fetched" / f"{digest}-{_OWN}" / _safe([name])
    _FOLDERS.add(str(folder))
    return str(folder)


@atexit.register
def _leave_nothing() -> None:
    for folder in _FOLDERS:
        shutil.rmtree(Path(folder).parent, ignore_errors=True)


def _root(address: str) -> str:
    """What is in front of a pattern, else the address itself."""
    path, *rest = _LINK.split(address)
    while "*" in path:
        path = path.rpartition("/")[0]
    return "::".join([path, *rest])


def entries(source: str) -> Iterator[tuple[Path, Entry]]:
    """Every object of a source, and where it lies once it is fetched; by folders, sorted by name.

    Raises
    ------
    InputError
        Where there is nothing, or the listing fails: half a listing is none.
    MissingDependencyError
        Where the package of the protocol is absent.
    """
    system, path = _open(source)
    folder = Path(local_path(source))
    with _blamed(source):
        if "*" in path:
            base, found = path.partition("*")[0].rpartition("/")[0], system.glob(path, detail=True)
            yield from _files(system, source, base, folder, found)
            return
        about = system.info(path)
        if about["type"] == "file" and not path.endswith("/"):
            yield folder / _safe([path.rpartition("/")[2]]), _entry(system, source, about)
            return
        folders = [path]
        while folders:  # fsspec's own walk passes over what fails below the first folder
            here = folders.pop()
            listed = [
                one for one in system.ls(here, detail=True) if one["name"].strip("/") != here.strip("/")
            ]
            named = [(str(one["name"]).rstrip("/"), one) for one in listed]
            seen = [(name, one) for name, one in named if not passed_over(name.rpartition("/")[2])]
            folders += sorted((name for name, one in seen if one["type"] == "directory"), reverse=True)
            files = {name: one for name, one in seen if one["type"] == "file"}  # an object may be both
            yield from _files(system, source, path, folder, files)


def put(path: Path, address: str) -> None:
    """Write a file, or a folder with all that is in it, to an address.

    Raises
    ------
    InputError
        ``E_OUT`` where it cannot be written.
    MissingDependencyError
        Where the package of the protocol is absent.
    """
    system, place = _open(address)
    with _blamed(address, writing=True):
        files = [file for file in sorted(path.rglob("*")) if file.is_file()] if path.is_dir() else [path]
        for file in files:
            inside = file.relative_to(path).as_posix()
            system.put_file(str(file), place if file == path else f"{place.rstrip('/')}/{inside}")


def roots(sources: Sequence[str]) -> tuple[bytes, ...]:
    """What the places of objects begin with that are listed by ``sources``, as far as these are addresses."""
    listed = filter(is_address, sources)
    return tuple(os.fsencode(shown(_named(*_open(_root(source)), source))) for source in listed)


def look(address: str) -> Entry:
    """An object as it is now."""
    system, path = _open(address)
    with _blamed(address):
        return _entry(system, address, system.info(path))


def fetch(entry: Entry, path: Path, alive: Callable[[], None] = lambda: None) -> None:
    """Bring an object to ``path``, if it is not there yet; what is cut off is read again.

    Raises
    ------
    InputError
        ``E_CHANGED`` where it was replaced meanwhile, ``E_READ`` where it cannot be read.
    """
    mark = path.with_name(f".{path.name}.stamp")
    with suppress(OSError):
        if path.is_file() and mark.read_text("utf-8") == entry.stamp:
            return
    system, place = _open(entry.address)
    with _blamed(entry.address):
        mark.unlink(missing_ok=True)
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            _read(system, place, entry, path, alive)
        except InputError as error:
            if attempt == _ATTEMPTS or error.code != "E_READ":
                raise
            time.sleep(attempt / 2)
        else:
            break
    mark.write_text(entry.stamp, "utf-8")


def _read(system: Any, place: str, entry: Entry, path: Path, alive: Callable[[], None]) -> None:
    """Bring the whole of an object, as it was listed, to ``path``."""
    with _blamed(entry.address), replacing(path) as temporary:
        system.get_file(place, str(temporary), callback=_callback(alive))
        size = temporary.stat().st_size
        known = bool(entry.md5) and _md5(temporary) == entry.md5
        if not known and look(entry.address).stamp != entry.stamp:
            raise InputError(
                "was replaced while it was read", subject=shown(entry.address),
                remedy="--retry-errors", code="E_CHANGED",
            )  # fmt: skip
        if entry.size not in (None, size):
            raise InputError(
                f"{size} of {entry.size} bytes could be read", subject=shown(entry.address),
                remedy="--retry-errors", code="E_READ",
            )  # fmt: skip
    if known:  # the ETag is the hash of the content: next time it is known by that
        with replacing(_known(entry)) as temporary:
            temporary.write_text(content_sha256(path), "utf-8")


def place_for(address: str, path: Path) -> Path:
    """Where a worker fetches an object to: ``path``, if it is there already, else a folder of its own."""
    known = f"{path}\0{shown(address)}"
    digest = hashlib.sha256(known.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return path if path.is_file() else cache_dir() / "fetched" / digest / path.name


def sha256_of(entry: Entry) -> str:
    """The SHA-256 of an object whose ETag was seen to be the hash of such content; else empty."""
    with suppress(OSError, ValueError):  # a shared cache may hold anything
        if entry.md5 and _SHA256.fullmatch(known := _known(entry).read_text("utf-8")):
            return known
    return ""


def drop(path: Path) -> None:
    """Delete what was fetched, and the folders that are empty then."""
    for file in (path, path.with_name(f".{path.name}.stamp")):
        with suppress(OSError):
            file.unlink()
    with suppress(OSError):  # others are in it
        for folder in path.parents:
            if str(folder) in _FOLDERS or folder == cache_dir() / "fetched":
                break
            folder.rmdir()


def _known(entry: Entry) -> Path:
    return cache_dir() / "etags" / entry.md5[:2] / f"{entry.md5}-{entry.size}"


def _md5(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, partial(hashlib.md5, usedforsecurity=False)).hexdigest()


def _open(address: str) -> tuple[Any, str]:
    """The file system of an address, and the path in it."""
    parts = _LINK.split(address)
    for part in parts:
        kind, _, rest = part.partition("://")
        server = rest.partition("/")[0]
        if "@" in server and kind not in _NO_SERVER:
            raise InputError(
                "holds a name or password", subject=shown(address),
                remedy="an address without it, and the configuration of the library (for S3: AWS_PROFILE)",
                code="E_SOURCE",
            )  # fmt: skip
    protocol = parts[-1].partition("://")[0]
    try:
        from fsspec.core import url_to_fs

        options = {part.partition("://")[0]: {"use_listings_cache": False} for part in parts}
        plain = "::".join([parts[0].partition("::")[0], *parts[1:]])  # fsspec would take it for a chain
        system, path = url_to_fs(plain, **(options if len(parts) > 1 else next(iter(options.values()))))
        path = system._strip_protocol(parts[0]) if "::" in parts[0] else path
    except (ImportError, ValueError) as error:
        if isinstance(error, ValueError) and "rotocol not known" not in str(error):
            raise _failed(address, error) from None
        unknown = isinstance(error, ValueError)
        raise MissingDependencyError(
            f"nothing reads {protocol}://" if unknown else f"{protocol}:// needs a package that is absent",
            subject=shown(address),
            remedy="another address, or downloading it first"
            if unknown
            else f'pip install "gesture-core[{_EXTRAS.get(protocol, "fsspec")}]"',
        ) from None
    except Exception as error:  # noqa: BLE001 - a file system of a third party may raise anything
        raise _failed(address, error) from None
    return system, str(path)


def _plain(value: object) -> str:
    """A version as text: a listing and a look at one object give times in other forms."""
    return str(value.timestamp() if isinstance(value, datetime) else value)


@contextmanager
def _blamed(address: str, writing: bool = False) -> Iterator[None]:
    """What a file system raises, as an error about the address."""
    try:
        yield
    except GestureError:
        raise
    except Exception as error:  # noqa: BLE001 - a file system of a third party may raise anything
        raise _failed(address, error, writing) from None


def _failed(address: str, error: Exception, writing: bool = False) -> InputError:
    """The error, without what must not be shown of an address."""
    cause = described(error) if not isinstance(error, FileNotFoundError) else "no such object"
    for part in _LINK.split(address):
        _, query = _parted(part)
        cause = cause.replace(query, "…") if query else cause
    cause = _QUERY.sub(r"\1?…", cause)  # a server may have led to an address that is signed
    if writing:
        return InputError(
            f"cannot be written: {printable(cause)[:300]}", subject=shown(address),
            remedy="another address, or its permissions", code="E_OUT",
        )  # fmt: skip
    missing = isinstance(error, FileNotFoundError)
    return InputError(
        f"cannot be read: {printable(cause)[:300]}" if not missing else cause,
        subject=shown(address),
        remedy="check the address" if missing else "the same command again, or its permissions",
        code="E_NOT_FOUND" if missing else "E_READ",
    )


def _files(
    system: Any, source: str, base: str, folder: Path, found: Mapping[str, Mapping[str, Any]]
) -> Iterator[tuple[Path, Entry]]:
    """The objects among ``found``, sorted by name."""
    for name, about in sorted(found.items()):
        if about["type"] == "file":
            inside = name.lstrip("/").removeprefix(base.strip("/")).strip("/").split("/")
            yield folder / _safe(inside), _entry(system, source, about)


def _safe(parts: list[str]) -> Path:
    """A relative path that stays below its folder, whatever an object is called."""
    safe = []
    for part in parts:
        encoded = part.encode("utf-8", "surrogatepass")
        if len(encoded) > _LONGEST or b"\0" in encoded or part in ("", ".", ".."):
            # Two objects never have one place: each would be read as the other.
            part = hashlib.sha256(encoded).hexdigest()[:16] + Path(part.replace("\0", "")).suffix[-20:]
        safe.append(part)
    return Path(*safe)


def _named(system: Any, path: str, source: str) -> str:
    """The address of what a file system calls ``path``, its protocol as in ``source``: az, not abfs."""
    first, *outer = _LINK.split(source)
    inside = str(system.unstrip_protocol(path)).partition("://")[2]
    return "::".join([f"{first.partition('://')[0]}://{inside}", *outer])


def _entry(system: Any, source: str, about: Mapping[str, Any]) -> Entry:
    if not any(about.get(key) for key in ("ETag", "etag", *_VERSIONS)):
        about = {**about, **system.info(about["name"])}  # a page of links does not say
    query = _parted(source)[1] if len(_LINK.split(source)) == 1 else ""
    address = _named(system, about["name"], source)
    etag, size = str(about.get("ETag") or about.get("etag") or "").strip('"'), about.get("size")
    versions = [etag] if etag else [_plain(about.get(key)) for key in _VERSIONS]
    md5 = etag if _MD5.fullmatch(etag) and source.startswith("s3") else ""
    address += f"?{query}" if query and "?" not in address else ""
    return Entry(address, None if size is None else int(size), json.dumps([size, *versions]), md5)


def _callback(alive: Callable[[], None]) -> Any:
    """What a file system tells of its progress."""
    from fsspec.callbacks import Callback

    class Alive(Callback):  # type: ignore[misc]  # fsspec brings no types
        def call(self, *_: Any, **__: Any) -> None:
            alive()

    return Alive()
