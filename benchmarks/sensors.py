"""The preset `sensors` on sets of the UCR and UEA archives, and `depth` on Kinect's joints.

    python benchmarks/sensors.py

Examples and tests are those of the archives. Published figures: ``data/published_dtw_1nn.csv``.
"""

from __future__ import annotations

import csv

import numpy as np
from datasets import arguments, utd_skeleton
from environment import header

from gesture_core import classify_archive, load_settings
from gesture_core.classify.evaluation import Labelled, answer, compare_all

PUBLISHED = {"UCR": "error_dtw_full", "UEA": "accuracy_dtw_d"}
"""What each set is compared with."""


def main() -> None:
    """Print a row for each set."""
    given = arguments(__doc__.splitlines()[0]).parse_args()
    header()
    data = given.shared / "data"
    rows = list(csv.DictReader((data / "published_dtw_1nn.csv").open(encoding="utf-8")))
    pairs = []
    for row in rows:
        archive, name = row["archive"], row["dataset"]
        if row["measure"] != PUBLISHED[archive]:
            continue
        published = float(row["value"]) if archive == "UEA" else 1 - float(row["value"])
        suffix = "ts" if archive == "UEA" else "tsv"
        train, test = (
            data / archive.lower() / name / f"{name}_{part}.{suffix}" for part in ("TRAIN", "TEST")
        )
        found = classify_archive(test, train, settings="sensors", engine="inline").rows()
        right = sum(row.label == row.input.partition("::")[2].rpartition("/")[0] for row in found)
        pairs.append((right / len(found), published))
        print(
            f"{name:22} {right}/{len(found)} {right / len(found):6.1%}  published {published:6.1%}",
            flush=True,
        )
    mine, theirs = np.mean(pairs, axis=0)
    above = sum(own > other for own, other in pairs)
    print(f"{'mean':22} {mine:.1%}  published {theirs:.1%}; above on {above} of {len(pairs)}")
    for preset in ("modern", "depth"):
        items = utd_skeleton(given.shared, depth=preset == "depth")
        poses, labels, who = [i.pose for i in items], [i.label for i in items], [i.subject for i in items]
        compared = compare_all(Labelled(poses, labels, who, [i.name for i in items]), load_settings(preset))
        found = answer(compared, "leave-one-subject-out")
        print(f"utd_skeleton, {preset}: {found.accuracy:.1%}", flush=True)


if __name__ == "__main__":
    main()
