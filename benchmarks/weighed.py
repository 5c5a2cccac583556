"""All examples deciding against the nearest one on public sets that the constants were not chosen on.

    python benchmarks/weighed.py [SHARED]

The four UCR and four UEA sets of benchmarks/published.py with their published distances (dependent
where there are several dimensions), train and test as given, sharpness and shrinkage as by default.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from environment import header
from published import HERE, SPECS, UNIVARIATE, WINDOWS, read

from gesture_core.classify.decision import votes_of
from gesture_core.classify.learning import learn_weights
from gesture_core.dtw.distances import warping_distances
from gesture_core.settings import ClassifySettings

SETS = [("UCR", name) for name in WINDOWS]
SETS += [("UEA", name) for name in ("BasicMotions", "JapaneseVowels", "Libras", "NATOPS")]


def accuracies(archive: str, name: str, data: Path) -> tuple[float, float]:
    """Accuracy by the nearest example and by all of them."""
    train, known, test, wanted = read(archive, name, data)
    spec = UNIVARIATE if archive == "UCR" else SPECS["accuracy_dtw_d"]
    classes, codes = np.unique(known, return_inverse=True)
    distances, chosen = warping_distances(test, train, spec), ClassifySettings()
    within = warping_distances(train, train, spec)
    weights = learn_weights(within, codes, len(classes), chosen.sharpness, chosen.shrinkage)
    nearest = votes_of(distances, codes, len(classes))
    every = votes_of(distances, codes, len(classes), 0, weights)
    return tuple(float((classes[votes.winners] == wanted).mean()) for votes in (nearest, every))


def main() -> None:
    """Print a row for each set."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shared", type=Path, nargs="?", default=HERE.parent / ".." / "shared")
    data = parser.parse_args().shared / "data"
    header()
    if not data.is_dir():
        print(f"skipped: no data at {data}")
        return
    print("| set | nearest | all decide |\n|---|---|---|")
    for archive, name in SETS:
        nearest, every = accuracies(archive, name, data)
        print(f"| {name} | {100 * nearest:.1f} % | {100 * every:.1f} % |", flush=True)


if __name__ == "__main__":
    main()
