"""What ``gesture evaluate`` prints: accuracy, the grid, classes, folds, and what rejection costs."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gesture_core.cli.screen import counted, print_table, visible

if TYPE_CHECKING:
    from gesture_core.classify.evaluation import Compared, Evaluation

_SHOWN = 5


def say_accuracy(evaluation: Evaluation, what: str) -> None:
    """One line: protocol, accuracy, its interval, and ``what`` was evaluated."""
    low, high = evaluation.interval
    right = sum(a.right for a in evaluation.answers)
    print(
        f"{evaluation.protocol}: {right} of {len(evaluation.answers)} right, "
        f"{evaluation.accuracy:.1%} (95 %: {low:.1%} to {high:.1%}); {what}"
    )


def print_grid(found: Sequence[Evaluation]) -> None:
    """One line for each point of a grid."""
    keys = list(found[0].changes)
    rows = []
    for evaluation in found:
        low, high = evaluation.interval
        values = [str(evaluation.changes[key]) for key in keys]
        rows.append([*values, f"{evaluation.accuracy:.1%}", f"{low:.1%} to {high:.1%}"])
    print_table([*keys, "accuracy", "95 %"], rows, right=["accuracy"])


def print_classes(evaluation: Evaluation) -> None:
    """Recall and confusions of each class, accuracy of each fold, accuracy under stricter thresholds."""
    import numpy as np

    from gesture_core.report.evaluation import thinned

    columns, counts = evaluation.confusion()
    rows = []
    for row, (label, recall) in enumerate(evaluation.recall.items()):
        wrong = [(int(counts[row, c]), columns[c]) for c in np.argsort(-counts[row], kind="stable")]
        taken = ", ".join(f"{name} {count}" for count, name in wrong if count and name != label)
        rows.append([label, str(int(counts[row].sum())), f"{recall:.1%}", taken])
    print_table(["class", "tested", "recall", "taken for"], rows, right=["tested", "recall"])
    folds = evaluation.by_fold
    if 1 < len(folds) <= min(40, len(evaluation.answers) - 1):  # a fold of one answer says nothing
        print_table(["fold", "accuracy"], [[n, f"{a:.1%}"] for n, a in folds.items()], right=["accuracy"])
    curves = {"reject above": evaluation.rejection_curve(), "margin from": evaluation.margin_curve()}
    if any(curves.values()):  # otherwise nothing has a label
        print(
            "a stricter threshold labels fewer inputs (coverage), and more of these rightly (accuracy): "
            "--reject VALUE, or --set classify.margin=VALUE"
        )
    for title, curve in curves.items():
        if not curve:
            continue
        columns = [title, "coverage", "accuracy"]
        cells = [[f"{t:.4g}", f"{c:.1%}", f"{a:.1%}"] for t, c, a in thinned(curve, 8)]
        print_table(columns, cells, right=columns)


def changes_of(changes: Mapping[str, Any]) -> str:
    """A point of a grid as text, with a comma in front."""
    return "".join(f", {key}={value}" for key, value in changes.items())


def choices_of(choices: Mapping[str, int], points: Sequence[Mapping[str, Any]]) -> str:
    """Which point of the grid each subject's fold took."""
    return "; ".join(f"{who or '-'}:{changes_of(points[index])[1:]}" for who, index in choices.items())


def say_unusable(compared: Compared) -> None:
    """Which inputs could not be compared, and why; they count as not recognised."""
    errors = compared.errors
    if not errors:
        return
    total = len(compared.data.names)
    print(f"{len(errors)} of {counted(total, 'input')} count as not recognised:", file=sys.stderr)
    for index, error in list(errors.items())[:_SHOWN]:
        print(f"  {error.code} {visible(error.about(compared.data.names[index]).message)}", file=sys.stderr)
    if len(errors) > _SHOWN:
        print(f"  … and {len(errors) - _SHOWN} more: answers.csv of --out has all", file=sys.stderr)


def say_copies(compared: Compared) -> None:
    """Which inputs are at no distance from another one: the same clip twice, under other names or labels."""
    import numpy as np

    alike = np.triu(compared.within == 0, 1)
    copies = int((alike | alike.T).any(axis=0).sum())
    if not copies:
        return
    print(f"{counted(copies, 'input')} move exactly as others do: they find their copies", file=sys.stderr)
    data = compared.data
    codes = np.unique(np.array(data.labels)[compared.usable], return_inverse=True)[1]
    wrong = np.argwhere(alike & (codes[:, None] != codes))
    for i, j in compared.usable[wrong[:_SHOWN]].tolist():
        text = f"  {data.names[i]} is called {data.labels[i]}, and its copy {data.names[j]} {data.labels[j]}"
        print(visible(text), file=sys.stderr)
    if len(wrong) > _SHOWN:
        print(f"  … and {len(wrong) - _SHOWN} more pairs of two labels", file=sys.stderr)
