"""``gesture evaluate``: how good a preset is on a labelled archive."""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from gesture_core.cli import scores
from gesture_core.cli.flags import Flags, Workers, check_part
from gesture_core.cli.screen import counted, say_assumed, visible
from gesture_core.cli.targets import check_folder
from gesture_core.errors import ConfigError, GestureError, InputError, MissingDependencyError

_NAMED = 5
"""Files or labels that a line names; of the others it says that there are some."""

if TYPE_CHECKING:
    from gesture_core.classify.evaluation import Labelled
    from gesture_core.run.inputs import Input
    from gesture_core.settings import Settings


def evaluate(
    *sources: Annotated[str, Parameter(required=True)],
    out: Path | None = None,
    flags: Flags | None = None,
    labels: str = "folder",
    subjects: Annotated[str, Parameter(show_default=False)] = "",
    protocol: str = "leave-one-subject-out",
    train: Annotated[str, Parameter(show_default=False)] = "",
    grid: Annotated[tuple[str, ...], Parameter(consume_multiple=False, show_default=False)] = (),
    workers: Workers = 0,
) -> int:
    """Measure the accuracy of a preset on a labelled archive.

    Parameters
    ----------
    sources
        Videos and keypoint files, as in gesture classify; all of them need a label.
    out
        Folder for evaluation.json, answers.csv, confusion.png and rejection.png.
    labels
        As in gesture classify: folder, a CSV file with path and label, or a regular expression.
    subjects
        Regular expression whose group (?P<subject>...), or first group, finds who performs in the name.
    protocol
        leave-one-subject-out, leave-one-out, donor (one subject gives one example a class), or split.
    train
        With --protocol split: a regular expression that finds the examples by their names.
    grid
        A setting with the values to try, such as mirror=1.1,1.32; may be repeated.
    """
    from gesture_core.classify.comparison import check_settings
    from gesture_core.classify.evaluation import answer, choose_nested, compare_all

    _require("sklearn", *(["matplotlib"] if out is not None else []))
    if out is not None:
        check_folder(out)
    settings = (flags or Flags()).settings()
    points = _grid(grid)
    candidates = [settings.with_values(point.items(), "--grid") for point in points]
    for point, candidate in zip(points, candidates, strict=True):
        check_settings(candidate)
        for key in point:
            check_part(key, candidate, "--grid")
    items = _labelled(sources, labels, out)
    who = [_subject(item, subjects or labels, explicit=bool(subjects)) for item in items]
    examples = _examples(items, train, protocol)
    _check_protocol(protocol, items, who, examples, max(c.classify.neighbors for c in candidates))
    data, identity = _load(items, who, examples, settings, workers)
    compared = [compare_all(data, candidate) for candidate in candidates]
    found = [answer(c, protocol, point) for c, point in zip(compared, points, strict=True)]
    if len(found) > 1:
        scores.print_grid(found)
        if protocol == "leave-one-subject-out" and all(len(c.subjects) > 2 for c in compared):
            nested, choices = choose_nested(compared)
            chosen = scores.choices_of(choices, points)
            scores.say_accuracy(nested, f"chosen inside the training subjects of each fold ({chosen})")
    number = max(range(len(found)), key=lambda index: found[index].accuracy)  # the first of equals
    best = found[number]
    scores.say_accuracy(best, f"preset {settings.preset}{scores.changes_of(best.changes)}")
    scores.print_classes(best)
    scores.say_unusable(compared[number])
    scores.say_copies(compared[number])
    if out is not None:
        from gesture_core.report.evaluation import write_evaluation

        mark = _fingerprint(best.settings, identity, data)
        for path in write_evaluation(best, mark, out).values():
            print(path, file=sys.stderr)
        print(f"fingerprint {mark}", file=sys.stderr)
    return 3 if any(isinstance(pose, GestureError) for pose in data.poses) else 0


def _require(*modules: str) -> None:
    """Say what is not installed now, and not after hours of extraction."""
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise MissingDependencyError(
            f"gesture evaluate needs {' and '.join(missing)}", remedy="pip install 'gesture-core[evaluate]'"
        )


def _grid(texts: Sequence[str]) -> list[dict[str, Any]]:
    """Every combination of the values in ``key=value,value``; one empty one without a grid."""
    values = {}
    for text in texts:
        key, equals, listed = text.partition("=")
        if not equals or not listed:
            raise ConfigError(f"--grid {text!r}", remedy="mirror=1.1,1.32", code="E_OPTION")
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


def _labelled(sources: Sequence[str], labels: str, out: Path | None) -> list[Input]:
    """The inputs with their labels; those that cannot be read are among them and count as wrong."""
    from gesture_core.run.inputs import discover
    from gesture_core.run.labels import label_inputs

    every = discover(sources, avoid=out)
    found = [item for item in every if item.kind != "other"]
    if not found:
        raise InputError(
            "holds no video or keypoint file",
            subject=", ".join(sources),
            remedy="another path",
            code="E_EMPTY",
        )
    if strangers := [item.name for item in every if item.kind == "other"]:
        named = ", ".join(map(visible, strangers[:_NAMED])) + (", …" if strangers[_NAMED:] else "")
        left = counted(len(strangers), "file")
        print(f"left out as neither video nor keypoints: {left}, {named}", file=sys.stderr)
    labelled = label_inputs(found, labels, sources)
    for item in labelled:
        if not item.label:
            raise InputError(item.fault, subject=item.name, remedy="repairing it", code=item.code)
    if len({item.label for item in labelled}) == 1:
        raise ConfigError(
            f"every input is called {labelled[0].label!r}: there is nothing to tell apart",
            remedy="inputs of several labels, or other --labels",
            code="E_LABELS",
        )
    return labelled


def _examples(items: Sequence[Input], train: str, protocol: str) -> list[bool] | None:
    """Which inputs are the examples of a split."""
    from gesture_core.run.labels import search_name

    if not train:
        return None
    if protocol != "split":
        raise ConfigError(
            f"--train {train!r} is for a split only", remedy="--protocol split", code="E_OPTION"
        )
    try:
        return [search_name(re.compile(train), item) is not None for item in items]
    except re.error as error:
        raise ConfigError(f"--train {train!r} is no regular expression: {error}", code="E_OPTION") from None


def _check_protocol(
    protocol: str,
    items: Sequence[Input],
    who: Sequence[str],
    examples: Sequence[bool] | None,
    neighbors: int,
) -> None:
    """Raise what the protocol would raise, before hours of extraction instead of after them.

    Says as well which tests must fail, since no other subject, or nothing else, has their label.
    """
    import numpy as np

    from gesture_core.classify.protocols import folds

    names, codes = np.unique([str(item.label) for item in items], return_inverse=True)
    alike = np.broadcast_to(0.0, (len(items), len(items)))
    tests, least, hopeless = 0, len(items), Counter[str]()
    for fold in folds(protocol, codes, who, alike, examples):
        tests += len(fold.test)
        least = min(least, len(fold.train))
        hopeless.update(names[codes[fold.test][~np.isin(codes[fold.test], codes[fold.train])]].tolist())
    if neighbors > least:
        raise ConfigError(
            f"{neighbors} neighbours were asked for, and a fold has {counted(least, 'example')}",
            remedy=f"--neighbors up to {least}, or 0 for all examples",
            code="E_NEIGHBORS",
        )
    if hopeless:
        labels = [visible(label) for label in sorted(hopeless)]
        more = ", …" if labels[_NAMED:] else ""
        print(
            f"{hopeless.total()} of {counted(tests, 'test')} cannot be right: "
            f"no example of {', '.join(labels[:_NAMED])}{more} is left to compare with",
            file=sys.stderr,
        )


def _load(
    items: Sequence[Input],
    who: Sequence[str],
    examples: Sequence[bool] | None,
    settings: Settings,
    workers: int,
) -> tuple[Labelled, dict[str, Any]]:
    """Keypoints of all inputs with their labels, and what the keypoints were made with."""
    from gesture_core.classify.evaluation import Labelled
    from gesture_core.cli.keypoints import people_of
    from gesture_core.run.fingerprint import pose_identity
    from gesture_core.types import PoseSequence

    videos = any(item.kind == "video" for item in items)
    identity = pose_identity(settings, videos)
    poses: list[PoseSequence | GestureError] = [
        InputError(item.fault, subject=item.name, code=item.code or None) for item in items
    ]
    hashes = [""] * len(items)
    chosen = [item for item in items if item.kind != "broken"]
    assumed: Counter[str] = Counter()
    places = {item.key: number for number, item in enumerate(items)}
    for item, outcome, people in people_of(chosen, settings, identity=identity, workers=workers):
        number, name = places[item.key], item.name
        hashes[number] = outcome.sha256
        assumed.update([outcome.assumed] if outcome.assumed else [])
        if outcome.code:
            poses[number] = GestureError(outcome.message, subject=name, code=outcome.code)
        elif people:
            poses[number] = people[0]
        else:
            poses[number] = GestureError("nobody was found", subject=name, code="E_NO_PERSON")
    say_assumed(assumed)
    names = [item.name for item in items]
    identity["inputs"] = dict(zip(names, hashes, strict=True))
    return Labelled(poses, [str(item.label) for item in items], who, names, examples), identity


def _subject(item: Input, pattern: str, *, explicit: bool) -> str:
    """Who performs ``item``; empty where nobody said how to tell."""
    from gesture_core.run.labels import halves_a_word, search_name

    if not explicit and "(?P<subject>" not in pattern:
        return ""
    try:
        match = search_name(re.compile(pattern), item)
    except re.error as error:
        raise ConfigError(f"--subjects {pattern!r} is no regular expression: {error}") from None
    who = match and match.re.groups and (match.groupdict().get("subject") or match.group(1))
    if not match or not who:
        raise ConfigError(
            f"no subject for {item.name} by {pattern!r}",
            remedy="--subjects with a group, such as '_s(?P<subject>[0-9]+)_' "
            "(one with a / is searched in the whole path)",
            code="E_SUBJECTS",
        )
    if halves_a_word(match, "subject"):
        raise ConfigError(
            f"--subjects {pattern!r} finds {who!r} inside a word of {item.name}",
            remedy="an expression for letters with accents too, such as '_(?P<subject>.+?)_'",
            code="E_SUBJECTS",
        )
    return str(who)


def _fingerprint(settings: Settings, identity: Mapping[str, Any], data: Labelled) -> str:
    from gesture_core.dtw.distances import choose_kernel
    from gesture_core.run.fingerprint import fingerprint, run_configuration

    kernel = choose_kernel(settings.classify.kernel, settings.dtw, settings.options)[0]
    tree = run_configuration(settings, identity, [], kernel)
    labels = {n: [label, s] for n, label, s in zip(data.names, data.labels, data.subjects, strict=True)}
    return fingerprint({**tree, "labels": labels})
