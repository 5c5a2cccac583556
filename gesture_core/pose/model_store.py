"""The pose networks of the user: a file is taken in under a name, and checked to be still what it was.

Each has a folder under `gesture_core.files.models_dir`, ``<name>/model.json`` (its card), which names the
file beside it, its SHA-256 and its contract. `gesture_core.pose.downloads` brings known ones.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from gesture_core.errors import ModelError
from gesture_core.files import models_dir, replacing
from gesture_core.pose.contract import ModelContract, infer_contract
from gesture_core.pose.models import CARD, NAME, SUFFIXES, ModelFile, known_by_hash, known_models, read_model
from gesture_core.pose.onnx_header import read_header

_PROTOTXT_LIMIT = 1 << 20
_ADDING = ".adding-"
_LONG_AGO = 24 * 3600.0


def add_model(
    source: Path,
    name: str = "",
    *,
    contract: Mapping[str, Any] | None = None,
    licence: str = "",
    sha256: str = "",
    origin: str = "",
    replace: bool = False,
) -> ModelFile:
    """Copy a model file into the user's folder under a name.

    Parameters
    ----------
    source : path
        An ONNX, TensorFlow or Caffe file; a Caffe file has its ``.prototxt`` beside it.
    name : str
        By default that of the known network with this hash, else the file's own, made a name.
    contract : mapping
        Fields of `ModelContract` that override what the hash, the name or the file say.
    licence, origin : str
        To be shown by `gesture models`.
    sha256 : str
        The hash that the file must have.
    replace : bool
        Whether a model of this name may be replaced.

    Raises
    ------
    ModelError
        ``E_MODEL_HASH`` for another hash, ``E_MODEL_EXISTS`` where the name is taken, and others
        from reading the file. The model that was there is then as it was.
    """
    found = file_model(source)
    check_hash(found.sha256, sha256, str(source))
    known = known_by_hash(found.sha256) or known_models().get(name)
    own = re.sub(r"[^a-z0-9]+", "-", source.stem.lower())[:64].strip("-") or "model"
    name = check_name(name or (known.name if known else own))
    if name in known_models() and known_models()[name].packaged:
        raise ModelError(
            f"{name!r} is the package's own network", remedy="another --name", code="E_MODEL_EXISTS"
        )
    base = known.contract if known else found.contract
    table = {**(base.as_table() if base else {}), "licence": "", **(contract or {})}
    card = {
        "file": f"model-{found.sha256[:12]}{source.suffix.lower()}",
        "sha256": found.sha256,
        "licence": licence or (known.licence if known else ""),
        "origin": origin or str(source),
        "contract": ModelContract.from_table(table, found.name).as_table() if base or contract else None,
    }
    folder = models_dir()
    target = folder / name
    if target.exists() and not replace:
        raise ModelError(
            f"there is a model {name!r}",
            subject=str(target),
            kept="that one",
            remedy="--replace, or another --name",
            code="E_MODEL_EXISTS",
        )
    folder.mkdir(parents=True, exist_ok=True)
    for left in folder.glob(f"{_ADDING}*"):  # by an addition that was killed
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > _LONG_AGO:
                shutil.rmtree(left)
    if target.exists():
        _fill(target, found, card)
        return read_card(name)
    new = Path(tempfile.mkdtemp(prefix=_ADDING, dir=folder))
    try:
        _fill(new, found, card)
        new.replace(target)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return read_card(name)


def _fill(folder: Path, found: ModelFile, card: Mapping[str, Any]) -> None:
    """Write the model's files, then its card, then remove what the card does not name.

    In a folder that is in use the card decides which file is the model, and it changes last, by one
    rename: whatever ends this half-way, the name stands for the old model or for the new one.
    """
    model = folder / card["file"]
    contents = {model: found.read()}
    if found.path.suffix.lower() == ".caffemodel":
        contents[model.with_suffix(".prototxt")] = read_model(found.prototxt, _PROTOTXT_LIMIT)
    contents[folder / CARD] = (json.dumps(card, indent=2) + "\n").encode()
    for path, data in contents.items():
        with replacing(path) as temporary:
            temporary.write_bytes(data)
    for path in set(folder.iterdir()) - set(contents):
        with suppress(OSError):  # an old model that somebody has open, on Windows: the next time
            path.unlink()


def verify_models() -> list[tuple[str, Path, str]]:
    """Name, file and what is wrong (empty: nothing) of every model of the package and the user."""
    found = []
    for name in added_names():
        path, trouble = models_dir() / name, ""
        try:
            card = read_card(name)
            path = card.path
            check_hash(hashlib.sha256(read_model(path)).hexdigest(), card.sha256, str(path))
        except ModelError as error:
            trouble = f"{error.code} {error.cause}"
        found.append((name, path, trouble))
    for known in known_models().values():
        packaged = known.packaged_path
        if packaged is not None:
            actual = hashlib.sha256(read_model(packaged)).hexdigest()
            wrong = bool(known.sha256) and actual not in known.sha256
            found.append((known.name, packaged, f"E_MODEL_HASH its SHA-256 is {actual}" if wrong else ""))
    return found


def added_names() -> tuple[str, ...]:
    """Names of the networks that the user added."""
    found = (card.parent.name for card in models_dir().glob(f"*/{CARD}"))
    return tuple(sorted(name for name in found if NAME.fullmatch(name)))


def check_name(name: str) -> str:
    """``name`` where it is one; a ModelError ``E_MODEL_NAME`` otherwise."""
    if not NAME.fullmatch(name):
        raise ModelError(
            f"{name!r} is not a name",
            remedy="at most 64 lower-case letters and digits, with single '-', '_' or '.' between",
            code="E_MODEL_NAME",
        )
    return name


def read_card(name: str) -> ModelFile:
    """The network that the user added as ``name``; a ModelError ``E_MODEL_CARD`` for a damaged card."""
    folder = models_dir() / check_name(name)
    try:
        table = json.loads(read_model(folder / CARD, 1 << 16))
        file, sha256, contract = table["file"], str(table["sha256"]), table.get("contract")
        if not isinstance(file, str) or Path(file).name != file or file in (".", ".."):
            raise ValueError(f"file name {file!r}")
        if (folder / file).is_symlink():
            raise ValueError(f"{file} is a link")
        known = known_by_hash(sha256)  # of whose contract an earlier version may have known nothing
        found = ModelContract.from_table(contract, name) if contract else known.contract if known else None
        notes = str(table.get("licence", "")), str(table.get("origin", ""))
        return ModelFile(folder / file, sha256, name, found, *notes)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(
            f"its card is damaged: {error}",
            subject=str(folder / CARD),
            remedy="remove the folder and add the model again",
            code="E_MODEL_CARD",
        ) from error


def file_model(path: Path) -> ModelFile:
    """The model in a file: its contract from its hash, else from its header."""
    if path.suffix.lower() not in SUFFIXES:
        meant = known_models().get(str(path))
        if meant and not path.exists():
            raise ModelError(
                "is the name of a network, not a file",
                subject=str(path),
                remedy=meant.remedy,
                code="E_OPTION",
            )
        raise ModelError(
            f"{path.suffix or 'no suffix'} is not a model file's",
            subject=str(path),
            remedy=f"a file that ends in {', '.join(SUFFIXES)}",
            code="E_OPTION",
        )
    data = read_model(path)
    sha256 = hashlib.sha256(data).hexdigest()
    known = known_by_hash(sha256)
    contract = known.contract if known else None
    if path.suffix.lower() == ".onnx":
        header = read_header(data, str(path))
        shapes = [tensor.shape for tensor in header.outputs]
        # Shapes that leave the number of joints or maps open leave the contract to the first run.
        if not known and all(shape and None not in shape[1:2] for shape in shapes):
            contract = infer_contract(header.inputs, shapes, str(path))
    return ModelFile(path, sha256, known.name if known else path.stem, contract)


def check_hash(actual: str, wanted: str, subject: str) -> None:
    """Raise ``E_MODEL_HASH`` where a hash was asked for and it is another."""
    if wanted and not re.fullmatch(r"[0-9a-f]{64}", wanted.lower()):
        raise ModelError(f"{wanted!r} is no SHA-256", remedy="64 hexadecimal digits", code="E_MODEL_HASH")
    if wanted and actual != wanted.lower():
        raise ModelError(
            f"its SHA-256 is {actual}, expected {wanted.lower()}",
            subject=subject,
            kept="nothing of it",
            remedy="get the file again from its source",
            code="E_MODEL_HASH",
        )
