"""The methods of the paper's related work, each by its settings, on every set.

    python benchmarks/surveyed.py [--shared FOLDER] [--sets NAME ...] [--methods NAME ...]

The nearest example decides in all of them, so that distances are compared and not decisions. Protocols are
those of benchmarks/classifiers.py. The weights after Rwigema et al. (2019) are found for each fold on its
examples alone.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from classifiers import SETS, folds
from datasets import Item, arguments
from evaluate import labelled

from gesture_core.classify.classifiers import learn
from gesture_core.classify.comparison import parts
from gesture_core.classify.decision import votes_of
from gesture_core.classify.evaluation import compare_all
from gesture_core.settings import Settings, load_settings
from gesture_core.types import Signals

PLAIN = (
    "signals.normalizer=torso", "signals.selector=moving", "signals.repair=true", "dtw.mode=dependent",
    "dtw.cost=squared", "dtw.reduce=sum", "gaussian.sigma=0", "gaussian.seconds=0.033",
)  # fmt: skip
"""One path for all joints, from the paper's preset."""
EVOLVED = "weights by differential evolution (after Rwigema et al. 2019)"
METHODS: dict[str, tuple[str, ...]] = {
    "the paper (Schneider et al. 2019)": (),
    "dependent DTW on joints": (*PLAIN, "signals.filters=gaussian,resample,center"),
    "one DTW a joint": (*PLAIN, "signals.filters=gaussian,resample,center", "classify.separate=true"),
    "D-DTW (Keogh and Pazzani 2001)": (
        *PLAIN, "signals.filters=gaussian,resample,channels", "channels.kinds=[\"velocity\"]",
    ),
    "MD-DTW with derivative (ten Holt et al. 2007)": (
        *PLAIN, "signals.filters=gaussian,resample,channels", "channels.kinds=[\"value\", \"velocity\"]",
        "channels.scale=channel", "dtw.cost=absolute",
    ),
    "weighted by variance (after Celebi et al. 2013)": (
        *PLAIN, "signals.filters=gaussian,resample,center", "classify.separate=true", "classify.balance=true",
    ),
    EVOLVED: (*PLAIN, "signals.filters=gaussian,resample,center", "classify.separate=true"),
    "shapeDTW (Zhao and Itti 2018)": (*PLAIN, "signals.filters=gaussian,resample,center,shape"),
    "band of 10 % (Sakoe and Chiba 1978)": (
        *PLAIN, "signals.filters=gaussian,resample,center", "dtw.window=0.1",
    ),
    "soft-DTW (Cuturi and Blondel 2017)": (
        *PLAIN, "signals.filters=gaussian,resample,center", "dtw.gamma=0.01",
    ),
    "modern, the nearest example": ("preset=modern", "classify.neighbors=1", "classify.reject=none"),
}  # fmt: skip


def by_joint(items: Sequence[Item], settings: Settings) -> np.ndarray:
    """(J, N, N) what each joint adds to the distances of one path a joint."""
    data = labelled(items, settings)
    channels = next(one.channels for one in data.poses if isinstance(one, Signals))
    tables = []
    for joint in parts(channels):
        alone = settings.with_values([("classify.weights", ("*=0", f"{joint}=1"))])
        tables.append(compare_all(data, alone).within)
    return np.array(tables)


def evolved(tables: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """(J,) weights under which most of the examples are nearest to one of their own class.

    Equal ones are among the first that are tried. Of as many right, those with the larger margins are better.
    """
    from scipy.optimize import differential_evolution

    own = codes[:, None] == codes
    itself = np.where(np.eye(len(codes), dtype=bool), np.inf, 0.0)

    def missed(weights: np.ndarray) -> float:
        total = np.tensordot(weights, tables, 1) + itself
        near = np.where(own, total, np.inf).min(axis=1)
        far = np.where(own, np.inf, total).min(axis=1)
        return float((near >= far).mean() + 0.1 * (near / (near + far)).mean())

    found = differential_evolution(
        missed,
        [(0, 1)] * len(tables),
        x0=np.full(len(tables), 0.5),
        popsize=4,
        maxiter=30,
        seed=0,
        polish=False,
    )
    return np.asarray(found.x)


def main() -> int:
    """Print the table."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument(
        "--sets", nargs="+", default=["utd_openpose", "body_gesture", "utkinect", "utd_skeleton"]
    )
    parser.add_argument("--methods", nargs="+", default=list(METHODS), help="parts of their names")
    given = parser.parse_args()
    print(
        "| method | set | " + " | ".join(("all other people", "one other person", "two of each class")) + " |"
    )
    print("|---|---|---|---|---|", flush=True)
    for key in given.sets:
        items = SETS[key](given.shared)
        for method, sets in METHODS.items():
            if not any(part in method for part in given.methods):
                continue
            preset = "modern" if "preset=modern" in sets else "paper"
            settings = load_settings(preset, [s for s in sets if s != "preset=modern"])
            compared = compare_all(labelled(items, settings), settings)
            classes, codes = np.unique(
                [compared.data.labels[i] for i in compared.usable], return_inverse=True
            )
            subjects = np.array([compared.data.subjects[i] for i in compared.usable])
            right: dict[str, list[bool]] = {}
            tables = by_joint(items, settings) if method == EVOLVED else None
            within = compared.within
            for protocol, examples, queries in folds(subjects, codes):
                fitted = learn(settings, (), codes[examples], len(classes))[2]
                if tables is not None:
                    among = tables[(slice(None), *np.ix_(examples, examples))]
                    within = np.tensordot(evolved(among, codes[examples]), tables, 1)
                votes = votes_of(fitted, within[np.ix_(queries, examples)])
                right.setdefault(protocol, []).extend((votes.winners == codes[queries]).tolist())
            cells = [f"{100 * np.mean(found):.1f}" for found in right.values()]
            print(f"| {method} | {key} | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
