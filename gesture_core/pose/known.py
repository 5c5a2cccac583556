"""The public networks that the package knows about, from ``known_models.toml``."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from gesture_core.pose.contracts import ModelContract


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
    """Name -> network, in the order of the file."""
    text = (files("gesture_core.pose") / "known_models.toml").read_text("utf-8")
    found = {}
    for name, table in tomllib.loads(text).items():
        table = dict(table)
        licence = table.get("licence", "")
        contract = ModelContract.from_table({**table.pop("contract"), "licence": licence}, name)
        for key in ("files", "sha256"):
            table[key] = tuple(table.get(key, ()))
        found[name] = KnownModel(name, contract, **table)
    return found


def known_by_hash(sha256: str) -> KnownModel | None:
    """The known network with this file hash."""
    return next((known for known in known_models().values() if sha256 in known.sha256), None)
