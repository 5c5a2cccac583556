"""The main job from Python: `load_poses` and `classify_archive`."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gesture_core.run.extract import Listener, people_of
from gesture_core.run.inputs import discover_readable
from gesture_core.run.pipeline import RunSummary, run_archive
from gesture_core.run.plan import RunRequest
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
    items = discover_readable(as_strings(sources), settings=ready)
    for item in items:
        if item.kind == "broken":
            raise item.error()
    came = {item.key: (found, people) for item, found, people in people_of(items, ready, workers=workers)}
    for item in items:
        found, _ = came[item.key]
        if found.code:
            raise found.error(item.name)
    return [pose for item in items for pose in came[item.key][1]]


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
    spot: bool = False,
    calibrate: Sources = (),
    shard: str = "",
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
    retry_errors : bool
        Try inputs again whose row is an error.
    overwrite : bool
        Forget the rows of a run that was made with other settings.
    spot : bool
        Look for the examples in long recordings, see `spot_archive`.
    calibrate : path or sequence of paths
        With ``spot``: annotated recordings by which ``spot.tolerance`` is chosen, see `run.calibrate`.
    shard : str
        ``"3/16"``: only the third of 16 parts of the inputs, see `merge_runs`.
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
        labels=labels,
        label_columns=label_columns,
        workers=workers,
        engine=engine,
        retry_errors=retry_errors,
        overwrite=overwrite,
        spot=spot,
        shard=shard,
    )
    if marked := as_strings(calibrate):
        from gesture_core.run.calibrate import calibrate as calibrated

        request, _ = calibrated(request, marked, listener)
    return run_archive(request, listener)


def spot_archive(
    sources: Sources,
    examples: Sources,
    out: str | os.PathLike[str] | None = None,
    settings: Settings | str | None = None,
    **options: Any,
) -> RunSummary:
    """Find the examples in long recordings: `gesture spot` as a function.

    Parameters
    ----------
    sources, examples, out, settings, options
        As in `classify_archive`. An example called ``_none`` is a movement that is no gesture.

    Returns
    -------
    RunSummary
        ``summary.rows()`` has a row for every event, and one for each input without any.
    """
    return classify_archive(sources, examples, out, settings, spot=True, **options)


def with_changes(settings: Settings | str | None, changes: dict[str, Any]) -> Settings:
    """Ready settings, or those of a preset, with ``changes`` by name, ``__`` standing for the dot."""
    ready = settings if isinstance(settings, Settings) else load_settings(settings)
    return ready.with_values((key.replace("__", "."), value) for key, value in changes.items())


def as_strings(sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> tuple[str, ...]:
    """One source or several, as a tuple of strings."""
    if isinstance(sources, str | os.PathLike):
        return (os.fspath(sources),)
    return tuple(os.fspath(source) for source in sources)
