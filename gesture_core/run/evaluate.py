"""How good a preset is on a labelled archive: `evaluate_archive`, and which inputs it tests on which."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.classify.comparison import check_settings
from gesture_core.classify.evaluation import Compared, Labelled, answer, choose_nested, compare_all, folds
from gesture_core.classify.examples import sided_labels
from gesture_core.classify.scores import Evaluation
from gesture_core.errors import ConfigError, GestureError
from gesture_core.run.archive import Sources, as_strings, with_changes
from gesture_core.run.extract import Listener, people_of
from gesture_core.run.fingerprint import fingerprint, pose_identity, run_configuration
from gesture_core.run.inputs import Input, discover_readable
from gesture_core.run.labels import LEVEL, FolderLabels, halves_a_word, label_inputs, search_name
from gesture_core.settings import Settings
from gesture_core.settings.load import check_option, find_key
from gesture_core.types import PoseSequence

_NAMED = 5
"""Labels that a message lists."""


@dataclass(frozen=True, eq=False)
class EvaluationResult:
    """What came of an evaluation.

    Attributes
    ----------
    evaluations : list of Evaluation
        One for each point of the grid, in its order; one without a grid.
    compared : Compared
        All distances under the settings of `best`, and what could not be compared.
    nested : Evaluation or None
        With a grid and ``leave-one-subject-out``: the accuracy of a choice that never saw the subject that
        is tested. None without, or where there are fewer than three subjects.
    choices : mapping
        The point of the grid that the fold of each subject took in `nested`.
    fingerprint : str
        Of everything that decides the figures of `best`.
    assumed : mapping
        What keypoint files do not say and was assumed, and of how many.
    unreadable : tuple of str
        Inputs from which no keypoints came. They count as not recognised.
    """

    evaluations: list[Evaluation]
    compared: Compared
    nested: Evaluation | None = None
    choices: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    fingerprint: str = ""
    assumed: Mapping[str, int] = field(default_factory=dict)
    unreadable: tuple[str, ...] = ()

    @property
    def best(self) -> Evaluation:
        """The most accurate evaluation, the first of equals."""
        return max(self.evaluations, key=lambda evaluation: evaluation.accuracy)

    @property
    def accuracy(self) -> float:
        """That of `best`, 0 to 1."""
        return self.best.accuracy

    @property
    def unusable(self) -> dict[str, GestureError]:
        """Why inputs could not be compared, by their names; they count as not recognised."""
        names = self.compared.data.names
        return {names[index]: error for index, error in self.compared.errors.items()}

    @property
    def sided(self) -> list[str]:
        """Labels on the left that have their like on the right, where `best` also takes examples mirrored."""
        mirrored = self.compared.settings.classify.mirror is not None
        return sided_labels(set(self.compared.data.labels)) if mirrored else []

    def copies(self) -> tuple[int, list[tuple[int, int]]]:
        """Inputs at no distance from another one: the same clip twice, under other names or labels.

        Returns
        -------
        number : int
            Inputs that have a copy.
        contradictions : list of (int, int)
            Pairs of two labels, as positions in ``compared.data``.
        """
        alike = np.triu(self.compared.within == 0, 1)
        codes = np.unique(np.array(self.compared.data.labels)[self.compared.usable], return_inverse=True)[1]
        pairs = self.compared.usable[np.argwhere(alike & (codes[:, None] != codes))]
        return int((alike | alike.T).any(axis=0).sum()), [(int(i), int(j)) for i, j in pairs]


def evaluate_archive(
    sources: Sources,
    settings: Settings | str | None = None,
    *,
    protocol: str = "leave-one-subject-out",
    labels: str = "folder",
    label_columns: str = "",
    subjects: str = "",
    train: str = "",
    grid: Mapping[str, Sequence[Any]] | None = None,
    workers: int = 0,
    avoid: Path | None = None,
    listener: Listener | None = None,
    **changes: Any,
) -> EvaluationResult:
    """Test labelled clips on each other: `gesture evaluate` as a function.

    What cannot be tested is refused before any keypoints are extracted.

    Parameters
    ----------
    sources : path or sequence of paths
        Videos and keypoint files, as in `classify_archive`; all of them need a label.
    settings : Settings or str, optional
        Ready settings, or the name of a preset.
    protocol : str
        ``leave-one-subject-out``, ``leave-one-out``, ``donor`` (one subject gives one example a class; each
        subject in turn), or ``split``.
    labels : str
        ``folder``, a CSV file, or a regular expression with a group ``label``, as in `classify_archive`.
    label_columns : str
        With a CSV file: the headings of path and label, such as ``"filename,class"``.
    subjects : str
        Regular expression whose group ``subject``, or first group, finds who performs in the name of a file,
        or ``folder:0`` and so on, as for ``labels``; by default the group ``subject`` of ``labels``, if it
        has one.
    train : str
        With ``split``: a regular expression that finds the examples by their names.
    grid : mapping
        Values to try of each of these settings; every combination is evaluated.
    workers : int
        Worker processes; 0 for one for each core.
    avoid : path, optional
        A folder that is not looked into.
    listener : Listener, optional
        Told about the extraction as it goes on.
    changes
        Settings by name with ``__`` for the dot, such as ``classify__reject=None``.

    Returns
    -------
    EvaluationResult
        ``result.best`` has the answers, the accuracy and its interval.

    Warns
    -----
    UserWarning
        Where something is neither a video nor a keypoint file, or a test cannot be right because no example
        of its label is left.

    Raises
    ------
    ConfigError
        For labels, subjects, a protocol or settings that do not fit the archive.
    InputError
        Where there is nothing to evaluate.

    Examples
    --------
    >>> from gesture_core import evaluate_archive
    >>> result = evaluate_archive("examples/", protocol="leave-one-out")
    >>> f"{result.accuracy:.0%} of {len(result.best.answers)} clips"
    '100% of 12 clips'
    """
    ready = with_changes(settings, changes)
    tried = sorted((grid or {}).items())
    points: list[dict[str, Any]] = [
        dict(zip((key for key, _ in tried), values, strict=True))
        for values in product(*(values for _, values in tried))
    ]
    candidates = [ready.with_values(point.items(), "--grid") for point in points]
    for point, candidate in zip(points, candidates, strict=True):
        check_settings(candidate)
        for key in point:
            if find_key(key, ready, "--grid")[0] in ("video", "pose", "keypoints"):
                raise ConfigError(
                    f"--grid {key}: keypoints are extracted once",
                    remedy="one evaluation for each value, with --set",
                    code="E_OPTION",
                )
            check_option(key, candidate, "--grid")
    items = labelled_inputs(as_strings(sources), labels, label_columns, avoid, ready)
    who = subjects_of(items, subjects or labels, as_strings(sources), explicit=bool(subjects))
    examples = examples_of_split(items, train, protocol)
    neighbors = max(candidate.classify.votes for candidate in candidates)
    check_protocol(protocol, items, who, examples, neighbors)
    listener = listener or Listener()
    poses, hashes, identity, assumed = _load(items, ready, workers, listener)
    names = [item.name for item in items]
    data = Labelled(poses, [str(item.label) for item in items], who, names, examples)
    listener.stage("comparing")
    every = [compare_all(data, candidate) for candidate in candidates]
    found = [answer(compared, protocol, point) for compared, point in zip(every, points, strict=True)]
    best = max(range(len(found)), key=lambda index: found[index].accuracy)
    found[best] = answer(every[best], protocol, points[best], calibrate=True)
    nested, choices = None, {}
    if len(found) > 1 and protocol == "leave-one-subject-out" and all(len(c.subjects) > 2 for c in every):
        nested, taken = choose_nested(every)
        choices = {subject: points[index] for subject, index in taken.items()}
    return EvaluationResult(
        found,
        every[best],
        nested,
        choices,
        _fingerprint(candidates[best], {**identity, "inputs": dict(zip(names, hashes, strict=True))}, data),
        assumed,
        tuple(n for n, pose in zip(names, poses, strict=True) if isinstance(pose, GestureError)),
    )


def _load(
    items: Sequence[Input], settings: Settings, workers: int, listener: Listener
) -> tuple[list[PoseSequence | GestureError], list[str], dict[str, Any], Counter[str]]:
    """The first person of each input or why there is none, content hashes, what made the keypoints, and what
    was assumed.
    """
    identity = pose_identity(settings, items)
    poses: list[PoseSequence | GestureError] = [item.error() for item in items]
    hashes = [""] * len(items)
    assumed: Counter[str] = Counter()
    readable = [item for item in items if item.kind != "broken"]
    places = {item.key: number for number, item in enumerate(items)}
    for item, found, people in people_of(
        readable, settings, identity=identity, workers=workers, listener=listener
    ):
        number = places[item.key]
        hashes[number] = found.sha256
        assumed.update([found.assumed] if found.assumed else [])
        if found.code:
            poses[number] = found.error(item.name)
        elif people:
            poses[number] = people[0]
        else:
            poses[number] = GestureError("nobody was found", subject=item.name, code="E_NO_PERSON")
    return poses, hashes, identity, assumed


def _fingerprint(settings: Settings, identity: Mapping[str, Any], data: Labelled) -> str:
    from gesture_core.dtw.distances import choose_kernel

    kernel = choose_kernel(settings.classify.kernel, settings.dtw, settings.options)[0]
    tree = run_configuration(settings, identity, [], kernel)
    labels = {n: [label, s] for n, label, s in zip(data.names, data.labels, data.subjects, strict=True)}
    return fingerprint({**tree, "labels": labels})


def labelled_inputs(
    sources: Sequence[str], labels: str, columns: str, avoid: Path | None, settings: Settings
) -> list[Input]:
    """The inputs with their labels; those that cannot be read are among them and count as wrong."""
    found = discover_readable(sources, avoid=avoid, settings=settings)
    labelled = label_inputs(found, labels, sources, columns)
    for item in labelled:
        if not item.label or item.code == "E_NOT_FOUND":  # a pattern is no clip that could be wrong
            raise item.error()
    if len({item.label for item in labelled}) == 1:
        raise ConfigError(
            f"every input is called {labelled[0].label!r}: there is nothing to tell apart",
            remedy="inputs of several labels, or other --labels",
            code="E_LABELS",
        )
    return labelled


def subjects_of(items: Sequence[Input], pattern: str, sources: Sequence[str], *, explicit: bool) -> list[str]:
    """Who performs each of the ``items``; empty where nothing says how to tell."""
    level = LEVEL.fullmatch(pattern)
    if not explicit and (level or "(?P<subject>" not in pattern):
        return [""] * len(items)
    if level:
        folders = FolderLabels(int(level[1] or 0), items, sources)
        return [folders(item) or _subject_of(item, pattern, None) for item in items]
    try:
        return [_subject_of(item, pattern, search_name(re.compile(pattern), item)) for item in items]
    except re.error as error:
        raise ConfigError(f"--subjects {pattern!r} is no regular expression: {error}") from None


def _subject_of(item: Input, pattern: str, match: re.Match[str] | None) -> str:
    """Who performs ``item``, by what was found in its name."""
    who = match and match.re.groups and (match.groupdict().get("subject") or match.group(1))
    if not match or not who:
        raise ConfigError(
            f"no subject for {item.name} by {pattern!r}",
            remedy="--subjects with a group, such as '_s(?P<subject>[0-9]+)_' "
            "(one with a / is searched in the whole path), or folder:0, folder:-1 for a folder's name",
            code="E_SUBJECTS",
        )
    if halves_a_word(match, "subject"):
        raise ConfigError(
            f"--subjects {pattern!r} finds {who!r} inside a word of {item.name}",
            remedy="an expression for letters with accents too, such as '_(?P<subject>.+?)_'",
            code="E_SUBJECTS",
        )
    return str(who)


def examples_of_split(items: Sequence[Input], train: str, protocol: str) -> list[bool] | None:
    """Which inputs are the examples of a split."""
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


def check_protocol(
    protocol: str, items: Sequence[Input], who: Sequence[str], examples: Sequence[bool] | None, neighbors: int
) -> None:
    """Raise what the protocol would raise, before hours of extraction instead of after them.

    Warns as well of tests that must fail, since no other subject, or nothing else, has their label.
    """
    names, codes = np.unique([str(item.label) for item in items], return_inverse=True)
    alike = np.broadcast_to(0.0, (len(items), len(items)))
    tests, least, impossible = 0, len(items), Counter[str]()
    for fold in folds(protocol, codes, who, alike, examples):
        tests += len(fold.test)
        least = min(least, len(fold.train))
        impossible.update(names[codes[fold.test][~np.isin(codes[fold.test], codes[fold.train])]].tolist())
    if neighbors > least:
        raise ConfigError(
            f"{neighbors} neighbours were asked for, and a fold has {least} example{'s' * (least != 1)}",
            remedy=f"--neighbors up to {least}, or 0 for all examples",
            code="E_NEIGHBORS",
        )
    if impossible:
        _warn(
            f"{impossible.total()} of {tests} test{'s' * (tests != 1)} cannot be right: "
            f"no example of {_some(sorted(impossible))} is left to compare with"
        )


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=4)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", …" if names[_NAMED:] else "")
