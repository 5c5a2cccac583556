"""Accuracy under damage: the paper's method beside the preset `modern`, as a table and as curves.

    python benchmarks/stress.py [--shared FOLDER] [--png docs/images/stress.png] [--kernel NAME]
    python benchmarks/stress.py --frames utd_openpose body_gesture utd_skeleton [--videos FOLDER...] [--both]
    python benchmarks/stress.py --hands FOLDER

Queries are damaged, examples stay whole: utd_openpose, leave-one-subject-out. Damage is drawn from
a fixed seed, the same for every preset. ``--frames`` makes a few frames of each clip wrong instead, of
the data sets that it names, with ``signals.repair`` and without; ``--videos`` those of the keypoints that
benchmarks/videos.py left in these folders, a network's own; ``--both`` in the examples, too. utd_skeleton
is that in three dimensions, by the preset `depth`; ``--hands`` takes a folder of ``benchmarks/videos.py
--hands`` and the preset `hands`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from damage import BAD_FRAMES, DEPTH_FRAMES, HAND_FRAMES, STRESSES, Stress
from datasets import ROOT, Item, arguments, body_gesture, utd_openpose, utd_skeleton
from hands import GESTURES
from videos import with_videos

from gesture_core.classify.classifiers import Fitted, learn
from gesture_core.classify.comparison import compare
from gesture_core.classify.decision import votes_of
from gesture_core.colours import BLACK, BLUE, GREY, VERMILLION
from gesture_core.errors import GestureError
from gesture_core.report.style import new_figure, save
from gesture_core.settings import Settings, load_settings
from gesture_core.signals.chain import Chain
from gesture_core.types import Signals

STYLES = (
    {"color": GREY, "marker": "o"},
    {"color": BLUE, "marker": "s"},
    {"color": BLACK, "marker": "^", "linestyle": "--"},
    {"color": VERMILLION, "marker": "x", "linestyle": ":"},
)


def accuracies(
    items: Sequence[Item], settings: Settings, stresses: Sequence[Stress] = STRESSES, both: bool = False
) -> dict[str, list[float]]:
    """Accuracy at each strength of each damage; ``both`` damages the examples as well."""
    chain = replace(Chain.from_settings(settings), allow_still=True)
    examples = [chain(item.pose) for item in items]
    codes = np.unique([item.label for item in items], return_inverse=True)[1]
    subjects = np.array([item.subject for item in items])
    within = compare(examples, examples, settings)
    whole = _fitted(within, examples, codes, subjects, settings)
    out: dict[str, list[float]] = {}
    for stress in stresses:
        for strength in stress.strengths:
            random = np.random.default_rng(7)
            queries, places = [], []
            for place, item in enumerate(items):
                try:
                    # The first strength is none.
                    changed = strength != stress.strengths[0]
                    queries.append(
                        chain(stress.damage(item.pose, strength, random) if changed else item.pose)
                    )
                    places.append(place)
                except GestureError:  # no label is no right answer
                    continue
            kept = np.array(places, np.int64)
            if both:
                distances = compare(queries, queries, settings)
                fitted = _fitted(distances, queries, codes[kept], subjects[kept], settings)
                every = np.arange(len(kept))
                right = recognised(distances, queries, every, codes[kept], subjects[kept], fitted)
            else:
                distances = within[kept]
                other = [i for i, place in enumerate(kept) if not _equal(queries[i], examples[place])]
                if other:
                    distances[other] = compare([queries[i] for i in other], examples, settings)
                right = recognised(distances, queries, kept, codes, subjects, whole)
            out.setdefault(stress.name, []).append(right / len(items))
            print(f"{stress.name} {strength:g}: {100 * right / len(items):.1f}", file=sys.stderr, flush=True)
    return out


def _fitted(
    within: np.ndarray, series: list[Signals], codes: np.ndarray, subjects: np.ndarray, settings: Settings
) -> dict[str, Fitted]:
    """What is learned for each subject from the examples of all others."""
    found = {}
    for who in np.unique(subjects):
        others = np.flatnonzero(subjects != who)
        among, known = within[np.ix_(others, others)], [series[i] for i in others]
        found[str(who)] = learn(settings, known, codes[others], int(codes.max()) + 1, among)[2]
    return found


def _equal(one: Signals, other: Signals) -> bool:
    return np.array_equal(one.values, other.values) and np.array_equal(one.mask, other.mask)


def recognised(
    distances: np.ndarray,
    queries: list[Signals],
    places: np.ndarray,
    codes: np.ndarray,
    subjects: np.ndarray,
    fitted: dict[str, Fitted],
) -> int:
    """How many queries are recognised by the examples of the other subjects.

    ``distances`` is (Q, N), ``places`` says which of the N items each query is, ``fitted`` is what was
    learned from the examples of all others for each subject.
    """
    right = 0
    for who, learned in fitted.items():
        others = np.flatnonzero(subjects != who)
        own = np.flatnonzero(subjects[places] == who)
        votes = votes_of(learned, distances[np.ix_(own, others)], [queries[i] for i in own])
        right += int((votes.winners == codes[places[own]]).sum())
    return right


def draw(found: dict[str, dict[str, list[float]]], path: Path) -> None:
    """One panel for each damage, one curve for each preset that was measured under it."""
    columns = 5
    rows = -(-len(STRESSES) // columns)
    figure = new_figure(14, 2.9 * rows)
    for index, stress in enumerate(STRESSES):
        axes = figure.add_subplot(rows, columns, index + 1)
        order, fresh = np.argsort(stress.strengths), False
        for style, (preset, values) in zip(STYLES, found.items(), strict=False):
            if stress.name not in values:
                continue
            fresh |= next(iter(values)) == stress.name
            x = np.array(stress.strengths)[order]
            axes.plot(x, 100 * np.array(values[stress.name])[order], **style, label=preset, ms=3.5)
        if stress.unit in ("factor", "growth"):
            axes.set_xscale("log")
            axes.set_xticks(sorted(stress.strengths), [f"{s:g}" for s in sorted(stress.strengths)])
            axes.minorticks_off()
        elif stress.unit == "other hand":
            axes.set_xticks([0, 1], ["no", "yes"])
        axes.set_title(stress.name, fontsize=10)
        axes.set_xlabel(stress.unit, fontsize=8)
        axes.set_ylim(0, 103)
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.3)
        if index % columns == 0:
            axes.set_ylabel("accuracy, %", fontsize=8)
        if fresh:  # one that was in no panel before
            axes.legend(fontsize=8, loc="lower left")
    save(figure, path)


def tables(stresses: Sequence[Stress], found: dict[str, dict[str, list[float]]]) -> None:
    """Print a table for each damage."""
    for stress in stresses:
        print(f"\n| {stress.name} ({stress.unit}) | " + " | ".join(f"{s:g}" for s in stress.strengths) + " |")
        print("|---" * (1 + len(stress.strengths)) + "|")
        for name, values in found.items():
            print(f"| {name} | " + " | ".join(f"{100 * v:.1f}" for v in values[stress.name]) + " |")


def main() -> int:
    """Print the table and draw the curves."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--presets", nargs="+", default=["paper", "modern", "modern+upright"])
    parser.add_argument("--png", type=Path, default=ROOT / "docs" / "images" / "stress.png")
    parser.add_argument("--kernel", default="auto")
    sets = {
        "utd_openpose": lambda: utd_openpose(given.shared),
        "body_gesture": lambda: body_gesture(given.shared),
        "utd_skeleton": lambda: utd_skeleton(given.shared, depth=True),
    }
    parser.add_argument("--frames", nargs="+", default=[], choices=sets)
    parser.add_argument(
        "--videos", nargs="+", type=Path, default=[], help="wrong frames in what a network found"
    )
    parser.add_argument("--hands", type=Path, help="the same in hands")
    parser.add_argument("--both", action="store_true", help="with --frames: damage the examples, too")
    parser.add_argument("--counts", nargs="+", type=int, help="so many wrong frames alone")
    given = parser.parse_args()
    tried = [
        (name, sets[name](), *(("depth", DEPTH_FRAMES) if name == "utd_skeleton" else ("modern", BAD_FRAMES)))
        for name in given.frames
    ]
    for folder in given.videos:
        clips = with_videos(body_gesture(given.shared), folder)
        clips = [replace(clip, pose=clip.pose.onto("coco18")) for clip in clips]
        tried.append((folder.name, clips, "modern", BAD_FRAMES))
    if given.hands:
        clips = [i for i in with_videos(body_gesture(given.shared), given.hands) if i.label in GESTURES]
        clips = [replace(clip, pose=clip.pose.onto("coco18+hands")) for clip in clips]
        tried.append((given.hands.name, clips, "hands", HAND_FRAMES))
    for title, items, preset, kinds in tried:
        settings = load_settings(preset, classify__kernel=given.kernel)
        if given.counts:
            kinds = tuple(replace(kind, strengths=(0, *given.counts)) for kind in kinds)
        found = {
            name: accuracies(items, settings.with_values([("signals.repair", on)]), kinds, given.both)
            for name, on in (("repaired", True), ("as they are", False))
        }
        print(f"\n{title}, {len(items)} clips, preset {preset}")
        tables(kinds, found)
    if tried:
        return 0
    items = utd_openpose(given.shared)
    found = {}
    for name in given.presets:
        preset, _, normalizer = name.partition("+")
        settings = load_settings(preset, classify__kernel=given.kernel)
        if normalizer:
            settings = settings.with_values([("signals.normalizer", normalizer)])
        found[name] = accuracies(items, settings)
    tables(STRESSES, found)
    draw(found, given.png)
    print(f"\n{given.png}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
