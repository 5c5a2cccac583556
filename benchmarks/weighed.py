"""The classifiers on public sets that no constant was chosen on.

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

from gesture_core.classify.classifiers import Fitted
from gesture_core.classify.decision import votes_of
from gesture_core.dtw.distances import warping_distances
from gesture_core.settings import load_settings

SETS = [("UCR", name) for name in WINDOWS]
CLASSIFIERS = ("nearest", "weighed", "rocket", "blend")
SETS += [("UEA", name) for name in ("BasicMotions", "JapaneseVowels", "Libras", "NATOPS")]


def accuracies(archive: str, name: str, data: Path) -> list[float]:
    """Accuracy of each classifier."""
    train, known, test, wanted = read(archive, name, data)
    spec = UNIVARIATE if archive == "UCR" else SPECS["accuracy_dtw_d"]
    classes, codes = np.unique(known, return_inverse=True)
    distances = warping_distances(test, train, spec)
    within = warping_distances(train, train, spec)
    found = []
    for classifier in CLASSIFIERS:
        settings = load_settings("paper", classify__classifier=classifier)
        fitted = Fitted.fit(settings, list(train), codes, len(classes), within)
        winners = votes_of(fitted, distances, list(test)).winners
        found.append(float((classes[winners] == wanted).mean()))
    return found


def main() -> None:
    """Print a row for each set."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shared", type=Path, nargs="?", default=HERE.parent / ".." / "shared")
    data = parser.parse_args().shared / "data"
    header()
    if not data.is_dir():
        print(f"skipped: no data at {data}")
        return
    print(f"| set | {' | '.join(CLASSIFIERS)} |\n|---{'|---' * len(CLASSIFIERS)}|")
    for archive, name in SETS:
        shares = [f"{100 * share:.1f} %" for share in accuracies(archive, name, data)]
        print(f"| {name} | {' | '.join(shares)} |", flush=True)


if __name__ == "__main__":
    main()
