"""What corrections bring: the least certain clips are answered, and become examples.

``python benchmarks/corrections.py`` takes one subject of body_gesture (landmarks) as examples, three clips of
each of 15 gestures, and the others' 180 clips as a run. The 10, 20 and 50 least certain get their true label,
as in ``gesture review``; those that `corrections.choose` takes, and for comparison all of them, join the
examples. Accuracy is that of the 130 clips that nobody ever answers, so that all columns are about the same.
"""

from __future__ import annotations

import numpy as np
from datasets import arguments, body_gesture

from gesture_core.classify.comparison import compare
from gesture_core.classify.recognizer import Recognizer
from gesture_core.run.review import choose
from gesture_core.settings import load_settings
from gesture_core.signals.chain import Chain

COUNTS = (10, 20, 50)


def main() -> None:
    parser = arguments(__doc__ or "")
    parser.add_argument("--preset", default="modern")
    given = parser.parse_args()
    settings = load_settings(given.preset)
    items = body_gesture(given.shared)
    chain = Chain.from_settings(settings)
    signals = [chain(item.pose) for item in items]
    labels = [item.label for item in items]
    rows: list[list[tuple[float, int]]] = []
    for subject in sorted({item.subject for item in items}):
        known = [i for i, item in enumerate(items) if item.subject == subject]
        run = [i for i, item in enumerate(items) if item.subject != subject]
        rows.append(of_one(known, run, signals, labels, settings))
        print(subject, "  ".join(f"{share:6.1%} ({added:2d})" for share, added in rows[-1]), flush=True)
    means = np.mean(rows, axis=0)
    print("mean", "  ".join(f"{share:6.1%} ({added:4.1f})" for share, added in means))
    print("no corrections, then for", COUNTS, "answers: the chosen ones, all of them (examples added)")


def of_one(known, run, signals, labels, settings):  # type: ignore[no-untyped-def]
    """Accuracy and examples added: without corrections, then for each count the chosen ones and all."""
    recognizer = Recognizer.fit(settings, [signals[i] for i in known], [labels[i] for i in known])
    predicted = recognizer.predictions(of(signals, run))
    margins = [p.margin if p.margin is not None else np.inf for p in predicted]
    order = np.argsort(margins, kind="stable")
    tested = [run[i] for i in order[max(COUNTS) :]]
    found = [(accuracy(known, [], tested, signals, labels, settings), 0)]
    distances = recognizer.distances(of(signals, run))
    for count in COUNTS:
        answered = [run[i] for i in order[:count]]
        new = compare(of(signals, run), of(signals, answered), settings)
        said = [p.label or "" for p in predicted]
        chosen = choose(distances, said, new, of(labels, answered), order[:count].tolist())
        for added in ([answered[c] for c in chosen], answered):
            found.append((accuracy(known, added, tested, signals, labels, settings), len(added)))
    return found


def accuracy(known, added, tested, signals, labels, settings):  # type: ignore[no-untyped-def]
    """Share of ``tested`` that get their label from the examples and what was added to them."""
    library = [*known, *added]
    recognizer = Recognizer.fit(settings, of(signals, library), of(labels, library))
    predicted = [prediction.label for prediction in recognizer.predictions(of(signals, tested))]
    return float(np.mean([one == labels[i] for one, i in zip(predicted, tested, strict=True)]))


def of(values, places):  # type: ignore[no-untyped-def]
    """The values at some places."""
    return [values[i] for i in places]


if __name__ == "__main__":
    main()
