"""What `gesture evaluate` leaves behind: pictures, tables, and one JSON file with all numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.classify.scores import Answer, Evaluation
from gesture_core.colours import BY_DISTANCE, BY_MARGIN
from gesture_core.files import replacing
from gesture_core.report.style import new_figure, save


def confusion_plot(evaluation: Evaluation, path: Path) -> Path:
    """The confusion matrix as a picture: rows are the truth, shades the share of the row."""
    columns, counts = evaluation.confusion()
    rows = evaluation.classes
    size = max(4.0, 0.42 * len(columns) + 2.2)
    figure = new_figure(size + 0.6, size * (len(rows) + 3) / (len(columns) + 3) + 0.6)
    axes = figure.add_subplot()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="equal")
    axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xlabel("recognised as")
    axes.set_ylabel("performed")
    font = 9 if len(columns) < 20 else 6
    for (row, column), count in np.ndenumerate(counts):
        if count:
            colour = "white" if shares[row, column] > 0.55 else "black"
            axes.text(column, row, str(count), ha="center", va="center", color=colour, fontsize=font)
    low, high = evaluation.interval
    figure.suptitle(
        f"{evaluation.accuracy:.1%} of {len(evaluation.answers)} (95 %: {low:.1%} to {high:.1%})\n"
        f"{evaluation.protocol}, preset {evaluation.settings.preset}",
        fontsize=10,
    )
    return save(figure, path)


def rejection_plot(evaluation: Evaluation, path: Path) -> Path:
    """Accuracy of the accepted answers over the share that is accepted, by distance and by margin."""
    figure = new_figure(5.2, 3.6)
    axes = figure.add_subplot()
    by_margin, by_distance = evaluation.margin_curve(), evaluation.rejection_curve()
    for curve, colour, name in (
        (by_margin, BY_MARGIN, "by margin"),
        (by_distance, BY_DISTANCE, "by distance"),
    ):
        shares = [100 * c for _, c, _ in curve], [100 * a for _, _, a in curve]
        axes.plot(*shares, color=colour, linewidth=1.8, label=name)
    axes.legend(fontsize=8)
    axes.set_xlabel("coverage: answers that keep their label, %")
    axes.set_ylabel("accuracy of these, %")
    axes.set_xlim(0, 101)
    axes.set_ylim(top=101)
    axes.grid(alpha=0.3)
    axes.set_title(f"what a rejection threshold costs\n{evaluation.protocol}", fontsize=10)
    return save(figure, path)


def summary(evaluation: Evaluation) -> dict[str, Any]:
    """All numbers of an evaluation as plain values, fit for JSON: shares are 0 to 1, nothing is NaN."""
    columns, counts = evaluation.confusion()
    low, high = evaluation.interval
    exact = evaluation.exact_error
    return {
        "preset": evaluation.settings.preset,
        "changes": evaluation.changes,
        "settings": evaluation.settings.as_dict(),
        "protocol": evaluation.protocol,
        "tested": len(evaluation.answers),
        "right": sum(answer.right for answer in evaluation.answers),
        "accuracy": evaluation.accuracy,
        "interval_95": [low, high],
        "folds": evaluation.by_fold,
        "recall": evaluation.recall,
        "confusion": {"rows": evaluation.classes, "columns": columns, "counts": counts.tolist()},
        "coverage_at_distance": [
            {"threshold": t, "coverage": c, "accuracy": a}
            for t, c, a in thinned(evaluation.rejection_curve())
        ],
        "coverage_at_margin": [
            {"margin": m, "coverage": c, "accuracy": a} for m, c, a in thinned(evaluation.margin_curve())
        ],
        "coverage_at_score": [
            {"score": s, "coverage": c, "accuracy": a} for s, c, a in thinned(evaluation.score_curve())
        ],
        "coverage_at_confidence": [
            {"confidence": p, "coverage": c, "accuracy": a}
            for p, c, a in thinned(evaluation.confidence_curve())
        ],
        "expected_calibration_error": evaluation.calibration_error,
        "expected_calibration_error_if_exact": exact and {"mean": exact[0], "quantile_95": exact[1]},
        "not_recognised": [a.name for a in evaluation.answers if a.predicted is None],
    }


def thinned(
    curve: Sequence[tuple[float, float, float]], points: int = 20
) -> list[tuple[float, float, float]]:
    """At most ``points`` of ``curve`` (threshold, coverage, accuracy), evenly spread, its ends included."""
    if len(curve) <= points:
        return list(curve)
    return [curve[i] for i in np.linspace(0, len(curve) - 1, points).round().astype(int)]


def write_evaluation(evaluation: Evaluation, fingerprint: str, folder: Path) -> list[Path]:
    """Write all numbers to ``evaluation.json`` and each answer to ``answers.csv`` in ``folder``.

    Examples
    --------
    >>> from pathlib import Path
    >>> from gesture_core import evaluate_archive
    >>> result = evaluate_archive("examples/", protocol="leave-one-out")
    >>> [path.name for path in write_evaluation(result.best, result.fingerprint, Path("scores"))]
    ['evaluation.json', 'answers.csv']
    """
    from gesture_core.run.export import CsvWriter

    numbers, answers = folder / "evaluation.json", folder / "answers.csv"
    with replacing(numbers) as temporary:
        tree = {"fingerprint": fingerprint} | summary(evaluation)
        text = json.dumps(tree, indent=1, allow_nan=False)
        temporary.write_text(text + "\n", "utf-8")
    columns = (
        "name", "subject", "fold", "label", "predicted", "right", "distance", "margin", "score", "confidence",
        "code",
    )  # fmt: skip
    CsvWriter().write((_record(answer) for answer in evaluation.answers), columns, answers)
    return [numbers, answers]


def draw_evaluation(evaluation: Evaluation, folder: Path) -> list[Path]:
    """Draw ``confusion.png`` in ``folder``, and ``rejection.png`` unless nothing could be compared.

    Raises
    ------
    MissingDependencyError
        Where matplotlib is not installed.
    """
    drawn = [confusion_plot(evaluation, folder / "confusion.png")]
    if evaluation.rejection_curve():
        drawn.append(rejection_plot(evaluation, folder / "rejection.png"))
    return drawn


def _record(answer: Answer) -> dict[str, Any]:
    record = asdict(answer) | {"right": int(answer.right)}
    for key in ("distance", "margin", "score", "confidence"):
        record[key] = f"{record[key]:.6g}" if np.isfinite(record[key]) else None
    return record
