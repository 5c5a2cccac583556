"""The main job from Python: `load_poses` and `classify_archive`."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gesture_core.errors import GestureError, InputError
from gesture_core.run.extract import extract_all
from gesture_core.run.inputs import discover
from gesture_core.run.pipeline import Listener, RunSummary, run_archive
from gesture_core.run.plan import RunRequest
from gesture_core.run.store import keypoint_store, read_keypoints
from gesture_core.settings import Settings, load_settings
from gesture_core.types import PoseSequence

Sources = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


def load_poses(
    sources: Sources, settings: Settings | str | None = None, *, workers: int = 0, **changes: Any
) -> list[PoseSequence]:
    """Keypoints of every person in ``sources``, extracted or taken from the keypoint store.

    Parameters
    ----------
    sources : path or sequence of paths
        Videos, keypoint files, folders, globs or manifests.
    settings : Settings or str, optional
        Ready settings, or the name of a preset.
    workers : int
        Worker processes; 0 for one for each core.
    changes
        Settings by name with ``__`` for the dot, such as ``pose__model="hpe0001"`` or
        ``classify__reject=None``.

    Returns
    -------
    list of PoseSequence
        In the order of the inputs. `PoseSequence.source` names the input.

    Warns
    -----
    UserWarning
        Where something is neither a video nor a keypoint file, and left out.

    Raises
    ------
    GestureError
        For the first input that cannot be read; `classify_archive` gives such an input a row instead.
    """
    ready = with_changes(settings, changes)
    every = discover(as_strings(sources), settings=ready)
    items = [item for item in every if item.kind != "other"]
    if not items:
        raise InputError(
            "holds no video or keypoint file",
            subject=", ".join(as_strings(sources)),
            remedy="another path",
            code="E_EMPTY",
        )
    if strangers := [item.name for item in every if item.kind == "other"]:
        shown = ", ".join(strangers[:5]) + (", …" if strangers[5:] else "")
        warnings.warn(f"left out, neither video nor keypoints: {shown}", stacklevel=2)
    for item in items:
        if item.kind == "broken":
            raise InputError(
                item.fault, subject=item.name, remedy=item.remedy or "repairing it", code=item.code
            )
    extracted = extract_all(items, ready, workers=workers)
    by_key = {item.key: found for item, found in extracted}
    poses: list[PoseSequence] = []
    for item in items:
        found = by_key[item.key]
        if found.code:
            raise GestureError(found.message, subject=item.name, code=found.code)
        poses += read_keypoints(keypoint_store() / found.stored, item.name).sequences
    return poses


def classify_archive(
    sources: Sources,
    examples: Sources,
    out: str | os.PathLike[str] | None = None,
    settings: Settings | str | None = None,
    *,
    labels: str = "folder",
    label_columns: str = "",
    workers: int = 0,
    engine: str = "processes",
    retry_errors: bool = False,
    overwrite: bool = False,
    listener: Listener | None = None,
    **changes: Any,
) -> RunSummary:
    """Classify an archive: `gesture classify` as a function.

    Parameters
    ----------
    sources, examples : path or sequence of paths
        Examples are ``<root>/<label>/<clip>`` unless ``labels`` says otherwise.
    out : path, optional
        The run folder; a new temporary one by default.
    settings, workers, changes
        As in `load_poses`.
    labels : str
        ``"folder"``, or ``"folder:-1"`` and other levels; a CSV file; or a regular expression with a group
        ``label``.
    label_columns : str
        With a CSV file: the headings of path and label, such as ``"filename,class"``.
    engine : str
        Name of an execution engine: ``processes``, or ``inline`` for debugging.
    retry_errors, overwrite : bool
        As in `RunRequest`.
    listener : Listener, optional
        Told about the run as it goes on.

    Returns
    -------
    RunSummary
        ``summary.rows()`` is the table.
    """
    folder = Path(out) if out is not None else Path(tempfile.mkdtemp(prefix="gesture-run-"))
    request = RunRequest(
        as_strings(sources),
        folder,
        with_changes(settings, changes),
        as_strings(examples),
        labels,
        workers,
        engine,
        retry_errors=retry_errors,
        overwrite=overwrite,
        label_columns=label_columns,
    )
    return run_archive(request, listener)


def spot_archive(
    sources: Sources,
    examples: Sources,
    out: str | os.PathLike[str] | None = None,
    settings: Settings | str | None = None,
    *,
    labels: str = "folder",
    workers: int = 0,
    engine: str = "processes",
    retry_errors: bool = False,
    overwrite: bool = False,
    listener: Listener | None = None,
    **changes: Any,
) -> RunSummary:
    """Find the examples in long recordings: `gesture spot` as a function.

    The parameters are those of `classify_archive`. An example called ``_none`` is a movement that is no
    gesture.

    Returns
    -------
    RunSummary
        ``summary.rows()`` has a row for every event, and one for each input without any.
    """
    folder = Path(out) if out is not None else Path(tempfile.mkdtemp(prefix="gesture-run-"))
    request = RunRequest(
        as_strings(sources),
        folder,
        with_changes(settings, changes),
        as_strings(examples),
        labels,
        workers,
        engine,
        retry_errors=retry_errors,
        overwrite=overwrite,
        spot=True,
    )
    return run_archive(request, listener)


def with_changes(settings: Settings | str | None, changes: dict[str, Any]) -> Settings:
    ready = settings if isinstance(settings, Settings) else load_settings(settings)
    return ready.with_values((key.replace("__", "."), value) for key, value in changes.items())


def as_strings(sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> tuple[str, ...]:
    """One source or several, as a tuple of strings."""
    if isinstance(sources, str | os.PathLike):
        return (os.fspath(sources),)
    return tuple(os.fspath(source) for source in sources)
