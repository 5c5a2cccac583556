"""``gesture evaluate``: how good a preset is on a labelled archive."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from gesture_core.cli.flags import Flags
from gesture_core.errors import ConfigError, GestureError, InputError

if TYPE_CHECKING:
    from gesture_core.archive.discovery import Input
    from gesture_core.classify.evaluation import Evaluation, Labelled
    from gesture_core.settings import Settings


def evaluate(
    *sources: Annotated[str, Parameter(required=True)],
    out: Path | None = None,
    flags: Flags | None = None,
    labels: str = "folder",
    subjects: str = "",
    protocol: str = "leave-one-subject-out",
    train: str = "",
    grid: Annotated[tuple[str, ...], Parameter(consume_multiple=False)] = (),
    workers: int = 0,
) -> int:
    """Measure the accuracy of a preset on a labelled archive.

    Parameters
    ----------
    sources
        Videos and keypoint files, as in gesture classify; all of them need a label.
    out
        Folder for evaluation.json, answers.csv, confusion.png and rejection.png.
    labels
        Where labels come from: folder, a CSV file with path and label, or a regular expression with
        a group (?P<label>...) that is searched in the name.
    subjects
        Regular expression that finds who performs, by its group (?P<subject>...) or its first one;
        a group of that name in --labels serves too.
    protocol
        leave-one-subject-out, leave-one-out, donor (one subject gives one example a class, each
        subject in turn), or split.
    train
        With --protocol split: a regular expression; the inputs whose name it matches are the examples.
    grid
        A setting with the values to try, such as t_var=0.05,0.10; may be repeated. Under
        leave-one-subject-out a further line chooses inside the training subjects of each fold.
    workers
        Worker processes; 0 for one for each core.
    """
    from gesture_core.classify.evaluation import answer, choose_nested, compare_all

    settings = (flags or Flags()).settings()
    points = _grid(grid)
    candidates = [settings.with_values(point.items(), "--grid") for point in points]
    data, identity = _load(sources, settings, labels, subjects, train, workers, out)
    compared = [compare_all(data, candidate) for candidate in candidates]
    found = [answer(c, protocol, point) for c, point in zip(compared, points, strict=True)]
    if len(found) > 1:
        _print_grid(found)
        if protocol == "leave-one-subject-out" and len(set(data.subjects)) > 2:
            nested, choices = choose_nested(compared)
            _say(nested, f"chosen inside the training subjects of each fold ({_chosen(choices, points)})")
    best = max(found, key=lambda evaluation: evaluation.accuracy)  # the first of equals
    _say(best, f"preset {settings.preset}{_changes(best.changes)}")
    _print_classes(best)
    if out is not None:
        from gesture_core.report.evaluation import write_evaluation

        mark = _fingerprint(best.settings, identity, data)
        for path in write_evaluation(best, mark, out).values():
            print(path, file=sys.stderr)
        print(f"fingerprint {mark}", file=sys.stderr)
    return 3 if any(isinstance(pose, GestureError) for pose in data.poses) else 0


def _grid(texts: Sequence[str]) -> list[dict[str, Any]]:
    """Every combination of the values in ``key=value,value``; one empty one without a grid."""
    values = {}
    for text in texts:
        key, equals, listed = text.partition("=")
        if not equals or not listed:
            raise ConfigError(f"--grid {text!r}", remedy="t_var=0.05,0.10", code="E_OPTION")
        if key.strip().startswith("pose."):
            raise ConfigError(
                f"--grid {text!r}: keypoints are extracted once",
                remedy="one gesture evaluate for each value, with --set",
                code="E_OPTION",
            )
        values[key.strip()] = [value.strip() for value in listed.split(",")]
    if not values:
        return [{}]
    from sklearn.model_selection import ParameterGrid

    return list(ParameterGrid(values))


def _load(
    sources: Sequence[str],
    settings: Settings,
    labels: str,
    subjects: str,
    train: str,
    workers: int,
    out: Path | None,
) -> tuple[Labelled, dict[str, Any]]:
    """Keypoints of all inputs with their labels, and what the keypoints were made with."""
    from gesture_core.archive.discovery import discover
    from gesture_core.archive.extraction import extract_all
    from gesture_core.archive.fingerprint import pose_identity
    from gesture_core.archive.labels import label_inputs
    from gesture_core.archive.run import keypoint_store
    from gesture_core.archive.store import read_keypoints
    from gesture_core.classify.evaluation import Labelled
    from gesture_core.cli.progress import progress
    from gesture_core.types import PoseSequence

    found = [item for item in discover(sources, avoid=out) if item.kind in ("video", "keypoints")]
    if not found:
        raise InputError("no video or keypoint file", subject=", ".join(sources), code="E_EMPTY")
    items = label_inputs(found, labels, sources)
    who = [_subject(item, subjects or labels, explicit=bool(subjects)) for item in items]
    identity = pose_identity(settings, any(item.kind == "video" for item in items))
    poses: list[PoseSequence | GestureError] = [GestureError("never extracted") for _ in items]
    hashes = [""] * len(items)
    with progress(quiet=False) as listener:
        listener.planned(len(items), len(items), 0, "")
        for outcome in extract_all(
            items, settings, identity=identity, workers=workers, on_frames=listener.frames
        ):
            name = items[outcome.number].name
            hashes[outcome.number] = outcome.sha256
            listener.extracted(name, outcome.cached)
            poses[outcome.number] = GestureError(outcome.message, subject=name, code=outcome.code or None)
            if not outcome.code:
                people = read_keypoints(keypoint_store() / outcome.stored, name).sequences
                nobody = GestureError("nobody was found", subject=name, code="E_POSE_SPARSE")
                poses[outcome.number] = people[0] if people else nobody
    examples = [bool(re.search(train, item.name)) for item in items] if train else None
    names = [item.name for item in items]
    identity["inputs"] = dict(zip(names, hashes, strict=True))
    return Labelled(poses, [str(item.label) for item in items], who, names, examples), identity


def _subject(item: Input, pattern: str, *, explicit: bool) -> str:
    """Who performs ``item``; empty where nobody said how to tell."""
    if not explicit and "(?P<subject>" not in pattern:
        return ""
    try:
        match = re.search(pattern, item.member or item.path.name) or re.search(pattern, item.name)
    except re.error as error:
        raise ConfigError(f"--subjects {pattern!r} is no regular expression: {error}") from None
    if match is None or not match.re.groups:
        raise ConfigError(
            f"no subject for {item.name} by {pattern!r}",
            remedy="--subjects with a group, such as '_s(?P<subject>[0-9]+)_'",
            code="E_SUBJECTS",
        )
    return match.groupdict().get("subject") or match.group(1)


def _fingerprint(settings: Settings, identity: Mapping[str, Any], data: Labelled) -> str:
    from gesture_core.archive.fingerprint import fingerprint, run_configuration
    from gesture_core.dtw.distances import choose_kernel

    kernel = choose_kernel(settings.classify.kernel, settings.dtw)[0]
    tree = run_configuration(settings, identity, [], kernel)
    labels = {n: [label, s] for n, label, s in zip(data.names, data.labels, data.subjects, strict=True)}
    return fingerprint({**tree, "labels": labels})


def _say(evaluation: Evaluation, what: str) -> None:
    low, high = evaluation.interval
    right = sum(a.right for a in evaluation.answers)
    print(
        f"{evaluation.protocol}: {right} of {len(evaluation.answers)} right, "
        f"{evaluation.accuracy:.1%} (95 %: {low:.1%} to {high:.1%}); {what}"
    )


def _print_grid(found: Sequence[Evaluation]) -> None:
    from gesture_core.cli.screen import print_table

    keys = list(found[0].changes)
    rows = []
    for evaluation in found:
        low, high = evaluation.interval
        values = [str(evaluation.changes[key]) for key in keys]
        rows.append([*values, f"{evaluation.accuracy:.1%}", f"{low:.1%} to {high:.1%}"])
    print_table([*keys, "accuracy", "95 %"], rows, right=["accuracy"])


def _print_classes(evaluation: Evaluation) -> None:
    import numpy as np

    from gesture_core.cli.screen import print_table
    from gesture_core.report.evaluation import thinned

    columns, counts = evaluation.confusion()
    rows = []
    for row, (label, recall) in enumerate(evaluation.recall.items()):
        wrong = [(int(counts[row, c]), columns[c]) for c in np.argsort(-counts[row], kind="stable")]
        taken = ", ".join(f"{name} {count}" for count, name in wrong if count and name != label)
        rows.append([label, str(int(counts[row].sum())), f"{recall:.1%}", taken])
    print_table(["class", "tested", "recall", "taken for"], rows, right=["tested", "recall"])
    folds = evaluation.by_fold
    if 1 < len(folds) <= 40:
        print_table(["fold", "accuracy"], [[n, f"{a:.1%}"] for n, a in folds.items()], right=["accuracy"])
    curve = thinned(evaluation.rejection_curve(), 8)
    cells = [[f"{t:.4g}", f"{c:.1%}", f"{a:.1%}"] for t, c, a in curve]
    print_table(
        ["reject above", "coverage", "accuracy"], cells, right=["reject above", "coverage", "accuracy"]
    )


def _changes(changes: Mapping[str, Any]) -> str:
    return "".join(f", {key}={value}" for key, value in changes.items())


def _chosen(choices: Mapping[str, int], points: Sequence[Mapping[str, Any]]) -> str:
    return "; ".join(f"{who or '-'}:{_changes(points[index])[1:]}" for who, index in choices.items())
