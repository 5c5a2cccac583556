"""The accuracy table: the paper's method and the preset `modern` on every data set, by subject.

    python benchmarks/evaluate.py [--shared FOLDER] [--presets paper modern] [--kernel NAME]

All rows use the same preset. ``--videos FOLDER`` adds body_gesture from the RGB videos with the keypoints
that benchmarks/videos.py left in that folder.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from datasets import (
    PAPER_EXAMPLES,
    Item,
    arguments,
    body_gesture,
    pose_trainer,
    utd_openpose,
    utd_skeleton,
)
from videos import with_videos

from gesture_core.classify.classifiers import learn
from gesture_core.classify.decision import votes_of
from gesture_core.classify.evaluation import Compared, Labelled, answer, compare_all
from gesture_core.classify.scores import Evaluation, wilson
from gesture_core.errors import GestureError
from gesture_core.settings import Settings, load_settings
from gesture_core.signals.chain import Chain


def labelled(items: Sequence[Item], settings: Settings) -> Labelled:
    """Items with their signals; a sequence in which nothing moves stays comparable, as in the paper."""
    chain = replace(Chain.from_settings(settings), allow_still=True)
    signals = []
    for item in items:
        try:
            signals.append(chain(item.pose))
        except GestureError as error:
            signals.append(error)
    columns = [[getattr(item, key) for item in items] for key in ("label", "subject", "name")]
    return Labelled(signals, *columns)


def part(compared: Compared, kept: Sequence[bool]) -> Compared:
    """The items in ``kept`` of a compared data set."""
    chosen = np.asarray(kept, bool)
    data = compared.data
    positions = {int(old): new for new, old in enumerate(np.flatnonzero(chosen))}
    rows = chosen[compared.usable]
    lists = [[v for v, k in zip(values, chosen, strict=True) if k] for values in _columns(data)]
    return Compared(
        Labelled(*lists),
        compared.settings,
        np.array([positions[int(i)] for i in compared.usable[rows]]),
        compared.within[np.ix_(rows, rows)],
        {positions[i]: e for i, e in compared.errors.items() if chosen[i]},
        series=compared.of(np.flatnonzero(rows)),
    )


def _columns(data: Labelled) -> tuple[Sequence, ...]:
    return data.poses, data.labels, data.subjects, data.names


def shown(evaluation: Evaluation) -> str:
    """``163/168 97.0 % (93 to 99)``."""
    right, total = sum(a.right for a in evaluation.answers), len(evaluation.answers)
    return counted(right, total)


def counted(right: int, total: int) -> str:
    """A share with its 95 % interval."""
    low, high = wilson(right, total)
    return f"{right}/{total} {100 * right / total:.1f} % ({100 * low:.0f} to {100 * high:.0f})"


def authors_examples(compared: Compared) -> str:
    """The six examples of the authors' program against all other subjects."""
    names = [compared.data.names[i] for i in compared.usable]
    labels = np.array([compared.data.labels[i] for i in compared.usable])
    examples = np.array([names.index(name) for name in PAPER_EXAMPLES])
    queries = [i for i, name in enumerate(names) if "_s1_" not in name]
    classes, codes = np.unique(labels, return_inverse=True)
    among = compared.within[np.ix_(examples, examples)]
    fitted = learn(compared.settings, compared.of(examples), codes[examples], len(classes), among)[2]
    block = compared.within[np.ix_(queries, examples)]
    votes = votes_of(fitted, block, compared.of(np.array(queries)))
    right = int((classes[votes.winners] == labels[queries]).sum())
    return counted(right, sum(s != "s1" for s in compared.data.subjects))


def rows_of(data: dict[str, list[Item]], settings: Settings) -> dict[str, str]:
    """The figures of one preset, by row."""
    out = {}
    utd = compare_all(labelled(data["utd_openpose"], settings), settings)
    out["utd_openpose, the authors' six examples of subject 1"] = authors_examples(utd)
    donor = answer(utd, "donor")
    each = ", ".join(f"{100 * share:.0f}" for share in donor.by_fold.values())
    out["utd_openpose, one example a class from each subject in turn"] = f"{shown(donor)}; {each}"
    out["utd_openpose, leave-one-subject-out"] = shown(answer(utd, "leave-one-subject-out"))
    for name in (key for key in data if key.startswith("body_gesture")):
        body = compare_all(labelled(data[name], settings), settings)
        groups = [item.group for item in data[name]]
        for group in ("static", "dynamic"):
            own = part(body, [g == group for g in groups])
            out[f"{name}, {len(set(own.data.labels))} {group}"] = shown(answer(own, "leave-one-subject-out"))
        out[f"{name}, all 15"] = shown(answer(body, "leave-one-subject-out"))
    trainer = compare_all(labelled(data["pose_trainer"], settings), settings)
    out["pose_trainer, leave-one-out"] = shown(answer(trainer, "leave-one-out"))
    kinect = compare_all(labelled(data["utd_skeleton"], settings), settings)
    out["utd_skeleton, 27 actions, leave-one-subject-out"] = shown(answer(kinect, "leave-one-subject-out"))
    return out


def main() -> int:
    """Print the table."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--presets", nargs="+", default=["paper", "modern"])
    parser.add_argument("--kernel", default="auto")
    parser.add_argument("--videos", nargs="+", type=Path, default=[], help="folders of benchmarks/videos.py")
    given = parser.parse_args()
    sources = {"utd_openpose": utd_openpose, "body_gesture": body_gesture}
    sources |= {"pose_trainer": pose_trainer, "utd_skeleton": utd_skeleton}
    data = {name: read(given.shared) for name, read in sources.items()}
    for folder in given.videos:
        clips = with_videos(data["body_gesture"], folder)
        data[f"body_gesture, {folder.name}"] = clips
        if len(clips) < len(data["body_gesture"]):  # a fair comparison needs the same clips
            names = {item.name for item in clips}
            data[f"body_gesture, landmarks of the {len(clips)} clips of {folder.name}"] = [
                item for item in data["body_gesture"] if item.name in names
            ]
    table: dict[str, list[str]] = {}
    for preset in given.presets:
        started = time.perf_counter()
        settings = load_settings(preset, classify__kernel=given.kernel)
        for row, figure in rows_of(data, settings).items():
            table.setdefault(row, []).append(figure)
        print(f"{preset}: {time.perf_counter() - started:.1f} s", file=sys.stderr)
    print("| data, protocol | " + " | ".join(given.presets) + " |")
    print("|---" * (1 + len(given.presets)) + "|")
    for row, figures in table.items():
        print(f"| {row} | " + " | ".join(figures) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
