"""Downloads a model file, only when asked to, only with its hash, never offline."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from gesture_core.errors import MissingDependencyError, ModelError
from gesture_core.files import offline
from gesture_core.pose.adding import check_hash
from gesture_core.pose.model_file import MAX_BYTES, SUFFIXES


@contextmanager
def downloaded(url: str, sha256: str, *, limit: int = MAX_BYTES, progress: bool = False) -> Iterator[Path]:
    """The file at ``url`` in a folder of its own, which is removed at the end, whatever happens.

    Raises
    ------
    ModelError
        ``E_OFFLINE`` where downloads are switched off, ``E_MODEL_URL`` for an address that cannot be
        used or fetched, ``E_MODEL_HASH`` without a hash or with another one, ``E_MODEL_SIZE`` past
        ``limit`` bytes.
    MissingDependencyError
        Without pooch.
    """
    parts = urlsplit(url)
    name = Path(parts.path).name
    if parts.scheme not in ("http", "https") or not name.lower().endswith(SUFFIXES):
        raise ModelError(
            "not the address of a model file",
            subject=url,
            remedy=f"https://…, ending in {', '.join(SUFFIXES)}",
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
    if offline():
        raise ModelError(
            "downloads are switched off (GESTURE_OFFLINE)",
            subject=url,
            remedy="bring the file: 'gesture models add FILE'",
            code="E_OFFLINE",
        )
    if importlib.util.find_spec("pooch") is None:
        raise MissingDependencyError("downloads need pooch: pip install 'gesture-core[models]'")
    with tempfile.TemporaryDirectory(prefix="gesture-model-") as folder:
        yield _fetch(url, sha256.lower(), Path(folder), name, limit, progress)


def _fetch(url: str, sha256: str, folder: Path, name: str, limit: int, progress: bool) -> Path:
    import pooch  # type: ignore[import-untyped, unused-ignore]
    import requests

    def fetch(address: str, target: str, keeper: Any) -> None:
        with Path(target).open("wb") as file:
            pooch.HTTPDownloader(progressbar=progress, timeout=30)(
                address, _Bounded(file, limit, url), keeper
            )

    # Its log names a temporary file that means nothing to the user.
    pooch.get_logger().setLevel("WARNING")
    try:
        path = pooch.retrieve(url, f"sha256:{sha256}", fname=name, path=folder, downloader=fetch)
    except (requests.RequestException, OSError) as error:
        raise ModelError(
            f"cannot be fetched: {error}", subject=url, kept="nothing of it", code="E_MODEL_URL"
        ) from error
    except ValueError as error:  # pooch: the hash is another
        raise ModelError(
            f"the file there does not have the SHA-256 {sha256}",
            subject=url,
            kept="nothing of it",
            remedy="check the hash with the publisher",
            code="E_MODEL_HASH",
        ) from error
    return Path(path)


class _Bounded:
    """A file that refuses to grow past a limit: a server may send more than it says."""

    def __init__(self, file: Any, limit: int, url: str) -> None:
        self._file = file
        self._left = limit
        self._limit = limit
        self._url = url

    def write(self, data: bytes) -> int:
        self._left -= len(data)
        if self._left < 0:
            raise ModelError(
                f"larger than {self._limit >> 20} MiB",
                subject=self._url,
                kept="nothing of it",
                code="E_MODEL_SIZE",
            )
        written: int = self._file.write(data)
        return written

    def flush(self) -> None:
        self._file.flush()
