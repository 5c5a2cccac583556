"""The table that a run produces: one row for every person in every input."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from gesture_core.types import Status

_LONGEST = 10_000


@dataclass(frozen=True)
class Row:
    """One row of the result.

    Attributes
    ----------
    input : str
        The path as the user named it, ``path::member`` for a sequence inside a file.
    sha256 : str
        Of the content; empty where it could not be read.
    person : int
        Track number; 0 for the first or only one.
    label : str or None
        The gesture; only rows with the status ``ok`` or ``degraded`` have one.
    distance : float or None
    margin : float or None
    neighbors : tuple of (example, label, distance)
        As in `Prediction`.
    status : str
        ``ok``, ``degraded``, ``rejected``, ``skipped`` or ``error``.
    code, message : str
        Why, where the status is not ``ok``.
    frames_declared : int or None
        What the container claims.
    frames_read, frames_with_pose : int
    seconds : float
        Length of what was read.
    selected : tuple of str
        Salient channels.
    attempts : int
    plugin : str
        What found the keypoints: distribution and version.
    fingerprint : str
        Of everything that produced the row.
    """

    input: str
    sha256: str = ""
    person: int = 0
    label: str | None = None
    distance: float | None = None
    margin: float | None = None
    neighbors: tuple[tuple[str, str, float], ...] = ()
    status: Status = "error"
    code: str = ""
    message: str = ""
    frames_declared: int | None = None
    frames_read: int = 0
    frames_with_pose: int = 0
    seconds: float = 0.0
    selected: tuple[str, ...] = ()
    attempts: int = 1
    plugin: str = ""
    fingerprint: str = ""

    def as_record(self) -> dict[str, Any]:
        """The row as scalars: ``neighbors`` as JSON, ``selected`` joined by spaces, all text valid UTF-8."""
        record = asdict(self)
        record["neighbors"] = json.dumps(self.neighbors, ensure_ascii=False)
        record["selected"] = " ".join(self.selected)
        if len(self.message) > _LONGEST:  # a plugin's error may be of any length
            record["message"] = f"{self.message[:_LONGEST]}…"
        return {name: _valid(value) if isinstance(value, str) else value for name, value in record.items()}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Row:
        """The inverse of `as_record`."""
        values = {name: record[name] for name in COLUMNS}
        values["neighbors"] = tuple((e, label, d) for e, label, d in json.loads(record["neighbors"]))
        values["selected"] = tuple(record["selected"].split())
        return cls(**values)


def _valid(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


COLUMNS: tuple[str, ...] = tuple(f.name for f in fields(Row))
