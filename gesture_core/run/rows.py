"""From what came of an input and what was decided about each person to rows of the result."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from gesture_core.errors import Code, InputError
from gesture_core.records import Event, Prediction, Row
from gesture_core.run.inputs import FRAMES, PICTURE_SUFFIXES, Input
from gesture_core.run.store import Extracted
from gesture_core.settings.schema import SpotSettings

_READING = frozenset({"E_READ", "E_KEYPOINTS_UNREADABLE"})
_NOBODY = (
    "a camera that sees the whole person from the front, a lower limit (--set onnx.presence=0.2, or that of "
    "another backend), or another --model"
)
_NOBODY_IN_FILE = (
    "--set pose.score=none, or keypoints from another network: the file has no joint that counts"
)
_MORE, _FARTHEST = 5, 3.0
"""Events that a hint lets in at most, and times their threshold that they are away at most."""
_SEEN = "gesture render to see what the network sees"


def unread_row(item: Input, fingerprint: str) -> Row:
    """The row of something that nobody reads (skipped), or that should be readable and is not (error)."""
    code = Code.of(item.code)
    if item.kind == "other":
        picture = item.path.suffix.lower() in PICTURE_SUFFIXES
        remedy = f"{FRAMES if picture else 'another format'}, or a manifest that leaves it out"
    elif item.remedy:
        remedy = f"{item.remedy}, then --retry-errors"
    elif code == Code.MISSING_DEPENDENCY:
        remedy = "that command, then --retry-errors"
    elif code and code.plugin:
        remedy = "another version of the plugin, then --retry-errors"
    elif item.code in _READING:
        remedy = "check what it is and its permissions, then --retry-errors"
    else:
        remedy = "repairing it, then --retry-errors"
    return Row(
        item.name,
        status=Code.NOT_AN_INPUT.status if item.kind == "other" else "error",
        code=item.code or "E_NOT_AN_INPUT",
        message=f"{item.name}: {item.fault}; try: {remedy}",
        fingerprint=fingerprint,
    )


def contradicting_row(item: Input, other: Input, fingerprint: str) -> Row:
    """The row of an example that is as well an example of another label."""
    return Row(
        item.name,
        item.sha256,
        code="E_CONTRADICTION",
        message=f"{item.name}: is called {item.label}, and {other.name}, with the same content, "
        f"{other.label}; neither is used; try: only the right one of them",
        fingerprint=fingerprint,
    )


def rows_of(
    item: Input,
    found: Extracted,
    decided: Sequence[dict[str, Any]] | None,
    fingerprint: str,
    spot: SpotSettings | None = None,
) -> list[Row]:
    """Rows of all people in one input, at least one.

    Parameters
    ----------
    item : Input
    found : Extracted
    decided : sequence of dict or None
        The fields of a `Prediction` for each person, or ``events``, a list of the fields of an `Event`; None
        where nothing is decided.
    fingerprint : str
    spot : SpotSettings, optional
        By which events were found.
    """
    base = Row(
        item.name,
        found.sha256,
        frames_declared=found.frames_declared,
        frames_read=found.frames_read,
        frames_looked_at=found.frames_looked_at,
        seconds=found.seconds,
        attempts=found.attempts,
        plugin=found.plugin,
        note=_note(found),
        fingerprint=fingerprint,
    )
    if found.code:
        return [replace(base, code=found.code, message=_about(item, found.message))]
    if not found.people:
        message = (
            f"{item.name}: nobody was found in the {found.frames_looked_at} frames that were looked at; "
            f"try: {_NOBODY if item.kind == 'video' else _NOBODY_IN_FILE}"
        )
        nobody = replace(base, status=Code.NO_PERSON.status, code="E_NO_PERSON", message=message)
        return [_with_damage(nobody, item, found)]
    rows = []
    for number, seen in enumerate(found.people):
        if decided is not None and "events" in decided[number]:
            of_person = replace(
                base, person=seen.person, start=seen.start, end=seen.end, box=seen.box,
                frames_with_pose=seen.frames,
            )  # fmt: skip
            of_events = _event_rows(of_person, item, decided[number], spot or SpotSettings())
            rows += [_with_damage(row, item, found) for row in of_events]
            continue
        prediction = Prediction(None, "ok") if decided is None else prediction_of(decided[number])
        code = Code.of(prediction.code)
        # What helps where an example is too far; a threshold of scores says it itself.
        far = ""
        if prediction.code == "E_REJECTED" and "; try: " not in prediction.message:
            seen_by = f", {_SEEN}," if seen.box else ""
            far = f"; try: a clip of one gesture{seen_by} or a larger --reject"
        row = replace(
            base,
            person=seen.person,
            start=seen.start,
            end=seen.end,
            box=seen.box,
            label=prediction.label,
            distance=prediction.distance,
            margin=prediction.margin,
            confidence=prediction.confidence,
            score=prediction.score,
            neighbors=prediction.neighbors,
            status="rejected" if code and code.status == "rejected" else prediction.status,
            code=prediction.code,
            message=_about(item, prediction.message + far),
            frames_with_pose=seen.frames,
            selected=prediction.selected,
            note="; ".join(filter(None, (base.note, prediction.note))),
        )
        rows.append(_with_damage(row, item, found))
    return rows


def nearer(refused: Sequence[float], spot: SpotSettings) -> str:
    """The setting that would let in some gestures that are so many times as far as their thresholds."""
    some = [times for times in sorted(refused)[:_MORE] if times <= _FARTHEST]
    name, now = "tolerance", spot.tolerance
    if spot.threshold is not None:
        name, now = "threshold", spot.threshold
    if not some or now == 0:  # no number of times nothing is enough
        return ""
    needed = some[-1] * now
    step = 10.0 ** (math.floor(math.log10(needed)) - 1)
    value = math.ceil(needed / step) * step
    marked = "" if spot.threshold is not None else ", or --calibrate with marked recordings"
    return f"--set spot.{name}={value:.2g}, which would let {len(some)} more in{marked}"


def _event_rows(base: Row, item: Input, tree: dict[str, Any], spot: SpotSettings) -> list[Row]:
    """A row for each event of one person, or the one that says that there is none."""
    base = replace(base, note="; ".join(filter(None, [base.note, tree["note"]])))
    if not tree["events"]:
        refused: list[float] = tree["refused"]
        near = (
            f"{len(refused)} farther than the thresholds, the nearest {min(refused):.3g} times as far; "
            if refused
            else ""
        )
        remedies = [nearer(refused, spot), "more examples", _SEEN if base.box else ""]
        message = (
            f"{item.name}: none of the examples was recognised in {base.seconds:.1f} s; {near}"
            f"try: {'; '.join(filter(None, remedies))}"
        )
        return [replace(base, status=Code.NO_EVENT.status, code=str(Code.NO_EVENT), message=message)]
    rows = []
    for number, one in enumerate(tree["events"], 1):
        event = Event(**one)
        nearest = ((event.example, event.label, event.distance),)
        rows.append(
            replace(
                base, label=event.label, event=number, start=event.start, end=event.end, score=event.score,
                distance=event.distance, neighbors=nearest, status="ok",
            )
        )  # fmt: skip
    return rows


def prediction_of(tree: dict[str, Any]) -> Prediction:
    """A prediction from its fields, after JSON."""
    neighbors = tuple(map(tuple, tree.get("neighbors", ())))
    fields = {"label": None} | tree | {"neighbors": neighbors, "selected": tuple(tree.get("selected", ()))}
    return Prediction(**fields)


def _with_damage(row: Row, item: Input, found: Extracted) -> Row:
    """The row, if frames of its input are lost: a label is degraded, a missing label is an error."""
    if found.complete or row.status == "error":
        return row
    kept = f"{found.frames_read} frame{'s' * (found.frames_read != 1)}"
    otherwise = f"; otherwise: {row.code} {row.message.removeprefix(f'{item.name}: ')}" if row.code else ""
    return replace(
        row,
        status=Code.MEDIA_PARTIAL.status if row.status == "ok" else "error",
        code="E_MEDIA_PARTIAL",
        message=f"{item.name}: {'; '.join(found.notes) or 'frames are missing'}; "
        f"kept: {kept}; try: repairing the file{otherwise}",
    )


def _note(found: Extracted) -> str:
    """What was assumed, and what was noted; where frames are lost, the message has the notes."""
    assumed = [f"assumed: {found.assumed}"] if found.assumed else []
    return "; ".join([*assumed, *(found.notes if found.complete else ())])


def _about(item: Input, message: str) -> str:
    """``message`` with the input's name in front, once."""
    said = re.sub(r"^query \d+:? ", "", message.removeprefix(f"{item.name}: "))  # whose place nobody sees
    return f"{item.name}: {said}" if message else ""


def input_called(known: Iterable[str], name: str) -> str:
    """The input called ``name`` among those of a run, or the only one whose name ends so, or holds it.

    Raises
    ------
    InputError
        ``E_NOT_FOUND`` where there is none, or several.
    """
    names = dict.fromkeys(known)
    if not names:
        cause = f"no input of the run is {name!r}: it has no rows"
        raise InputError(cause, remedy="the run again, to its end", code="E_NOT_FOUND")
    found = (
        [one for one in names if one == name]
        or [one for one in names if one.endswith(name)]
        or [one for one in names if name in one]
    )
    if len(found) != 1:
        some = ", ".join((found or list(names))[:5])
        raise InputError(
            f"{name!r} could be any of {len(found)} inputs" if found else f"no input of the run is {name!r}",
            remedy=f"one of {some}{' …' if len(found or names) > 5 else ''}",
            code="E_NOT_FOUND",
        )
    return found[0]
