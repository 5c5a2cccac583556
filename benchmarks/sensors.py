"""The preset `sensors` on sets of the UCR and UEA archives, and `depth` on Kinect's joints.

    python benchmarks/sensors.py [--events]

``--events``: the events in test series that are joined in a random order, with slow ways between them.

Examples and tests are those of the archives. Published figures: ``data/published_dtw_1nn.csv``.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from datasets import arguments, utd_skeleton
from environment import header

from gesture_core import Spotter, classify_archive, load_settings
from gesture_core.classify.evaluation import Labelled, answer, compare_all
from gesture_core.plugin.registry import registry
from gesture_core.types import Recording

PUBLISHED = {"UCR": "error_dtw_full", "UEA": "accuracy_dtw_d"}
"""What each set is compared with."""


EVENTS = (("GunPoint", "ucr", 10, 20), ("CBF", "ucr", 10, 20), ("NATOPS", "uea", 10, 10),
          ("BasicMotions", "uea", 4, 5), ("ShakeGestureWiimoteZ", "ucr", 5, 5))  # fmt: skip
"""Set, archive, examples and joined series of each class."""
Series = tuple[str, Recording]


def drawn(path: Path, count: int, rng: np.random.Generator) -> list[Series]:
    """So many series of each class, with their labels."""
    reader = registry().make("reader", "series")
    every = [(name.split("/")[0], reader.read(path, name)[0]) for name in reader.members(path)]
    out = []
    for label in sorted({label for label, _ in every}):
        own = [one for one in every if one[0] == label]
        out += [own[place] for place in rng.permutation(len(own))[:count]]
    return out


def joined(
    series: list[Series], rng: np.random.Generator
) -> tuple[Recording, list[tuple[float, float, str]]]:
    """One recording with ways of .8 to 1.6 of a series' length between them, and where each series is."""
    rate = 1 / float(np.median(np.diff(series[0][1].times)))
    noise = np.concatenate([one.values for _, one in series]).std(0) * 0.02
    parts, truth, at, last = [], [], 0, series[0][1].values[0]
    for label, one in series:
        values = np.nan_to_num(one.values)
        gap = int(rng.integers(0.8 * len(values), 1.6 * len(values)))
        share = (1 - np.cos(np.pi * np.linspace(0, 1, gap)[:, None])) / 2
        way = last * (1 - share) + values[0] * share
        parts += [way + rng.normal(0, 1, way.shape) * noise, values]
        truth.append(((at + gap) / rate, (at + gap + len(values) - 1) / rate, label))
        at, last = at + gap + len(values), values[-1]
    whole = np.concatenate(parts)
    return Recording(whole, np.arange(at) / rate, series[0][1].channels, "joined"), truth


def events(data: Path) -> None:
    """Print a row for each set: events that overlap by half of what both cover, and have the label."""
    for name, archive, count, asked in EVENTS:
        rng = np.random.default_rng(0)
        train, test = (sorted((data / archive / name).glob(f"*{part}*"))[0] for part in ("TRAIN", "TEST"))
        known, series = drawn(train, count, rng), drawn(test, asked, rng)
        series = [series[place] for place in rng.permutation(len(series))]
        recording, truth = joined(series, rng)
        spotter = Spotter([one for _, one in known], [label for label, _ in known], "sensors")
        found, left = spotter.spot(recording), list(truth)
        for event in found:
            for one in left:
                both = min(one[1], event.end) - max(one[0], event.start)
                if one[2] == event.label and both >= 0.5 * (
                    max(one[1], event.end) - min(one[0], event.start)
                ):
                    left.remove(one)
                    break
        right = len(truth) - len(left)
        score = 2 * right / max(len(found) + len(truth), 1)
        print(
            f"{name:22} {right} of {len(truth)}, {len(found)} events, F1 {score:.2f}, {len(known)} examples"
        )


def main() -> None:
    """Print a row for each set."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--events", action="store_true", help="find events in series that are joined")
    given = parser.parse_args()
    header()
    if given.events:
        events(given.shared / "data")
        return
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
