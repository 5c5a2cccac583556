"""The classifiers on every set, by protocol, and what happens to gestures that are not among the examples.

    python benchmarks/classifiers.py [--shared FOLDER] [--sets NAME ...] [--classifiers NAME ...] [--open-set]

Distances are computed once for each set under `modern`; each classifier takes its part of them. Besides the
accuracy, the clips won and lost against the first classifier; a dash where it asks for more examples.
Protocols: every other person's clips are examples; all clips of one other person; two clips of each class
from the others, drawn five times. No constant of this project but the deviation of `recurrent` was chosen
with MSRC-12, which is cut here from halfway to the mark before to halfway to the next one, two seconds at
most.

``--open-set`` leaves each class out of the examples in turn: how well margin and distance tell its clips
from those of the known classes (area under the curve), and how many are refused where 95 % of the right
labels are kept.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from datasets import Item, arguments, body_gesture, pose_trainer, utd_openpose, utd_skeleton
from evaluate import labelled
from strings import cut, msrc12, utkinect

from gesture_core.classify.classifiers import learn
from gesture_core.classify.decision import votes_of
from gesture_core.classify.evaluation import Compared, compare_all
from gesture_core.errors import InputError
from gesture_core.settings import load_settings

NAMES = ("weighed", "nearest", "rocket", "blend")
KEPT = 0.95


def msrc12_clips(shared: Path) -> list[Item]:
    """Clips around the action points of MSRC-12: 12 gestures by five people."""
    items = []
    for recording in msrc12(shared)[0]:
        pose, gesture = recording.pose, recording.truth[0][0]
        points = sorted(point for _, point, _ in recording.truth)
        middles = [-np.inf, *((a + b) / 2 for a, b in pairwise(points)), np.inf]
        for index, point in enumerate(points):
            start, end = max(point - 2, middles[index]), min(point + 2, middles[index + 1])
            clip = cut(pose, start, end, f"{pose.source}_{index}")
            if len(clip) >= 8:
                items.append(Item(clip, gesture, recording.subject, clip.source))
    return items


SETS: dict[str, Callable[[Path], list[Item]]] = {
    "msrc12": msrc12_clips,
    "utkinect": lambda shared: utkinect(shared)[1],
    "utd_skeleton": utd_skeleton,
    "body_gesture": body_gesture,
    "utd_openpose": utd_openpose,
    "pose_trainer": pose_trainer,
}


def folds(subjects: np.ndarray, codes: np.ndarray) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Protocol, examples and queries."""
    known = np.unique(subjects)
    for number, who in enumerate(known):
        own, others = np.flatnonzero(subjects == who), np.flatnonzero(subjects != who)
        yield "all other people", others, own
        if len(np.unique(codes[own])) == len(np.unique(codes)):
            yield "one other person", own, others
        for draw in range(5):
            random = np.random.default_rng(10 * number + draw)
            chosen = [random.permutation(others[codes[others] == c])[:2] for c in np.unique(codes)]
            yield "two of each class", np.sort(np.concatenate(chosen)), own


def compared_by(compared: Compared, names: list[str]) -> dict[str, dict[str, list[bool]]]:
    """Whether each query is recognised, by protocol and classifier."""
    classes, codes = np.unique([compared.data.labels[i] for i in compared.usable], return_inverse=True)
    subjects = np.array([compared.data.subjects[i] for i in compared.usable])
    found: dict[str, dict[str, list[bool]]] = {}
    for protocol, examples, queries in folds(subjects, codes):
        for name in names:
            settings = load_settings("modern", classify__classifier=name)
            among, known = compared.within[np.ix_(examples, examples)], compared.of(examples)
            so_far = found.setdefault(protocol, {}).setdefault(name, [])
            try:
                fitted = learn(settings, known, codes[examples], len(classes), among)[2]
            except InputError as error:
                if error.code != "E_EXAMPLES":
                    raise
                continue  # fewer of a class than it needs
            votes = votes_of(fitted, compared.within[np.ix_(queries, examples)], compared.of(queries))
            so_far.extend((votes.winners == codes[queries]).tolist())
    return found


def strangers(compared: Compared, name: str) -> dict[str, tuple[float, float]]:
    """Of the margin, the distance and both: area under the curve, and the share that is refused."""
    labels = np.array([compared.data.labels[i] for i in compared.usable])
    subjects = np.array([compared.data.subjects[i] for i in compared.usable])
    settings = load_settings("modern", classify__classifier=name)
    signs = {"margin": 1.0, "distance": -1.0, "margin over distance": 1.0, "score of the winner": 1.0}
    known: dict[str, list[float]] = {key: [] for key in signs}
    unknown: dict[str, list[float]] = {key: [] for key in signs}
    for gone in np.unique(labels):
        for who in np.unique(subjects):
            examples = np.flatnonzero((subjects != who) & (labels != gone))
            queries = np.flatnonzero(subjects == who)
            classes, codes = np.unique(labels[examples], return_inverse=True)
            among, series = compared.within[np.ix_(examples, examples)], compared.of(examples)
            fitted = learn(settings, series, codes, len(classes), among)[2]
            votes = votes_of(fitted, compared.within[np.ix_(queries, examples)], compared.of(queries))
            values = {"margin": votes.margins, "distance": votes.distances}
            values["margin over distance"] = votes.margins / np.maximum(votes.distances, 1e-9)
            values["score of the winner"] = votes.scores.max(axis=1)
            right = classes[votes.winners] == labels[queries]
            for key, value in values.items():
                known[key] += (signs[key] * value[right]).tolist()
                unknown[key] += (signs[key] * value[labels[queries] == gone]).tolist()
    found = {}
    for key in signs:
        right, wrong = np.sort(known[key]), np.array(unknown[key])
        below = np.searchsorted(right, wrong, "left") + np.searchsorted(right, wrong, "right")
        limit = np.quantile(right, 1 - KEPT)
        found[key] = 1 - float(below.mean()) / (2 * len(right)), float((wrong < limit).mean())
    return found


def main() -> int:
    """Print the tables."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument(
        "--sets", nargs="+", default=[name for name in SETS if name != "pose_trainer"], choices=SETS
    )
    parser.add_argument("--classifiers", nargs="+", default=list(NAMES))
    parser.add_argument("--open-set", action="store_true")
    given = parser.parse_args()
    names = given.classifiers
    settings = load_settings("modern")
    heads = ["set", "classifier", "of", "area", "refused"] if given.open_set else ["set", "examples", *names]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for key in given.sets:
        compared = compare_all(labelled(SETS[key](given.shared), settings), settings)
        compared = replace(compared, still=None)
        if given.open_set:
            for name in names:
                for value, (area, refused) in strangers(compared, name).items():
                    print(f"| {key} | {name} | {value} | {area:.2f} | {100 * refused:.0f} % |", flush=True)
            continue
        for protocol, right in compared_by(compared, names).items():
            first, cells = np.array(right[names[0]]), []
            for name in names:
                own = np.array(right[name])
                if len(own) < len(first):
                    cells.append("-")
                    continue
                won, lost = int((own & ~first).sum()), int((first & ~own).sum())
                cells.append(f"{100 * own.mean():.1f}" + (f" (+{won}, -{lost})" if name != names[0] else ""))
            print(f"| {key} | {protocol} | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
