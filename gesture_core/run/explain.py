"""Why an input of a run got its label: `explain`."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gesture_core.classify import explanation
from gesture_core.classify.examples import sided_labels
from gesture_core.classify.explanation import Explanation
from gesture_core.classify.recognizer import Recognizer, signals_of
from gesture_core.errors import GestureError, InputError, RunFolderError
from gesture_core.records import Row
from gesture_core.run.annotations import event_of
from gesture_core.run.extract import Listener, people_of
from gesture_core.run.found_again import find_inputs
from gesture_core.run.inputs import Input
from gesture_core.run.results import open_results
from gesture_core.run.rows import input_called
from gesture_core.run.workers.decision import open_fitted
from gesture_core.settings import Settings, settings_from_dict
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence, Signals

_ALIKE = 0.001
"""Two margins that are the same, on whatever processor they were computed."""


@dataclass(frozen=True, eq=False)
class RowExplanation:
    """A row of a run, and why it has its label.

    Attributes
    ----------
    row : Row
        As the run left it. Its label is another one than that of ``explanation.nearest`` where this version
        decides otherwise than the one that made the run.
    explanation : Explanation
        The nearest example of the label and of the runner-up, with both warpings and what each channel of
        the movement costs; where all examples decide, also what each of them adds to the decision.
    file_name : str
        For a picture of it; no other input of the run has the same one.
    settings : Settings
        Of the run.
    seen : mapping of str to (path, str)
        Where the run found the input and the two examples, by their names, and the hashes of their contents.
    sided : tuple of str
        Labels on the left that have their like on the right, where examples also stand for the other hand.
    """

    row: Row
    explanation: Explanation
    file_name: str
    settings: Settings
    seen: Mapping[str, tuple[str, str]]
    sided: tuple[str, ...] = ()


def explain(
    run: str | os.PathLike[str],
    input: str,
    person: int = 0,
    event: int = 0,
    *,
    listener: Listener | None = None,
) -> RowExplanation:
    """Explain a row of a run: `gesture explain` as a function.

    Parameters
    ----------
    run : path
        The run folder. The input must be where the run found it; the examples only where the folder
        holds no fitted ones, as after a run of an earlier version.
    input : str
        The input as the row names it, or a part of its name that no other one has.
    person : int
        Which person of the input, where it has several.
    event : int
        Which event, in a run of `gesture spot`; the first one by default. The examples must be where the run
        found them.
    listener : Listener, optional
        Told about the extraction of keypoints that are not in the store any more.

    Raises
    ------
    RunFolderError
        ``E_NO_RUN`` where the folder holds no run, or one that classified nothing.
    InputError
        ``E_NOT_FOUND`` where there is no such row, or it was never compared with anything; ``E_CHANGED``
        where an input or example is not what it was.

    Examples
    --------
    >>> from gesture_core import explain
    >>> found = explain("run/", "clip_01")
    >>> found.row.label == found.explanation.nearest.label
    True
    >>> found.explanation.nearest.distance < found.explanation.runner_up.distance
    True
    """
    with open_results(run) as results:
        rows = list(results.rows())
        row = _row(rows, input, person, event)
        configuration = results.configuration
        left_out = {failed.input for failed in results.rows("example")}
        place = results.place_of(row.input)
        fingerprint = results.get("fingerprint") or ""  # of all its rows: other settings were refused
    if not configuration.get("examples"):
        raise RunFolderError(
            "holds keypoints only, nothing was classified",
            subject=str(run),
            remedy="a folder that gesture classify wrote",
            code="E_NO_RUN",
        )
    if row.distance is None:
        raise _nothing(row)
    examples = {n: known for n, known in configuration["examples"].items() if n not in left_out}
    hashes = {name: known["sha256"] for name, known in examples.items()} | {row.input: row.sha256}
    if row.event:
        return _explain_event(row, rows, examples, hashes, place, configuration, listener)
    recognizer = open_fitted(Path(run), fingerprint, configuration["examples"])
    settings = recognizer.settings if recognizer else settings_from_dict(configuration["settings"])
    places = _places(examples) | {row.input: os.fspath(place or "")}
    wanted = {row.input: row.sha256} if recognizer else hashes
    people = _people(wanted, places, settings, listener)
    query = _query(row, people, settings)
    recognizer = recognizer or _recognizer(examples, people, settings)
    distances = recognizer.distances([query])[0]
    found = explanation.explain(query, recognizer.library, distances, settings, recognizer.fitted)
    if settings.classify.votes == 0 and row.margin is not None and abs(found.lead - row.margin) > _ALIKE:
        said = f"the margin is {found.lead:.3g} now and was {row.margin:.3g}"
        warnings.warn(f"this version decides otherwise than the one that made the run: {said}", stacklevel=2)
    mirrored = settings.classify.mirror is not None
    sided = sided_labels({str(label) for label in recognizer.library.labels}) if mirrored else ()
    seen = _seen(found, row, places, hashes)
    return RowExplanation(row, found, _file_name(row, rows), settings, seen, tuple(sided))


def _explain_event(
    row: Row,
    rows: Sequence[Row],
    examples: Mapping[str, Any],
    hashes: Mapping[str, str],
    place: Path | None,
    configuration: Mapping[str, Any],
    listener: Listener | None,
) -> RowExplanation:
    """The event of a row, aligned with its example."""
    from gesture_core.spot.explanation import EventExplainer

    settings = settings_from_dict(configuration["settings"])
    places = _places(examples) | {row.input: os.fspath(place or "")}
    people = _people(hashes, places, settings, listener)
    poses = [pose for pose in people.get(row.input, []) if pose.person == row.person]
    names = [name for name in examples if people.get(name)]
    if not poses or row.neighbors[0][0] not in names:
        raise InputError(
            "the event's keypoints, or those of its example, are not there any more",
            subject=row.input,
            remedy="gesture spot once more",
            code="E_CHANGED",
        )
    labels = [str(examples[name]["label"]) for name in names]
    explain_event = EventExplainer([people[name][0] for name in names], labels, names, settings)
    found = explain_event(event_of(row), poses[0])
    seen = _seen(found, row, places, hashes)
    return RowExplanation(row, found, _file_name(row, rows), settings, seen)


def _places(examples: Mapping[str, Any]) -> dict[str, str]:
    """Where the run found its examples."""
    return {name: known["path"] for name, known in examples.items() if "path" in known}


def _seen(
    found: Explanation, row: Row, places: Mapping[str, str], hashes: Mapping[str, str]
) -> dict[str, tuple[str, str]]:
    """Path and hash of the input and of both examples, by their names."""
    sides = [side.example for side in (found.nearest, found.runner_up) if side is not None]
    return {name: (places.get(name, ""), hashes[name]) for name in (row.input, *sides)}


def _people(
    hashes: Mapping[str, str], places: Mapping[str, str], settings: Settings, listener: Listener | None
) -> dict[str, list[PoseSequence]]:
    """People of each input by its name, from the keypoint store or extracted again.

    ``hashes`` are the content hashes that the run saw; an input that has changed since is an error.
    An input that cannot be read is left out. ``places`` are absolute paths, where the run knows them.
    """
    names: dict[bytes, list[str]] = {}  # an input may be an example too, under another name
    items: dict[bytes, Input] = {}
    for name, item in find_inputs({name: places.get(name) for name in hashes}, settings).items():
        if isinstance(item, GestureError):
            raise item
        names.setdefault(item.key, []).append(name)
        items[item.key] = item
    people: dict[str, list[PoseSequence]] = {}
    for item, found, sequences in people_of(list(items.values()), settings, listener=listener):
        for name in names[item.key]:
            if found.sha256 and found.sha256 != hashes[name]:
                raise InputError(
                    "has changed since the run",
                    subject=name,
                    remedy="gesture classify --overwrite first",
                    code="E_CHANGED",
                )
            if not found.code:
                people[name] = sequences
    return people


def _row(rows: Sequence[Row], name: str, person: int, event: int = 0) -> Row:
    """The row of the input and person; of several events that of this number, or the first."""
    found = input_called((row.input for row in rows), name)
    for row in rows:
        if row.input == found and row.person == person and (not event or row.event == event):
            return row
    own = [row for row in rows if row.input == found]
    if event and any(row.person == person for row in own):
        last = max(row.event for row in own if row.person == person)
        remedy = f"--event 1 to {last}".removesuffix(" to 1") if last else ""
        raise InputError(f"has no event {event}", subject=found, remedy=remedy, code="E_NOT_FOUND")
    known = " or ".join(dict.fromkeys(f"--person {row.person}" for row in own))
    raise InputError(f"has no person {person}", subject=found, remedy=known, code="E_NOT_FOUND")


def _file_name(row: Row, rows: Sequence[Row]) -> str:
    """The file's name, with its folders where several files have it, and the person."""
    same = {other.input for other in rows if Path(other.input).name == Path(row.input).name}
    name = Path(row.input).name if len(same) == 1 else row.input.lstrip("./")
    number = (f"-{row.person}" if row.person else "") + (f"-event{row.event}" if row.event else "")
    safe = re.sub(r"[^\w.-]+", "_", name)
    return f"explain-{safe[-80:]}{number}.png"


def _nothing(row: Row) -> InputError:
    """A row that was never compared explains itself."""
    message = row.message.removeprefix(f"{row.input}: ")
    cause = f"there is nothing to explain, {row.status} {row.code}: {message}"
    return InputError(cause, subject=row.input, code="E_NOT_FOUND")


def _query(row: Row, people: Mapping[str, Sequence[PoseSequence]], settings: Settings) -> Signals:
    for pose in people.get(row.input, []):
        if pose.person == row.person:
            return Chain.from_settings(settings)(pose)
    raise _nothing(row)


def _recognizer(
    examples: Mapping[str, Any], people: Mapping[str, Sequence[PoseSequence]], settings: Settings
) -> Recognizer:
    """The recognizer of the run, from its examples' keypoints, in their order."""
    signals, labels, names = [], [], []
    for name, known in examples.items():
        first = people.get(name, [])[:1]
        try:
            signals += signals_of(first, settings, "example")
        except GestureError:
            continue  # the run left it out as well, and its rows say why
        labels += [known["label"]] * len(first)
        names += [name] * len(first)
    return Recognizer.fit(settings, signals, labels, names)
