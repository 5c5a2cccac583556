"""What many examples cost: fit, memory, queries and accuracy with 100, 1,000 and 10,000 of them.

    python benchmarks/library.py [--shared FOLDER] [--counts 100 1000 10000] [--set KEY=VALUE …]

The examples are clips of subjects 1 to 3 of utd_skeleton (27 actions), each repeated with another tempo, size
and noise; the queries are 100 clips of subject 4. Times are CPU seconds of the whole process.
"""

from __future__ import annotations

import resource
import time

import numpy as np
from datasets import Item, arguments, utd_skeleton
from environment import header

from gesture_core import load_settings
from gesture_core.classify.recognizer import Recognizer, signals_of
from gesture_core.types import PoseSequence

QUERIES = 100


def altered(item: Item, random: np.random.Generator) -> PoseSequence:
    """The same movement by somebody else: another tempo from moment to moment, another size, noise."""
    points, times = item.pose.keypoints, item.pose.times
    frames = max(12, int(len(points) * random.uniform(0.75, 1.3)))
    steps = np.cumsum(random.uniform(0.5, 1.5, frames))
    places = (steps - steps[0]) / (steps[-1] - steps[0]) * (len(points) - 1)
    warped = points[np.minimum(places.round().astype(int), len(points) - 1)] * random.uniform(0.85, 1.15)
    warped = warped + random.normal(0, 0.004, warped.shape)
    scores = np.ones(warped.shape[:2])
    return PoseSequence(warped, scores, times[0] + np.arange(frames) / 30.0, source=item.name)


def main() -> None:
    """Print a row for each number of examples."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--counts", nargs="+", type=int, default=[100, 1000, 10_000])
    parser.add_argument("--set", nargs="*", default=[], help="settings, as of gesture classify")
    given = parser.parse_args()
    settings = load_settings(None, given.set)
    items = utd_skeleton(given.shared)
    known = [item for item in items if item.subject != "s4"]
    asked = [item for item in items if item.subject == "s4"][:QUERIES]
    queries = signals_of([item.pose for item in asked], settings, "query")
    header()
    print("| examples | compared with | fit, CPU s | peak MiB | queries a CPU second | right |")
    print("|---|---|---|---|---|---|", flush=True)
    for count in given.counts:
        random = np.random.default_rng(0)
        order = [random.permutation(len(known)) for _ in range(count // len(known) + 1)]
        chosen = [known[i] for i in np.concatenate(order)[:count]]
        poses = [altered(item, random) for item in chosen]
        series = signals_of(poses, settings, "example")
        started = time.process_time()
        fitted = Recognizer.fit(settings, series, [item.label for item in chosen])
        fit = time.process_time() - started
        started = time.process_time()
        found = fitted.predictions(queries)
        rate = len(queries) / (time.process_time() - started)
        right = np.mean([one.label == item.label for one, item in zip(found, asked, strict=True)])
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        print(
            f"| {count:,} | {len(fitted.library)} | {fit:.1f} | {peak} | {rate:.0f} | {100 * right:.0f} % |",
            flush=True,
        )


if __name__ == "__main__":
    main()
