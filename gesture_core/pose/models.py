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
SUFFIXES = (".onnx", ".tflite", ".pb", ".caffemodel")
CARD = "model.json"
FINDER = "compact"
"""Finds the first region of a person for networks that see only that."""
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
    contract : ModelContract or None
        None of a network that finds no people, which no setting of this version uses.
    licence, where : str
        Of the weights, and where a user gets them.
    files : tuple of str
        Names under which people have the file.
    sha256 : tuple of str
        Of the files that are known to be this network, empty where exports differ.
    wheel : str
        Requirement of a wheel on a package index in which the file is; empty where there is none.
    url, archive_sha256 : str
        Address and hash of a zip file in which the file is; empty where there is none.
    member : str
        Place of the file, which has the first hash, in the wheel or zip file.
    together : tuple of str
        Names of networks that are fetched with this one.
    packaged : str
        ``package:path`` of a file that an installed package brings.
    gestures, frames : int
        Of those that ``auto`` chooses from: percentage of 15 gestures of new people that were told apart by
        examples of five others, and frames a second on one core.
    """

    name: str
    contract: ModelContract | None = None
    summary: str = ""
    licence: str = ""
    where: str = ""
    files: tuple[str, ...] = ()
    sha256: tuple[str, ...] = ()
    wheel: str = ""
    url: str = ""
    archive_sha256: str = ""
    member: str = ""
    together: tuple[str, ...] = ()
    packaged: str = ""
    gestures: int = 0
    frames: int = 0

    @property
    def remedy(self) -> str:
        """What brings the network to this machine."""
        if self.packaged:
            return (
                "another one: 'gesture models' lists them, 'gesture models add FILE' adds one, "
                "then --model NAME; or --model FILE"
            )
        if self.member:
            return f"'gesture models get {self.name}'"
        return f"get it ({self.where}), then 'gesture models add FILE --name {self.name}'"

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
def _known() -> tuple[tuple[str, ...], dict[str, KnownModel]]:
    """What ``auto`` stands for, and the networks by name: ``known_models.toml``."""
    found = {}
    tables = tomllib.loads((files("gesture_core.pose") / "known_models.toml").read_text("utf-8"))
    auto = tuple(tables.pop("auto"))
    for name, table in tables.items():
        facts, contract = table.pop("contract", None), None
        if facts is not None:
            contract = ModelContract.from_table({**facts, "licence": table.get("licence", "")}, name)
        table |= {key: tuple(table.get(key, ())) for key in ("files", "sha256", "together")}
        found[name] = KnownModel(name, contract, **table)
    return auto, found


def known_models() -> dict[str, KnownModel]:
    """Name -> network, in the order of ``known_models.toml``."""
    return _known()[1]


def auto_models() -> tuple[str, ...]:
    """The networks that ``pose.model = "auto"`` chooses from, the strongest first."""
    return _known()[0]


def is_here(name: str) -> bool:
    """Whether a network of this name was added, or comes with an installed package."""
    known = known_models().get(name)
    return (models_dir() / name / CARD).is_file() or bool(known and known.packaged_path)


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
    lacking = "of the package is not in this installation" if known.packaged else "is known but not here"
    raise ModelError(
        f"the network {text!r} ({known.licence}) {lacking}", remedy=known.remedy, code="E_MODEL_MISSING"
    )


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
        with open_regular(path, limit, ModelError, ("E_NOT_FOUND", "E_MODEL_FILE", "E_MODEL_SIZE")) as file:
            return file.read(limit)
    except ModelError as error:
        if error.code == "E_NOT_FOUND":
            error.remedy = "check the path, or take a name: 'gesture models' lists them"
        raise
    except OSError as error:
        raise ModelError(
            f"cannot be read: {error.strerror}", subject=str(path), code="E_MODEL_FILE"
        ) from error
