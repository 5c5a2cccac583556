"""Finds a pose network by name or file, and knows what it expects.

Names are looked up among the networks that the user added (`gesture_core.pose.added`), then among
those that come with an installed package. A file is known by its SHA-256, whatever it is called.
"""

from __future__ import annotations

import difflib
import hashlib
import os
from pathlib import Path

from gesture_core.errors import ModelError
from gesture_core.pose.added import added_model, added_names
from gesture_core.pose.contracts import ModelContract
from gesture_core.pose.known import known_by_hash, known_models
from gesture_core.pose.layouts import infer_contract
from gesture_core.pose.model_file import SUFFIXES, ModelFile, read_bounded
from gesture_core.pose.onnx_header import read_header


def find_model(name_or_path: str | os.PathLike[str]) -> ModelFile:
    """The model file that a user means.

    Parameters
    ----------
    name_or_path : str or path
        A name of `gesture models`, or a file. What ends in a model's suffix or holds a path
        separator is a file.

    Raises
    ------
    ModelError
        ``E_MODEL_UNKNOWN`` where there is no such name, ``E_NOT_FOUND`` where there is no such file;
        ``E_MODEL_MISSING`` where the network is known but not installed, with what to do; others
        from reading the file.
    """
    text = os.fspath(name_or_path)
    if isinstance(name_or_path, Path) or text.lower().endswith(SUFFIXES) or "/" in text or os.sep in text:
        return file_model(Path(text).expanduser())
    added = added_model(text)
    if added is not None:
        return added
    known = known_models().get(text)
    if known is None:
        names = sorted({*known_models(), *added_names()})
        near = difflib.get_close_matches(text, names, 1)
        raise ModelError(
            f"no pose network {text!r}",
            remedy=(f"did you mean {near[0]!r}? " if near else "")
            + f"one of {', '.join(names)}, or a file that ends in {', '.join(SUFFIXES)}",
            code="E_MODEL_UNKNOWN",
        )
    path = known.packaged_path
    if path is not None:
        return ModelFile(path, _hash(path), text, known.contract)
    if known.packaged:
        raise ModelError(
            f"the network {text!r} of the package is not in this installation",
            remedy="another one: 'gesture models' lists them, 'gesture models add FILE' adds one, "
            "then --model NAME; or --model FILE",
            code="E_MODEL_MISSING",
        )
    raise ModelError(
        f"the network {text!r} ({known.licence}) is known but not installed",
        remedy=f"get it ({known.where}), then 'gesture models add {(known.files or ('FILE',))[0]}'",
        code="E_MODEL_MISSING",
    )


def file_model(path: Path, contract: ModelContract | None = None, name: str = "") -> ModelFile:
    """The model in a file: its contract from its hash, else from its header, unless one is given."""
    if path.suffix.lower() not in SUFFIXES:
        raise ModelError(
            f"{path.suffix or 'no suffix'} is not a model file's",
            subject=str(path),
            remedy=f"a file that ends in {', '.join(SUFFIXES)}",
            code="E_OPTION",
        )
    data = read_bounded(path)
    sha256 = hashlib.sha256(data).hexdigest()
    known = known_by_hash(sha256)
    name = name or (known.name if known else path.stem)
    if path.suffix.lower() == ".onnx":
        header = read_header(data, str(path))
        if contract is None and known is None and all(t.shape for t in header.outputs):
            contract = _declared(header.inputs, header.outputs, str(path))
    return ModelFile(path, sha256, name, contract or (known.contract if known else None))


def _declared(inputs: tuple, outputs: tuple, subject: str) -> ModelContract | None:
    """The contract if the declared shapes say enough; None leaves it to the first run."""
    shapes = [tensor.shape for tensor in outputs]
    if any(shape[axis] is None for shape in shapes for axis in range(1, min(2, len(shape)))):
        return None
    return infer_contract(inputs, shapes, subject)


def _hash(path: Path) -> str:
    return hashlib.sha256(read_bounded(path)).hexdigest()
