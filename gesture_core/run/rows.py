"""From what came of an input and what was decided about each person to rows of the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gesture_core.errors import Code
from gesture_core.run.discovery import FRAMES, PICTURE_SUFFIXES, Input
from gesture_core.run.work import Outcome
from gesture_core.types import PoseSequence, Prediction, Row

_READING = frozenset({"E_READ", "E_KEYPOINTS_UNREADABLE"})
_FAR = "try: a clip of one gesture, gesture render to see what the network sees, or a larger --reject"


def skipped_row(item: Input, fingerprint: str) -> Row:
    """The row of something that is neither a video nor a keypoint file."""
    what = FRAMES if item.path.suffix.lower() in PICTURE_SUFFIXES else "another format"
    return Row(
        item.name,
        status=Code.NOT_AN_INPUT.status,
        code="E_NOT_AN_INPUT",
        message=f"{item.name}: {item.fault}; try: {what}, or a manifest that leaves it out",
        fingerprint=fingerprint,
    )


def broken_row(item: Input, fingerprint: str) -> Row:
    """The row of something that should be readable and is not."""
    what = "check what it is and its permissions" if item.code in _READING else "repairing it"
    code = Code.of(item.code)
    if code and code.plugin:
        what = "another version of the plugin"
    return Row(
        item.name,
        status="error",
        code=item.code,
        message=f"{item.name}: {item.fault}; try: {what}, then --retry-errors",
        fingerprint=fingerprint,
    )


def _base(item: Input, outcome: Outcome, fingerprint: str) -> Row:
    return Row(
        item.name,
        outcome.sha256,
        frames_declared=outcome.frames_declared,
        frames_read=outcome.frames_read,
        seconds=outcome.seconds,
        attempts=outcome.attempts,
        plugin=outcome.plugin,
        fingerprint=fingerprint,
    )


def failed_row(item: Input, outcome: Outcome, fingerprint: str) -> Row:
    """The row of an input from which no keypoints came."""
    base = _base(item, outcome, fingerprint)
    if outcome.code:
        return replace(base, code=outcome.code, message=_said_of(item, outcome.message))
    nobody = replace(
        base,
        status=Code.NO_PERSON.status,
        code="E_NO_PERSON",
        message=f"{item.name}: nobody was found in {outcome.frames_read} frames; "
        "try: another --pose or --model, or gesture render to see what the network sees",
    )
    return _with_damage(nobody, item, outcome)


def person_row(
    item: Input,
    outcome: Outcome,
    pose: PoseSequence,
    prediction: Prediction,
    fingerprint: str,
) -> Row:
    """The row of one person: the prediction, degraded where the input lost frames."""
    row = replace(
        _base(item, outcome, fingerprint),
        person=pose.person,
        label=prediction.label,
        distance=prediction.distance,
        margin=prediction.margin,
        neighbors=prediction.neighbors,
        status=prediction.status,
        code=prediction.code,
        message=_said_of(item, prediction.message),
        frames_with_pose=pose.frames_with_pose,
        selected=prediction.selected,
    )
    code = Code.of(row.code)
    if code and code.status == "rejected":  # nothing went wrong, and no label is warranted
        row = replace(row, status="rejected")
    if row.code == "E_REJECTED":
        row = replace(row, message=f"{row.message}; {_FAR}")
    return _with_damage(row, item, outcome)


def _with_damage(row: Row, item: Input, outcome: Outcome) -> Row:
    """The row, if frames of its input are lost: a label is degraded, a missing label is an error."""
    if outcome.complete or row.status == "error":
        return row
    said = f"; otherwise: {row.code} {row.message.removeprefix(f'{item.name}: ')}" if row.code else ""
    return replace(
        row,
        status=Code.MEDIA_PARTIAL.status if row.status == "ok" else "error",
        code="E_MEDIA_PARTIAL",
        message=f"{item.name}: {'; '.join(outcome.notes) or 'frames are missing'}; "
        f"kept: {outcome.frames_read} frames; try: repairing the file{said}",
    )


def _said_of(item: Input, message: str) -> str:
    """``message`` with the input's name in front, once."""
    return f"{item.name}: {message.removeprefix(f'{item.name}: ')}" if message else ""


def person_rows(
    item: Input,
    outcome: Outcome,
    poses: Sequence[PoseSequence],
    predictions: Sequence[Prediction],
    fingerprint: str,
) -> list[Row]:
    """Rows of all people in one input, at least one."""
    if outcome.code or not poses:
        return [failed_row(item, outcome, fingerprint)]
    return [
        person_row(item, outcome, pose, prediction, fingerprint)
        for pose, prediction in zip(poses, predictions, strict=True)
    ]
