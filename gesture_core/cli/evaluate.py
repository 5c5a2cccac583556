"""``gesture evaluate``: how good a preset is on a labelled archive."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from gesture_core.cli.flags import REPEATED, UNSAID, Flags, Sources, Workers
from gesture_core.cli.output import (
    check_folder,
    counted,
    mirroring_hint,
    print_table,
    say,
    say_assumed,
    warnings_as_lines,
)
from gesture_core.errors import ConfigError, MissingDependencyError

if TYPE_CHECKING:
    from gesture_core.classify.scores import Evaluation
    from gesture_core.run.evaluate import EvaluationResult

_SHOWN = 5
_RELIABLE = 0.9
_FOLDS_SHOWN = 40


def evaluate(
    *sources: Sources,
    out: Path | None = None,
    flags: Flags | None = None,
    labels: str = "folder",
    label_columns: Annotated[str, UNSAID] = "",
    subjects: Annotated[str, UNSAID] = "",
    protocol: str = "leave-one-subject-out",
    train: Annotated[str, UNSAID] = "",
    grid: Annotated[
        tuple[str, ...],
        REPEATED,
        Parameter(
            help="A setting with the values to try, such as mirror=1.1,1.32; --grid again for a further one."
        ),
    ] = (),
    workers: Workers = 0,
    events: Path | None = None,
) -> int:
    """Measure the accuracy of a preset on a labelled archive, or of events against annotations.

    Parameters
    ----------
    sources
        Videos and keypoint files, as in gesture classify; all of them need a label. With --events the folder
        of a run of gesture spot.
    out
        Folder for evaluation.json, answers.csv, confusion.png and rejection.png.
    labels
        As in gesture classify: folder, folder:-1, a CSV file with path and label, or a regular expression.
    label_columns
        With a CSV file: its headings of path and label, such as filename,class; 1,2 where it has none.
    subjects
        Who performs: a regular expression whose group (?P<subject>...), or first group, finds it in the name;
        or folder:0, the first folder below the source, folder:-1, the one that holds the clip.
    protocol
        leave-one-subject-out, leave-one-out, donor (one subject gives one example a class), or split.
    train
        With --protocol split: a regular expression that finds the examples by their names.
    events
        Annotations to compare the events of a run with: ELAN, WebVTT or CSV (input, start, end, label), a
        file or a folder. Nothing is computed again, and the other options take no part.
    """
    if events is not None:
        return _evaluate_events(sources, events)
    from gesture_core.cli.progress import progress
    from gesture_core.run.evaluate import evaluate_archive

    if out is not None:
        check_folder(out)
    settings, values = (flags or Flags()).settings(), _grid(grid)
    with progress(sources) as listener, warnings_as_lines():
        result = evaluate_archive(
            sources,
            settings,
            protocol=protocol,
            labels=labels,
            label_columns=label_columns,
            subjects=subjects,
            train=train,
            grid=values,
            workers=workers,
            avoid=out,
            listener=listener,
        )
    if out is not None:  # before anything is printed: a closed pipe must not cost it
        _write(result, out)
    if sys.stdout.isatty():
        _print(result)
    else:
        _print_lines(result)
    _say_flaws(result)
    return 3 if result.unreadable else 0


def _print_lines(result: EvaluationResult) -> None:
    """A line of JSON for each point of a grid, for the choice inside the folds, and last for what is best."""
    from gesture_core.report.evaluation import summary

    lines = [summary(one) for one in result.evaluations if one is not result.best]
    if result.nested is not None:
        lines.append(summary(result.nested) | {"choices": result.choices})
    for line in [*lines, {"fingerprint": result.fingerprint} | summary(result.best)]:
        print(json.dumps(line, ensure_ascii=False, allow_nan=False))


def _print(result: EvaluationResult) -> None:
    if len(result.evaluations) > 1:
        _print_grid(result.evaluations)
    if result.nested is not None:
        choices = [f"{who or '-'}: {_point(point)}" for who, point in result.choices.items()]
        _print_accuracy(
            result.nested, f"chosen inside the training subjects of each fold ({'; '.join(choices)})"
        )
    best = result.best
    preset = f"preset {best.settings.preset}"
    _print_accuracy(best, ", ".join([preset, *filter(None, [_point(best.changes)])]))
    _print_classes(best)
    _print_thresholds(best)


def _evaluate_events(sources: Sequence[str], annotations: Path) -> int:
    """Print how well the events of a run fit annotations: a table on a terminal, otherwise a line of JSON."""
    from gesture_core.run.annotations import evaluate_events
    from gesture_core.spot.evaluation import POINT

    if len(sources) != 1:
        raise ConfigError(f"--events with {len(sources)} sources", remedy="one run folder", code="E_OPTION")
    scores = evaluate_events(sources[0], annotations)
    if not sys.stdout.isatty():
        print(json.dumps(asdict(scores)))
        return 0
    rows = [
        [f"overlap {key:g}" if key else f"within {POINT:g} s", f"{scores.f1[key]:.1%}",
         f"{scores.precision[key]:.1%}", f"{scores.recall[key]:.1%}"]
        for key in scores.f1
    ]  # fmt: skip
    print(
        f"{counted(scores.reported, 'event')}, {counted(scores.annotated, 'annotation')}, "
        f"{scores.minutes:.1f} min"
    )
    print_table(["met", "F1", "precision", "recall"], rows, right=["F1", "precision", "recall"])
    late = (
        ""
        if scores.lateness is None
        else f"; they end {scores.lateness:+.2f} s from the annotations (median)"
    )
    print(f"{scores.false_alarms:.1f} false alarms a minute, mean overlap {scores.jaccard:.1%}{late}")
    return 0


def _grid(texts: Sequence[str]) -> dict[str, list[str]]:
    values = {}
    for text in texts:
        key, equals, listed = text.partition("=")
        if not equals or not listed:
            raise ConfigError(f"--grid {text!r}", remedy="mirror=1.1,1.32", code="E_OPTION")
        values[key.strip()] = [value.strip() for value in listed.split(",")]
    return values


def _point(point: Mapping[str, Any]) -> str:
    """A point of the grid as text."""
    return ", ".join(f"{key}={value}" for key, value in point.items())


def _write(result: EvaluationResult, folder: Path) -> None:
    from gesture_core.report.evaluation import draw_evaluation, write_evaluation

    lines = [str(path) for path in write_evaluation(result.best, result.fingerprint, folder)]
    try:
        lines += [str(path) for path in draw_evaluation(result.best, folder)]
    except MissingDependencyError as error:
        lines.append(f"no pictures: {error.message}")
    for line in [*lines, f"fingerprint {result.fingerprint}"]:
        say(line)


def _print_accuracy(evaluation: Evaluation, what: str) -> None:
    """One line: protocol, accuracy, its interval, and ``what`` was evaluated."""
    low, high = evaluation.interval
    right = sum(a.right for a in evaluation.answers)
    print(
        f"{evaluation.protocol}: {right} of {len(evaluation.answers)} right, "
        f"{evaluation.accuracy:.1%} (95 %: {low:.1%} to {high:.1%}); {what}"
    )


def _print_grid(found: Sequence[Evaluation]) -> None:
    """One line for each point of a grid."""
    keys = list(found[0].changes)
    rows = []
    for evaluation in found:
        low, high = evaluation.interval
        values = [str(evaluation.changes[key]) for key in keys]
        rows.append([*values, f"{evaluation.accuracy:.1%}", f"{low:.1%} to {high:.1%}"])
    print_table([*keys, "accuracy", "95 %"], rows, right=["accuracy"])


def _print_classes(evaluation: Evaluation) -> None:
    """Recall and confusions of each class, and the accuracy of each fold."""
    columns, counts = evaluation.confusion()
    rows = []
    for (label, recall), row in zip(evaluation.recall.items(), counts.tolist(), strict=True):
        wrong = sorted(zip(columns, row, strict=True), key=lambda pair: -pair[1])
        taken = ", ".join(f"{name} {count}" for name, count in wrong if count and name != label)
        rows.append([label, str(sum(row)), f"{recall:.1%}", taken])
    print_table(["class", "tested", "recall", "taken for"], rows, right=["tested", "recall"])
    folds = evaluation.by_fold
    if 1 < len(folds) <= min(_FOLDS_SHOWN, len(evaluation.answers) - 1):  # a fold of one answer says nothing
        print_table(["fold", "accuracy"], [[n, f"{a:.1%}"] for n, a in folds.items()], right=["accuracy"])


def _print_thresholds(evaluation: Evaluation) -> None:
    """What stricter thresholds would cost, and bring."""
    from gesture_core.report.evaluation import thinned

    curves = {
        "reject above": evaluation.rejection_curve(),
        "margin from": evaluation.margin_curve(),
        "score from": evaluation.score_curve(),
        "confidence from": evaluation.confidence_curve(),
    }
    some = any(curves.values())  # otherwise nothing has a label
    if some:
        print(
            "a stricter threshold labels fewer inputs (coverage), and usually more of these rightly "
            "(accuracy): --reject VALUE, --set classify.margin=VALUE, --set classify.min_score=VALUE or "
            "--set classify.confidence=VALUE"
        )
    for title, curve in curves.items():
        if curve:
            columns = [title, "coverage", "accuracy"]
            cells = [[f"{t:.4g}", f"{c:.1%}", f"{a:.1%}"] for t, c, a in thinned(curve, 8)]
            print_table(columns, cells, right=columns)
    if curves["confidence from"]:
        _print_confidence(evaluation)
    elif some:
        print(
            "no label has a confidence: it is calibrated on examples that have another one of their class, "
            "and no fold has any"
        )


def _print_confidence(evaluation: Evaluation) -> None:
    """What limit of the confidence makes the labels reliable, and how far the confidence is off."""
    goal = f"for {_RELIABLE:.0%} right among the labelled"
    point = evaluation.confidence_for(_RELIABLE)
    if point is None:
        print(f"{goal} no classify.confidence is high enough")
    elif point == evaluation.confidence_curve()[0]:
        print(f"{goal} no classify.confidence is needed: {point[2]:.0%} of the labels are right")
    else:
        limit = int(1000 * point[0]) / 1000  # below the input that it is to keep
        print(f"{goal} use --set classify.confidence={limit:g}: {point[1]:.0%} of the inputs keep a label")
    exact = evaluation.exact_error
    assert exact is not None, "labels have probabilities"
    mean, most = exact
    print(
        f"expected calibration error of the confidence: {evaluation.calibration_error:.3f}; exact ones of as "
        f"many labels show {mean:.3f} on the average, and {most:.3f} at most in 95 of 100 cases"
    )


def _say_flaws(result: EvaluationResult) -> None:
    """What was assumed, which inputs could not be compared, and which are copies of others."""
    say_assumed(result.assumed)
    if result.sided:
        say(mirroring_hint(result.sided))
    data, unusable = result.compared.data, result.unusable
    if unusable:
        say(f"{len(unusable)} of {counted(len(data.names), 'input')} count as not recognised:")
    for name, error in list(unusable.items())[:_SHOWN]:
        say(f"  {error.code} {error.about(name).message}")
    if len(unusable) > _SHOWN:
        say(f"  … and {len(unusable) - _SHOWN} more: answers.csv of --out has all")
    number, contradictions = result.copies()
    if number:
        say(f"{counted(number, 'input')} move exactly as others do: they find their copies")
    for i, j in contradictions[:_SHOWN]:
        say(f"  {data.names[i]} is called {data.labels[i]}, and its copy {data.names[j]} {data.labels[j]}")
    if len(contradictions) > _SHOWN:
        say(f"  … and {len(contradictions) - _SHOWN} more pairs of two labels")
