"""How good a preset is on labelled sequences: who is tested by whose examples, and what each is taken for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gesture_core.classify.balance import balanced
from gesture_core.classify.classifiers import Fitted, landmarks, learn, needs_distances, teaching
from gesture_core.classify.comparison import compare, is_still
from gesture_core.classify.decision import refusals, temperature_of, votes_of
from gesture_core.classify.learning import medoids
from gesture_core.classify.scores import Answer, Evaluation
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.settings import ClassifySettings, Settings
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence, Recording, Signals

PROTOCOLS = ("leave-one-subject-out", "leave-one-out", "donor", "split")


@dataclass(frozen=True, eq=False)
class Labelled:
    """What is evaluated.

    Attributes
    ----------
    poses : sequence of N (PoseSequence, Recording, Signals or GestureError)
        Signals are compared as they are. An error stands for an input that could not be read; it
        counts as not recognised.
    labels, subjects, names : sequences of N str
    train : sequence of N bool, optional
        Examples of the protocol ``split``.
    """

    poses: Sequence[PoseSequence | Recording | Signals | GestureError]
    labels: Sequence[str]
    subjects: Sequence[str]
    names: Sequence[str]
    train: Sequence[bool] | None = None


@dataclass(frozen=True, eq=False)
class Compared:
    """All sequences of a data set against each other under one preset.

    Attributes
    ----------
    data : Labelled
    settings : Settings
    usable : (M,) int array
        Positions in ``data`` that the rows and columns of ``within`` stand for.
    within : (M, M) float array
        Distances.
    errors : mapping
        Position in ``data`` of what could not be used, and why.
    still : (M,) bool array, optional
        Sequences in which nothing moves.
    series : sequence of M Signals
        For classifiers that look at the signals, and for choosing among many; may be empty otherwise.
    """

    data: Labelled
    settings: Settings
    usable: np.ndarray
    within: np.ndarray
    errors: dict[int, GestureError]
    still: np.ndarray | None = None
    series: Sequence[Signals] = ()

    @property
    def subjects(self) -> set[str]:
        """Those of whom anything can be used."""
        return {self.data.subjects[i] for i in self.usable}

    def without(self, subject: str) -> Compared:
        """The same data as if ``subject`` had never been recorded."""
        kept = np.array([self.data.subjects[i] != subject for i in self.usable], bool)
        errors = {i: e for i, e in self.errors.items() if self.data.subjects[i] != subject}
        within, still = self.within[np.ix_(kept, kept)], None if self.still is None else self.still[kept]
        series = self.of(np.flatnonzero(kept))
        usable = self.usable[kept]
        return replace(self, usable=usable, within=within, errors=errors, still=still, series=series)

    def of(self, rows: np.ndarray) -> list[Signals]:
        """The series of some rows, if there are any."""
        return [self.series[i] for i in rows] if self.series else []


def compare_all(data: Labelled, settings: Settings) -> Compared:
    """Compute all distances of ``data`` once; every protocol takes its part of them.

    Raises
    ------
    InputError
        Where fewer than two sequences can be used.
    """
    chain = Chain.from_settings(settings)
    signals: dict[int, Signals] = {}
    errors: dict[int, GestureError] = {}
    for index, pose in enumerate(data.poses):
        try:
            if isinstance(pose, GestureError):
                raise pose
            signals[index] = pose if isinstance(pose, Signals) else chain(pose)
        except GestureError as error:
            errors[index] = error
    if len(signals) < 2:
        first = f"; the first one: {next(iter(errors.values()))}" if errors else ""
        raise InputError(f"{len(signals)} sequences can be used{first}", code="E_EMPTY")
    series = list(signals.values())
    # Of a split as a run has it, otherwise of all: no label has a part in it.
    train = [] if data.train is None else [one for i, one in signals.items() if data.train[i]]
    settings = balanced(train or series, settings)
    within = compare(series, series, settings).astype(np.float64)
    still = np.array([is_still(item) for item in series], bool)
    return Compared(data, settings, np.array(list(signals), np.int64), within, errors, still, series)


@dataclass(frozen=True, eq=False)
class Fold:
    """One split: indices of the examples and of the queries, and what it is called."""

    name: str
    train: np.ndarray
    test: np.ndarray


def folds(
    protocol: str,
    codes: np.ndarray,
    subjects: Sequence[str],
    within: np.ndarray,
    train: Sequence[bool] | None = None,
) -> Iterator[Fold]:
    """The folds of ``protocol``.

    Parameters
    ----------
    protocol : str
        ``leave-one-subject-out``: each subject against all others. ``leave-one-out``: each
        sequence against all others. ``donor``: one subject gives one example a class (the medoid
        of their trials), all others are tested; each subject in turn. ``split``: by ``train``.
    codes : (N,) int array
        Class of each sequence.
    subjects : sequence of N str
    within : (N, N) float array
        Distances, for the medoids.
    train : sequence of N bool, optional
        Examples of the ``split``.

    Raises
    ------
    ConfigError
        For an unknown protocol, a single subject, or an empty side of the split.
    """
    who = np.asarray(subjects)
    every, known = np.arange(len(codes)), np.unique(who)
    if protocol in ("leave-one-subject-out", "donor") and len(known) < 2:
        raise ConfigError(
            f"protocol {protocol} needs two subjects and there is {len(known)}",
            remedy="--subjects with a regular expression that finds them, or folder:0 where each has a "
            "folder, or --protocol leave-one-out",
            code="E_SUBJECTS",
        )
    if protocol == "leave-one-subject-out":
        for subject in known:
            yield Fold(str(subject), every[who != subject], every[who == subject])
    elif protocol == "leave-one-out":
        for index in every:
            yield Fold(str(index), np.delete(every, index), every[index : index + 1])
    elif protocol == "donor":
        for subject in known:
            own = every[who == subject]
            chosen = own[medoids(within[np.ix_(own, own)], codes[own])]
            yield Fold(str(subject), chosen, every[who != subject])
    elif protocol == "split":
        given = np.zeros(len(codes), bool) if train is None else np.asarray(train, bool)
        if not given.any() or given.all():
            raise ConfigError(
                "the split leaves no example or no query",
                remedy="--train with a regular expression that finds the examples",
                code="E_SPLIT",
            )
        yield Fold("split", every[given], every[~given])
    else:
        raise ConfigError(f"protocol {protocol!r}", remedy=f"one of {', '.join(PROTOCOLS)}", code="E_OPTION")


def answer(
    compared: Compared, protocol: str, changes: Mapping[str, Any] | None = None, *, calibrate: bool = False
) -> Evaluation:
    """Test a compared data set on itself by ``protocol``.

    Votes, thresholds and representative examples are those of the classifier, from the examples
    of each fold alone. With ``calibrate``, or a limit of the confidence, so are probabilities; in
    ``leave-one-out`` their one temperature is that of all sequences, which leaves one out as it is.

    Raises
    ------
    ConfigError
        For a protocol that does not fit the data, and for more neighbours than a fold has examples.
    """
    data, settings, within, usable = compared.data, compared.settings, compared.within, compared.usable
    chosen = settings.classify
    classes, codes = np.unique(np.array([str(data.labels[i]) for i in usable]), return_inverse=True)
    subjects = [data.subjects[i] for i in usable]
    train = None if data.train is None else [data.train[i] for i in usable]
    answers: list[Answer] = []
    names: list[str] = []
    temperature = None
    calibrate = calibrate or chosen.confidence is not None
    if calibrate and protocol == "leave-one-out":
        every = Fitted.fit(settings, compared.series, codes, len(classes), within)
        temperature = _temperature(every, within, compared.series, chosen)
    for fold in folds(protocol, codes, subjects, within, train):
        taught = fold.train[teaching(compared.of(fold.train), codes[fold.train], settings)]
        marks = taught[landmarks(compared.of(taught), codes[taught], chosen)]
        among = within[np.ix_(taught, marks)] if needs_distances(settings) else None
        known = compared.of(taught)
        kept, thresholds, fitted = learn(settings, known, codes[taught], len(classes), among)
        examples = taught[kept]
        block = within[np.ix_(fold.test, examples)]
        if calibrate and protocol != "leave-one-out":
            own = within[np.ix_(examples, examples)]
            temperature = _temperature(fitted, own, compared.of(examples), chosen)
        votes = votes_of(fitted.with_temperature(temperature), block, compared.of(fold.test))
        still = None if compared.still is None else compared.still[fold.test]
        refused = refusals(votes, thresholds, chosen, still)
        for row, origin in enumerate(usable[fold.test]):
            winner = int(votes.winners[row])
            limit = np.inf if winner < 0 or thresholds is None else float(thresholds[winner])
            answers.append(
                Answer(
                    data.names[origin],
                    str(data.labels[origin]),
                    data.subjects[origin],
                    fold.name,
                    None if refused[row] else str(classes[winner]),
                    float(votes.distances[row]),
                    float(votes.margins[row]),
                    limit,
                    refused[row],
                    np.nan if votes.chances is None or winner < 0 else float(votes.chances[row]),
                    np.nan if chosen.votes or winner < 0 else float(votes.scores[row, winner]),
                )
            )
        names.append(fold.name)
    for index, error in compared.errors.items():
        name, label, subject = data.names[index], str(data.labels[index]), data.subjects[index]
        # The folds that test a sequence that cannot be used, even where they test nothing else.
        tested: Sequence[str] = [subject if protocol == "leave-one-subject-out" else name]
        if protocol == "split":
            tested = names if data.train is None or not data.train[index] else ()
        elif protocol == "donor":
            tested = [fold_name for fold_name in names if fold_name != subject]
        for fold_name in tested:
            answers.append(Answer(name, label, subject, fold_name, None, np.inf, np.inf, code=error.code))
    return Evaluation(answers, protocol, compared.settings, dict(changes or {}))


def _temperature(
    fitted: Fitted, within: np.ndarray, series: Sequence[Signals], chosen: ClassifySettings
) -> float | None:
    """That of the probabilities; None where too few examples make none, and none is asked for."""
    try:
        return temperature_of(fitted, within, series)
    except InputError:
        if chosen.confidence is not None:
            raise
        return None


def choose_nested(candidates: Sequence[Compared]) -> tuple[Evaluation, dict[str, int]]:
    """Leave-one-subject-out where each fold takes the candidate that is best among the other subjects.

    The choice never sees the subject that is tested: for each subject, every candidate is scored by
    leave-one-subject-out among the others, and the winner (the first of equals) is tested.

    Returns
    -------
    evaluation : Evaluation
    choices : mapping
        Index of the candidate that each subject's fold took.

    Raises
    ------
    ConfigError
        E_SUBJECTS where there are fewer than three subjects: a fold leaves one out, and choosing another.
    """
    subjects = sorted(set(candidates[0].data.subjects))
    seen = min(len(candidate.subjects) for candidate in candidates)
    if seen < 3:
        raise ConfigError(
            f"a choice inside the folds needs three subjects and there are {seen} with usable clips",
            remedy="clips of more people, or one setting at a time",
            code="E_SUBJECTS",
        )
    answers: list[Answer] = []
    choices = {}
    for subject in subjects:
        scores = [answer(c.without(subject), "leave-one-subject-out").accuracy for c in candidates]
        choices[subject] = int(np.argmax(scores))
        whole = answer(candidates[choices[subject]], "leave-one-subject-out")
        answers += [a for a in whole.answers if a.subject == subject]
    return Evaluation(answers, "leave-one-subject-out, nested", candidates[0].settings), choices
