"""Published 1-NN figures of DTW, reproduced to the digit by every installed kernel.

    python benchmarks/published.py [SHARED] [--kernels numba,jax,torch,numpy]

Reads ``data/published_dtw_1nn.csv`` and the UCR and UEA sets beside it.
"""

from __future__ import annotations

import argparse
import csv
import time
from functools import cache
from pathlib import Path

import numpy as np
from environment import header

from gesture_core.dtw.distances import warping_distances
from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin import registry

HERE = Path(__file__).resolve().parent
WINDOWS = {"GunPoint": 0, "Trace": 3, "CBF": 11, "ShakeGestureWiimoteZ": 6}
"""Percent of the length, as the UCR archive's summary lists them."""
UNIVARIATE = DtwSpec(cost="squared", root=True)
SPECS = {
    "error_dtw_full": UNIVARIATE,
    "accuracy_dtw_d": DtwSpec(mode="dependent", cost="squared", reduce="sum", root=True),
    "accuracy_dtw_i": DtwSpec(cost="squared", reduce="sum", root=True),
}


def read_ucr(folder: Path, name: str, part: str) -> tuple[list[np.ndarray], np.ndarray]:
    """Z-normalised series (T,) and their labels, from a tab-separated file.

    The archive's figures for sets of unequal lengths are of series filled up with (nearly) zeros
    to the longest one, and only then normalised.
    """
    rows = np.nan_to_num(np.loadtxt(folder / f"{name}_{part}.tsv", ndmin=2))
    return [(row - row.mean()) / row.std() for row in rows[:, 1:]], rows[:, 0]


def read_uea(folder: Path, name: str, part: str) -> tuple[list[np.ndarray], np.ndarray]:
    """Series (T, D) and their labels, from a ``.ts`` file."""
    lines = (folder / f"{name}_{part}.ts").read_text(encoding="utf-8").splitlines()
    start = next(i for i, text in enumerate(lines) if text.strip().lower() == "@data")
    series, labels = [], []
    for text in filter(None, (row.strip() for row in lines[start + 1 :])):
        *channels, label = text.split(":")
        series.append(np.array([channel.split(",") for channel in channels], np.float64).T)
        labels.append(label)
    return series, np.array(labels)


@cache
def read(archive: str, name: str, data: Path) -> tuple:
    """Training series and labels, test series and labels."""
    reader = read_ucr if archive == "UCR" else read_uea
    folder = data / archive.lower() / name
    return *reader(folder, name, "TRAIN"), *reader(folder, name, "TEST")


def figure(archive: str, name: str, measure: str, data: Path, kernel: str) -> float:
    """The measured error or accuracy."""
    train, known, test, wanted = read(archive, name, data)
    spec = SPECS.get(measure) or UNIVARIATE.replace(window=WINDOWS[name] / 100)
    nearest = warping_distances(test, train, spec, kernel).argmin(axis=1)
    accuracy = float((known[nearest] == wanted).mean())
    return 1 - accuracy if measure.startswith("error") else accuracy


def main() -> None:
    """Print a row for each published figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shared", type=Path, nargs="?", default=HERE.parent / ".." / "shared")
    parser.add_argument("--kernels", default=",".join(registry().names("kernel", usable=True)))
    arguments = parser.parse_args()
    data = arguments.shared / "data"
    header()
    if not data.is_dir():
        print(f"skipped: no data at {data}")
        return
    kernels = [name for name in arguments.kernels.split(",") if name != "fastdtw"]
    print("| set | measure | published | " + " | ".join(kernels) + " |")
    print("|---|---|---|" + "---|" * len(kernels))
    spent = dict.fromkeys(kernels, 0.0)
    wrong = 0
    with (data / "published_dtw_1nn.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            published, found = row["value"], []
            digits = len(published.partition(".")[2])
            for kernel in kernels:
                start = time.process_time()
                value = figure(row["archive"], row["dataset"], row["measure"], data, kernel)
                spent[kernel] += time.process_time() - start
                same = abs(value - float(published)) <= 0.5 * 10**-digits + 1e-12
                wrong += not same
                found.append(f"{value:.{digits}f}" if same else f"**{value:.{digits + 2}f}**")
            print(f"| {row['dataset']} | {row['measure']} | {published} | {' | '.join(found)} |", flush=True)
    print("\nCPU s: " + ", ".join(f"{name} {seconds:.1f}" for name, seconds in spent.items()))
    print(f"{wrong} figures differ" if wrong else "every figure is the published one")


if __name__ == "__main__":
    main()
