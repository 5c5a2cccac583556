"""The networks that the user added: one folder each under `gesture_core.files.models_dir`.

``<name>/model.json`` names the file, its SHA-256 and its contract; the file lies beside it.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from gesture_core.errors import ModelError
from gesture_core.files import models_dir
from gesture_core.pose.contracts import ModelContract
from gesture_core.pose.model_file import ModelFile, read_bounded

CARD = "model.json"
_NAME = re.compile(r"[a-z0-9]+([-._][a-z0-9]+)*")
_LONGEST = 64


@dataclass(frozen=True)
class AddedModel:
    """One entry of the user's folder."""

    name: str
    path: Path
    sha256: str
    contract: ModelContract | None
    licence: str = ""
    origin: str = ""


def _is_name(name: str) -> bool:
    return len(name) <= _LONGEST and _NAME.fullmatch(name) is not None


def check_name(name: str) -> str:
    """``name`` where it is one: it becomes a folder, so nothing that could leave `models_dir` is."""
    if not _is_name(name):
        raise ModelError(
            f"{name!r} is not a name",
            remedy=f"at most {_LONGEST} lower-case letters and digits, with single '-', '_' or '.' between",
            code="E_MODEL_NAME",
        )
    return name


def added_names() -> tuple[str, ...]:
    """Names of the networks that the user added."""
    folder = models_dir()
    if not folder.is_dir():
        return ()
    return tuple(sorted(card.parent.name for card in folder.glob(f"*/{CARD}") if _is_name(card.parent.name)))


def read_card(name: str) -> AddedModel:
    """The entry of ``name``; a ModelError ``E_MODEL_CARD`` where it is damaged."""
    folder = models_dir() / check_name(name)
    try:
        table = json.loads(read_bounded(folder / CARD, 1 << 16))
        file, sha256 = table["file"], table["sha256"]
        contract = table.get("contract")
        if not isinstance(file, str) or Path(file).name != file or file in (".", ".."):
            raise ValueError(f"file name {file!r}")
        path = folder / file
        if path.is_symlink():
            raise ValueError(f"{file} is a link")
        return AddedModel(
            name,
            path,
            str(sha256),
            ModelContract.from_table(contract, name) if contract else None,
            str(table.get("licence", "")),
            str(table.get("origin", "")),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(
            f"its card is damaged: {error}",
            subject=str(folder / CARD),
            remedy="remove the folder and add the model again",
            code="E_MODEL_CARD",
        ) from error


def added_model(name: str) -> ModelFile | None:
    """The model file of ``name``, None where the user added none of that name."""
    if not _is_name(name) or not (models_dir() / name / CARD).is_file():
        return None
    card = read_card(name)
    return ModelFile(card.path, card.sha256, name, card.contract)
