"""What other libraries take: runs in an environment of its own (see benchmarks/kernels.py).

    python peers.py INPUT.npz

Prints JSON: for each task and library, CPU-seconds for each pair (the median of several runs, after
a warm-up) and a few distances, so that the caller can see that the same thing was computed.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version

import numpy as np

warnings.filterwarnings("ignore")
RUNS = 5


def seconds_each(compute: Callable[[], object], count: int) -> float:
    """CPU-seconds for each of ``count`` pairs."""
    compute()
    runs = []
    for _ in range(RUNS):
        start = time.process_time()
        compute()
        runs.append(time.process_time() - start)
    return statistics.median(runs) / count


def one_dimension(a: np.ndarray, b: np.ndarray) -> dict[str, tuple[float, float]]:
    """(Q, T) against (N, T): squared cost, each library's fastest way to a whole table."""
    from aeon.distances import dtw_pairwise_distance
    from dtaidistance import dtw
    from fastdtw import fastdtw
    from tslearn.metrics import cdist_dtw

    count = len(a) * len(b)
    both = np.concatenate([a, b]).astype(np.float64)
    block = ((0, len(a)), (len(a), len(both)))
    fast = {"block": block, "compact": True, "parallel": False, "use_c": True}
    return {
        "aeon": (
            seconds_each(lambda: dtw_pairwise_distance(a[:, None], b[:, None]), count),
            float(np.sqrt(dtw_pairwise_distance(a[:1, None], b[:1, None])[0, 0])),
        ),
        "dtaidistance": (
            seconds_each(lambda: dtw.distance_matrix(both, **fast), count),
            float(dtw.distance_fast(a[0].astype(float), b[0].astype(float))),
        ),
        "tslearn": (
            seconds_each(lambda: cdist_dtw(a[:24], b[:24], n_jobs=1), 24 * 24),
            float(cdist_dtw(a[:1], b[:1])[0, 0]),
        ),
        "fastdtw": (seconds_each(lambda: [fastdtw(x, b[0], 1) for x in a[:3]], 3), float("nan")),
    }


def several_dimensions(a: np.ndarray, b: np.ndarray) -> dict[str, tuple[float, float]]:
    """(Q, T, D) against (N, T, D), all dimensions together, squared cost."""
    from aeon.distances import dtw_pairwise_distance
    from dtaidistance import dtw_ndim
    from tslearn.metrics import cdist_dtw

    count = len(a) * len(b)
    x, y = (np.ascontiguousarray(side.transpose(0, 2, 1)) for side in (a, b))
    pairs = [(p.astype(float), q.astype(float)) for p in a[:12] for q in b[:12]]
    return {
        "aeon": (
            seconds_each(lambda: dtw_pairwise_distance(x, y), count),
            float(np.sqrt(dtw_pairwise_distance(x[:1], y[:1])[0, 0])),
        ),
        "dtaidistance": (
            seconds_each(lambda: [dtw_ndim.distance_fast(p, q) for p, q in pairs], len(pairs)),
            float(dtw_ndim.distance_fast(*pairs[0])),
        ),
        "tslearn": (
            seconds_each(lambda: cdist_dtw(a[:12], b[:12], n_jobs=1), 144),
            float(cdist_dtw(a[:1], b[:1])[0, 0]),
        ),
    }


def paper(pairs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict[str, tuple[float, float]]:
    """Ragged pairs, one call for each selected dimension, each library's fastest call."""
    from aeon.distances import dtw_distance
    from dtaidistance import dtw

    def each(call: Callable[[np.ndarray, np.ndarray], float]) -> None:
        for x, y, use in pairs:
            for d in np.flatnonzero(use):
                call(x[d], y[d])

    return {
        "aeon": (seconds_each(lambda: each(dtw_distance), len(pairs)), float("nan")),
        "dtaidistance": (seconds_each(lambda: each(dtw.distance_fast), len(pairs)), float("nan")),
    }


def soft(a: np.ndarray, b: np.ndarray, gamma: float) -> dict[str, tuple[float, float]]:
    """Value and gradient of (P, T, D) pairs."""
    from tslearn.metrics import SoftDTW, SquaredEuclidean

    def one(x: np.ndarray, y: np.ndarray) -> float:
        distance = SquaredEuclidean(x, y)
        table = SoftDTW(distance, gamma=gamma)
        value = table.compute()
        distance.jacobian_product(table.grad())
        return float(value)

    return {
        "tslearn": (
            seconds_each(lambda: [one(x, y) for x, y in zip(a, b, strict=True)], len(a)),
            one(a[0], b[0]),
        )
    }


def subsequence(query: np.ndarray, stream: np.ndarray) -> dict[str, tuple[float, float]]:
    """Where in (T, D) a query (m, D) is: the table that each library looks for it in, and its least distance.

    stumpy compares windows without warping, channel by channel.
    """
    import stumpy
    from dtaidistance.subsequence.dtw import subsequence_alignment
    from tslearn.metrics import subsequence_cost_matrix

    def aligned() -> np.ndarray:
        alignment = subsequence_alignment(query, stream, penalty=0, use_c=True)
        alignment.align()
        return np.asarray(alignment.matching_function()) * len(query)

    channels = [np.ascontiguousarray(side.T) for side in (query, stream)]
    return {
        "dtaidistance": (seconds_each(aligned, 1), float(aligned().min())),
        "tslearn": (
            seconds_each(lambda: subsequence_cost_matrix(query, stream), 1),
            float(np.sqrt(subsequence_cost_matrix(query, stream)[-1].min())),
        ),
        "stumpy.mass, by channel": (
            seconds_each(lambda: [stumpy.mass(q, t) for q, t in zip(*channels, strict=True)], 1),
            float("nan"),
        ),
    }


def main(path: str) -> None:
    """Run the tasks that the arrays of ``path`` name."""
    data = np.load(path)
    count = int(data["paper_count"])
    pairs = [tuple(data[f"paper_{i}_{part}"] for part in ("x", "y", "use")) for i in range(count)]
    tasks: dict[str, Callable[[], dict[str, tuple[float, float]]]] = {
        "one": lambda: one_dimension(data["one_a"], data["one_b"]),
        "several": lambda: several_dimensions(data["several_a"], data["several_b"]),
        "paper": lambda: paper(pairs),  # type: ignore[arg-type]
        "soft": lambda: soft(
            data["soft_a"].astype(float), data["soft_b"].astype(float), float(data["gamma"])
        ),
        "subsequence": lambda: subsequence(data["query"].astype(float), data["stream"].astype(float)),
    }
    libraries = ("aeon", "tslearn", "dtaidistance", "fastdtw", "stumpy", "numpy")
    out: dict[str, object] = {name: run() for name, run in tasks.items() if name in data["tasks"]}
    print(json.dumps(out | {"versions": {name: version(name) for name in libraries}}))


if __name__ == "__main__":
    main(sys.argv[1])
