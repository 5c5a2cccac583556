"""The constants of `gesture_core.signals.repair`, chosen with wrong frames in the loss and tested on others.

    python benchmarks/choose_repair.py [--shared FOLDER]

body_gesture's landmarks, each subject by the others. Every constant is varied by itself, and a running median
is tried with the repair and instead of it. The loss of a choice are the clips that are not recognised: whole,
with 2 wrong frames, and with 5, all kinds of benchmarks/damage.py in turn. ``nested`` takes for each subject
what is best among the other four, none of whose examples is of that subject.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from choose import wrong
from datasets import arguments, body_gesture
from stress import _fitted, recognised

from gesture_core.classify.comparison import compare
from gesture_core.settings import Settings, load_settings
from gesture_core.signals import repair
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence, Signals

COUNTS = (2, 5)
CONSTANTS: Mapping[str, Sequence[float]] = {
    "JUMP": (0.2, 0.4),
    "NOISE": (1.5, 4.0),
    "LEAST_SURE": (0.25, 1.0),
    "SWAP": (0.2, 0.45),
    "LONGEST": (0.3, 0.5),
}
MEDIAN = "median,gaussian,resample,parts"


def series(poses: Sequence[PoseSequence], settings: Settings, constant: str, value: float) -> list[Signals]:
    """The signals under one constant."""
    chain = replace(Chain.from_settings(settings), allow_still=True)
    before = getattr(repair, constant) if constant else None
    try:
        if constant:
            setattr(repair, constant, value)
        return [chain(pose) for pose in poses]
    finally:
        if constant:
            setattr(repair, constant, before)


def main() -> int:
    """Print what each choice loses, and the nested figures."""
    given = arguments(__doc__.splitlines()[0]).parse_args()
    items = body_gesture(given.shared)
    versions = {"whole": items} | {f"{n} wrong frames": wrong(items, n) for n in COUNTS}
    codes = np.unique([item.label for item in items], return_inverse=True)[1]
    subjects = np.array([item.subject for item in items])
    people = np.unique(subjects)
    modern = load_settings("modern", environment={}).with_values([("classify.classifier", "weighed")])
    median = modern.with_values([("signals.filters", MEDIAN)])
    choices = {"as shipped": (modern, "", 0.0), "median beside it": (median, "", 0.0)}
    choices["median instead"] = (median.with_values([("signals.repair", "false")]), "", 0.0)
    choices |= {f"{name} {v:g}": (modern, name, v) for name, values in CONSTANTS.items() for v in values}
    inner: dict[str, np.ndarray] = {}
    outer: dict[str, np.ndarray] = {}
    for name, (settings, constant, value) in choices.items():
        found = {
            version: series([i.pose for i in some], settings, constant, value)
            for version, some in versions.items()
        }
        distances = {version: compare(some, found["whole"], settings) for version, some in found.items()}

        def right(version: str, kept: np.ndarray, tables=distances, signals=found, by=settings) -> list[int]:
            """Of each subject in ``kept``, how many are recognised by the others in it."""
            within, table = tables["whole"][np.ix_(kept, kept)], tables[version][np.ix_(kept, kept)]
            examples = [signals["whole"][i] for i in kept]
            fitted = _fitted(within, examples, codes[kept], subjects[kept], by)
            queries, places = [signals[version][i] for i in kept], np.arange(len(kept))
            return [
                recognised(
                    table[own],
                    [queries[i] for i in own],
                    places[own],
                    codes[kept],
                    subjects[kept],
                    {who: one},
                )
                for who, one in fitted.items()
                for own in [np.flatnonzero(subjects[kept] == who)]
            ]

        outer[name] = np.array([right(version, np.arange(len(items))) for version in versions])
        inner[name] = np.array(
            [sum(sum(right(v, np.flatnonzero(subjects != who))) for v in versions) for who in people]
        )
        shares = " ".join(f"{100 * row.sum() / len(items):.1f}" for row in outer[name])
        print(f"{name}: {shares}; inside the others {inner[name].tolist()}", flush=True)
    names = list(choices)
    best = [max(names, key=lambda name: inner[name][place]) for place in range(len(people))]
    nested = sum(outer[name][:, place] for place, name in enumerate(best))
    print(f"nested: {' '.join(f'{100 * right / len(items):.1f}' for right in nested)}; takes {best}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
