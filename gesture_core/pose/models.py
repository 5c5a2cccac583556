"""Pose networks by name or file: those that the user added, those that an installed package brings, and
those that are only known (``known_models.toml``).

A file is known by its SHA-256, whatever it is called. A network that the user added has a folder under
`gesture_core.files.models_dir`, ``<name>/model.json`` (its card), which names the file beside it, its
SHA-256 and its contract; `gesture_core.pose.model_store` makes these folders.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from gesture_core.errors import ModelError
from gesture_core.files import models_dir, open_regular
from gesture_core.pose.contract import ModelContract, infer_contract
from gesture_core.pose.onnx_header import read_header

MAX_BYTES = 1 << 30
"""No pose network that runs on a CPU at video speed is larger."""
SUFFIXES = (".onnx", ".pb", ".caffemodel")
CARD = "model.json"
NAME = re.compile(r"(?=.{1,64}$)[a-z0-9]+([-._][a-z0-9]+)*")
"""A name becomes a folder, so that nothing that could leave `models_dir` is one."""


@dataclass(frozen=True)
class ModelFile:
    """A pose network that was found.

    Attributes
    ----------
    path : Path
    sha256 : str
        Of the file, 64 hexadecimal digits; with a Caffe network, of the weights.
    name : str
        Under which it is known, or the file's own name.
    contract : ModelContract or None
        None where only running the network can tell (a TensorFlow or Caffe file of unknown origin).
    licence, origin : str
        Of a network that the user added.
    """

    path: Path
    sha256: str
    name: str
    contract: ModelContract | None = None
    licence: str = ""
    origin: str = ""

    def read(self) -> bytes:
        """The bytes of the file, which are those that the hash was taken of.

        Raises
        ------
        ModelError
            ``E_MODEL_CHANGED`` where the file is not the one that was found.
        """
        data = read_model(self.path)
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


@dataclass(frozen=True)
class KnownModel:
    """A public network.

    Attributes
    ----------
    name, summary : str
    contract : ModelContract
    licence, where : str
        Of the weights, and where a user gets them.
    files : tuple of str
        Names under which people have the file.
    sha256 : tuple of str
        Of the files that are known to be this network, empty where exports differ.
    url : str
        Of one file with the first hash, empty where there is none.
    packaged : str
        ``package:path`` of a file that an installed package brings.
    """

    name: str
    contract: ModelContract
    summary: str = ""
    licence: str = ""
    where: str = ""
    files: tuple[str, ...] = ()
    sha256: tuple[str, ...] = ()
    url: str = ""
    packaged: str = ""

    @property
    def packaged_path(self) -> Path | None:
        """The file that comes with an installed package, None where there is no such file.

        The package is looked up by name and not imported.
        """
        package, _, inside = self.packaged.partition(":")
        spec = find_spec(package) if package else None
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            path = Path(folder) / inside
            if path.is_file():
                return path
        return None


@cache
def known_models() -> dict[str, KnownModel]:
    """Name -> network, in the order of ``known_models.toml``."""
    found = {}
    text = (files("gesture_core.pose") / "known_models.toml").read_text("utf-8")
    for name, table in tomllib.loads(text).items():
        licence = table.get("licence", "")
        contract = ModelContract.from_table({**table.pop("contract"), "licence": licence}, name)
        table |= {key: tuple(table.get(key, ())) for key in ("files", "sha256")}
        found[name] = KnownModel(name, contract, **table)
    return found


def known_by_hash(sha256: str) -> KnownModel | None:
    """The known network with this file hash."""
    return next((known for known in known_models().values() if sha256 in known.sha256), None)


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
    if NAME.fullmatch(text) and (models_dir() / text / CARD).is_file():
        return read_card(text)
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
        return ModelFile(path, hashlib.sha256(read_model(path)).hexdigest(), text, known.contract)
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


def file_model(path: Path) -> ModelFile:
    """The model in a file: its contract from its hash, else from its header."""
    if path.suffix.lower() not in SUFFIXES:
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
        found = ModelContract.from_table(contract, name) if contract else None
        notes = str(table.get("licence", "")), str(table.get("origin", ""))
        return ModelFile(folder / file, sha256, name, found, *notes)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(
            f"its card is damaged: {error}",
            subject=str(folder / CARD),
            remedy="remove the folder and add the model again",
            code="E_MODEL_CARD",
        ) from error


def read_model(path: Path, limit: int | None = None) -> bytes:
    """The bytes of a regular file of at most ``limit`` bytes, by default `MAX_BYTES`.

    Raises
    ------
    ModelError
        ``E_NOT_FOUND``, ``E_MODEL_FILE`` for what cannot be read, ``E_MODEL_SIZE`` for a larger one.
    """
    limit = MAX_BYTES if limit is None else limit
    try:
        with open_regular(path, limit, ModelError) as file:
            return file.read(limit)
    except ModelError as error:
        codes = {"E_MISSING": "E_NOT_FOUND", "E_UNREADABLE": "E_MODEL_FILE", "E_LIMIT": "E_MODEL_SIZE"}
        error.code = codes[error.code]
        if error.code == "E_NOT_FOUND":
            error.remedy = "check the path, or take a name: 'gesture models' lists them"
        raise
    except OSError as error:
        raise ModelError(
            f"cannot be read: {error.strerror}", subject=str(path), code="E_MODEL_FILE"
        ) from error
