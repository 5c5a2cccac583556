"""The methods of the paper's related work, each by its settings, on every set.

    python benchmarks/surveyed.py [--shared FOLDER] [--sets NAME ...] [--methods NAME ...]

The nearest example decides in all of them, or the nearest of one prototype a class, so that distances are
compared and not decisions. Protocols are those of benchmarks/classifiers.py. What is learned (weights after
Rwigema et al. 2019, bands, prototypes) is learned for each fold from its examples alone; bands and averages
need more than two of a class, and are left out of that protocol.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from classifiers import SETS, folds
from datasets import Item, arguments
from evaluate import labelled

from gesture_core.classify.classifiers import learn
from gesture_core.classify.comparison import parts
from gesture_core.classify.decision import votes_of
from gesture_core.classify.evaluation import compare_all
from gesture_core.dtw import BandMask, DtwSpec, barycenter, warping_distances
from gesture_core.settings import Settings, load_settings
from gesture_core.types import Signals

JOINTS = "signals.filters=gaussian,resample,center"
Series = Sequence[Signals]
GRID, SHORTEST = 16, 4
"""Rows and columns of a learned band before it is stretched, and rows that are changed together at least."""
WIDTHS = (1, 2, 4, GRID)
ITERATIONS = 5
"""Rounds of averaging."""
PLAIN = (
    "signals.normalizer=torso", "signals.selector=moving", "signals.repair=true", "dtw.mode=dependent",
    "dtw.cost=squared", "dtw.reduce=sum", "gaussian.sigma=0", "gaussian.seconds=0.033",
)  # fmt: skip
"""One path for all joints, from the paper's preset."""
MEDOID = "the medoid of each class"
DBA = "the average of each class by DBA (Petitjean et al. 2011)"
SOFT = "the average of each class by soft-DTW (Cuturi and Blondel 2017)"
BANDS = "a band learned for each class (Ratanamahatana and Keogh 2004)"
EVOLVED = "weights by differential evolution (after Rwigema et al. 2019)"
METHODS: dict[str, tuple[str, ...]] = {
    "the paper (Schneider et al. 2019)": (),
    "dependent DTW on joints": (*PLAIN, JOINTS),
    "one DTW a joint": (*PLAIN, JOINTS, "classify.separate=true"),
    "D-DTW (Keogh and Pazzani 2001)": (
        *PLAIN, "signals.filters=gaussian,resample,channels", "channels.kinds=[\"velocity\"]",
    ),
    "MD-DTW with derivative (ten Holt et al. 2007)": (
        *PLAIN, "signals.filters=gaussian,resample,channels", "channels.kinds=[\"value\", \"velocity\"]",
        "channels.scale=channel", "dtw.cost=absolute",
    ),
    "weighted by variance (after Celebi et al. 2013)": (
        *PLAIN, JOINTS, "classify.separate=true", "classify.balance=true",
    ),
    EVOLVED: (*PLAIN, JOINTS, "classify.separate=true"),
    "shapeDTW (Zhao and Itti 2018)": (*PLAIN, "signals.filters=gaussian,resample,center,shape"),
    "band of 10 % (Sakoe and Chiba 1978)": (
        *PLAIN, JOINTS, "dtw.window=0.1",
    ),
    BANDS: (*PLAIN, JOINTS),
    MEDOID: (*PLAIN, JOINTS, "classify.representative=true"),
    DBA: (*PLAIN, JOINTS),
    SOFT: (*PLAIN, JOINTS, "dtw.gamma=0.01"),
    "soft-DTW (Cuturi and Blondel 2017)": (
        *PLAIN, JOINTS, "dtw.gamma=0.01",
    ),
    "modern, the nearest example": ("preset=modern", "classify.neighbors=1", "classify.reject=none"),
}  # fmt: skip


def by_joint(items: Sequence[Item], settings: Settings) -> np.ndarray:
    """(J, N, N) what each joint adds to the distances of one path a joint."""
    data = labelled(items, settings)
    channels = next(one.channels for one in data.poses if isinstance(one, Signals))
    tables = []
    for joint in parts(channels, settings):
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

    def cost(weights: np.ndarray) -> float:
        total = np.tensordot(weights, tables, 1) + itself
        near = np.where(own, total, np.inf).min(axis=1)
        far = np.where(own, np.inf, total).min(axis=1)
        leads = far > near
        shares = np.divide(near, near + far, out=np.ones(len(near)), where=leads)
        return float((~leads).mean() + 0.1 * shares.mean())

    found = differential_evolution(
        cost,
        [(0, 1)] * len(tables),
        x0=np.full(len(tables), 0.5),
        popsize=4,
        maxiter=30,
        seed=0,
        polish=False,
    )
    return np.asarray(found.x)


def missed(distances: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """(N,) bool: which of the examples with (N, N) ``distances`` are nearest to one of another class."""
    total = distances + np.where(np.eye(len(codes), dtype=bool), np.inf, 0.0)
    own = codes[:, None] == codes
    wrong: np.ndarray = np.where(own, np.inf, total).min(axis=1) <= np.where(own, total, np.inf).min(axis=1)
    return wrong


def banded(queries: Series, examples: Series, spec: DtwSpec, reach: np.ndarray) -> np.ndarray:
    """(Q, N) distances inside a band that reaches so far from the diagonal in each row of a coarse grid."""
    places = np.arange(GRID)
    cells = np.abs(places[:, None] - places) <= reach[:, None]
    return warping_distances(queries, examples, spec.replace(mask=BandMask.of(cells)))


def learned_bands(series: Series, codes: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """(C, GRID) reach of the band of each class, by hill climbing on the examples, each left out in turn.

    From the best band of one width, that of one class after the other is widened or narrowed, whole, then
    by halves, quarters and so on; what misses fewer examples stays and is tried again.
    """
    classes = int(codes.max()) + 1
    members = [[series[i] for i in np.flatnonzero(codes == code)] for code in range(classes)]
    best, within, reach = len(codes) + 1, np.empty((0, 0)), np.empty((0, 0))
    for width in WIDTHS:
        found = banded(series, series, spec, np.full(GRID, width))
        wrong = int(missed(found, codes).sum())
        if wrong < best:
            best, within, reach = wrong, found, np.full((classes, GRID), width)
    for code in range(classes):
        waiting = deque([slice(0, GRID)])
        while waiting:
            part = waiting.popleft()
            for step in (1, -1):
                tried = reach[code].copy()
                tried[part] = np.clip(tried[part] + step, 1, GRID)
                found = within.copy()
                found[:, codes == code] = banded(series, members[code], spec, tried)
                wrong = int(missed(found, codes).sum())
                if wrong < best:
                    best, within, reach[code] = wrong, found, tried
                    waiting.append(part)
                    break
            else:
                middle = (part.start + part.stop) // 2
                if part.stop - part.start > SHORTEST:
                    waiting.extend([slice(part.start, middle), slice(middle, part.stop)])
    return reach


def by_bands(known: Series, codes: np.ndarray, asked: Series, spec: DtwSpec) -> np.ndarray:
    """(Q,) class of the nearest example, each inside the band of its class."""
    nearest = []
    for code, reach in enumerate(learned_bands(known, codes, spec)):
        own = [known[i] for i in np.flatnonzero(codes == code)]
        nearest.append(banded(asked, own, spec, reach).min(axis=1))
    return np.argmin(nearest, axis=0)


def by_averages(known: Series, codes: np.ndarray, asked: Series, spec: DtwSpec) -> np.ndarray:
    """(Q,) class of the nearest average; every channel counts, and one that is not there is zero."""
    arrays, queries = (
        [np.where(np.asarray(one.present), one.values, 0.0) for one in some] for some in (known, asked)
    )
    averages = [
        barycenter([arrays[i] for i in np.flatnonzero(codes == code)], spec, iterations=ITERATIONS)
        for code in range(int(codes.max()) + 1)
    ]
    winners: np.ndarray = warping_distances(queries, averages, spec).argmin(axis=1)
    return winners


LEARNED: dict[str, Callable[[Series, np.ndarray, Series, DtwSpec], np.ndarray]] = {
    BANDS: by_bands,
    DBA: by_averages,
    SOFT: by_averages,
}
"""What no setting does: (Q,) winning classes."""


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
            series = [one for one in compared.of(np.arange(len(codes))) if isinstance(one, Signals)]
            for protocol, examples, queries in folds(subjects, codes):
                right.setdefault(protocol, [])
                if method in LEARNED:
                    if protocol == "two of each class":
                        continue
                    known, asked = ([series[i] for i in some] for some in (examples, queries))
                    winners = LEARNED[method](known, codes[examples], asked, settings.dtw)
                else:
                    if tables is not None:
                        among = tables[(slice(None), *np.ix_(examples, examples))]
                        within = np.tensordot(evolved(among, codes[examples]), tables, 1)
                    block = within[np.ix_(examples, examples)]
                    kept, _, fitted = learn(settings, (), codes[examples], len(classes), block)
                    winners = votes_of(fitted, within[np.ix_(queries, examples[kept])]).winners
                right[protocol].extend((winners == codes[queries]).tolist())
            cells = [f"{100 * np.mean(found):.1f}" if found else "-" for found in right.values()]
            print(f"| {method} | {key} | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
