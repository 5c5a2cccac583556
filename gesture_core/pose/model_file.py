"""A model file on disk: read once, bounded, hashed, and checked before any runtime sees it."""

from __future__ import annotations

import hashlib
import stat
from dataclasses import dataclass
from pathlib import Path

from gesture_core.errors import ModelError
from gesture_core.pose.contracts import ModelContract

MAX_BYTES = 1 << 30
"""No pose network that runs on a CPU at video speed is larger."""
SUFFIXES = (".onnx", ".pb", ".caffemodel")


@dataclass(frozen=True)
class ModelFile:
    """A pose network that was found.

    Attributes
    ----------
    path : Path
    sha256 : str
        Of the file, 64 hexadecimal digits; with a Caffe network, of the weights.
    name : str
        Under which it is registered, or the file's own name.
    contract : ModelContract or None
        None where only running the network can tell (a TensorFlow or Caffe file of unknown origin).
    """

    path: Path
    sha256: str
    name: str
    contract: ModelContract | None = None

    def read(self) -> bytes:
        """The bytes of the file, which are those that the hash was taken of.

        Raises
        ------
        ModelError
            ``E_MODEL_CHANGED`` where the file is not the one that was found.
        """
        data = read_bounded(self.path)
        if hashlib.sha256(data).hexdigest() != self.sha256:
            raise ModelError(
                "the file changed after it was found",
                subject=str(self.path),
                remedy="'gesture models verify', or add it again",
                code="E_MODEL_CHANGED",
            )
        return data

    @property
    def prototxt(self) -> Path:
        """The description that stands beside Caffe weights."""
        return self.path.with_suffix(".prototxt")


def read_bounded(path: Path, limit: int | None = None) -> bytes:
    """The bytes of a regular file of at most ``limit`` bytes, by default `MAX_BYTES`."""
    limit = MAX_BYTES if limit is None else limit
    try:
        # Asked before it is opened: opening a pipe waits until somebody writes.
        if not stat.S_ISREG(path.stat().st_mode):
            raise ModelError("not a regular file", subject=str(path), code="E_MODEL_FILE")
        with path.open("rb") as stream:
            data = stream.read(limit + 1)
    except FileNotFoundError as error:
        raise ModelError(
            "no such file",
            subject=str(path),
            remedy="check the path, or take a name: 'gesture models' lists them",
            code="E_NOT_FOUND",
        ) from error
    except (OSError, ValueError) as error:
        cause = error.strerror if isinstance(error, OSError) else str(error)
        raise ModelError(f"cannot be read: {cause}", subject=str(path), code="E_MODEL_FILE") from error
    if len(data) > limit:
        raise ModelError(f"larger than {limit >> 20} MiB", subject=str(path), code="E_MODEL_SIZE")
    return data
