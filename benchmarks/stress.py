"""Accuracy under damage: the paper's method beside the preset `modern`, as a table and as curves.

    python benchmarks/stress.py [--shared FOLDER] [--png docs/images/stress.png] [--kernel NAME]
    python benchmarks/stress.py --frames utd_openpose body_gesture [--videos FOLDER...] [--both]

Queries are damaged, examples stay whole: utd_openpose, leave-one-subject-out. Damage is drawn from
a fixed seed, the same for every preset. ``--frames`` makes a few frames of each clip wrong instead, of
the data sets that it names, with ``signals.repair`` and without; ``--videos`` those of the keypoints that
benchmarks/videos.py left in these folders, a network's own; ``--both`` in the examples, too.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from datasets import ROOT, Item, arguments, body_gesture, utd_openpose
from videos import with_videos

from gesture_core.classify.classifiers import Fitted, learn
from gesture_core.classify.comparison import compare
from gesture_core.classify.decision import votes_of
from gesture_core.colours import BLACK, BLUE, GREY, VERMILLION
from gesture_core.errors import GestureError
from gesture_core.report.style import new_figure, save
from gesture_core.settings import Settings, load_settings
from gesture_core.signals.chain import Chain
from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence, Signals

STYLES = (
    {"color": GREY, "marker": "o"},
    {"color": BLUE, "marker": "s"},
    {"color": BLACK, "marker": "^", "linestyle": "--"},
    {"color": VERMILLION, "marker": "x", "linestyle": ":"},
)


@dataclass(frozen=True)
class Stress:
    """One kind of damage at several strengths; the first strength is none."""

    name: str
    unit: str
    strengths: Sequence[float]
    damage: Callable[[PoseSequence, float, np.random.Generator], PoseSequence]


def dropout(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """Joints that are missing, each frame anew."""
    gone = random.random(pose.scores.shape) < share
    return replace(pose, keypoints=np.where(gone[..., None], np.nan, pose.keypoints))


def bursts(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """Joints that are missing for about half a second at a time."""
    length = max(1, round(0.5 / float(np.median(np.diff(pose.times)))))
    gone = np.zeros(pose.scores.shape, bool)
    wanted = share * gone.size
    while gone.sum() < wanted:
        start = random.integers(-length + 1, len(pose))
        gone[max(start, 0) : start + length, random.integers(gone.shape[1])] = True
    return replace(pose, keypoints=np.where(gone[..., None], np.nan, pose.keypoints))


def jitter(pose: PoseSequence, size: float, random: np.random.Generator) -> PoseSequence:
    """Noise on every coordinate; the size is its deviation in shoulder widths."""
    return replace(pose, keypoints=pose.keypoints + random.normal(0, size, pose.keypoints.shape))


def frame_drops(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """Frames that never arrive; those that do keep their times."""
    return _frames(pose, np.flatnonzero(random.random(len(pose)) >= share))


def frame_rate(pose: PoseSequence, factor: float, random: np.random.Generator) -> PoseSequence:
    """The same movement at another frame rate, with true times."""
    times = np.linspace(pose.times[0], pose.times[-1], max(2, round(len(pose) * factor)))
    flat = pose.keypoints.reshape(len(pose), -1)
    points = np.stack([np.interp(times, pose.times, c) for c in flat.T], axis=1).reshape(-1, 18, 2)
    return PoseSequence(points, np.ones(points.shape[:2]), times, source=pose.source)


def roll(pose: PoseSequence, degrees: float, random: np.random.Generator) -> PoseSequence:
    """A camera that is turned about its axis."""
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    return replace(pose, keypoints=pose.keypoints @ turn.T)


def scale(pose: PoseSequence, factor: float, random: np.random.Generator) -> PoseSequence:
    """A person of another size somewhere else in the picture."""
    return replace(pose, keypoints=pose.keypoints * factor + random.uniform(-500, 500, 2))


def walk(pose: PoseSequence, factor: float, random: np.random.Generator) -> PoseSequence:
    """A person who comes nearer: size grows by the factor from the first to the last frame."""
    growth = np.linspace(1, factor, len(pose))[:, None, None]
    return replace(pose, keypoints=pose.keypoints * growth)


def mirror(pose: PoseSequence, on: float, random: np.random.Generator) -> PoseSequence:
    """The same gesture with the other hand."""
    if not on:
        return pose
    return replace(pose, keypoints=pose.keypoints[:, list(COCO18.mirror)] * (-1, 1))


def clip_ends(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """A part cut off at the start and as much at the end."""
    cut = round(len(pose) * share)
    return _frames(pose, np.arange(cut, len(pose) - cut))


def _frames(pose: PoseSequence, kept: np.ndarray) -> PoseSequence:
    return replace(pose, keypoints=pose.keypoints[kept], scores=pose.scores[kept], times=pose.times[kept])


def _torso(pose: PoseSequence) -> float:
    neck, right, left = (COCO18.index(name) for name in ("neck", "right_hip", "left_hip"))
    hips = (pose.keypoints[:, right] + pose.keypoints[:, left]) / 2
    return float(np.nanmedian(np.linalg.norm(pose.keypoints[:, neck] - hips, axis=1)))


def _somewhere(pose: PoseSequence, count: float, random: np.random.Generator) -> np.ndarray:
    return np.sort(random.choice(len(pose), min(round(count), len(pose)), replace=False))


def _in_a_row(pose: PoseSequence, count: float, random: np.random.Generator) -> np.ndarray:
    return random.integers(len(pose) - round(count) + 1) + np.arange(round(count))


def _at_the_start(pose: PoseSequence, count: float, random: np.random.Generator) -> np.ndarray:
    return np.arange(round(count))


def jumps(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator, size: float = 3) -> np.ndarray:
    """A wrist that is ``size`` torso lengths off, each time in another direction."""
    points, wrist = pose.keypoints.copy(), COCO18.index(("right_wrist", "left_wrist")[random.integers(2)])
    angle = random.uniform(0, 2 * np.pi, len(frames))
    points[frames, wrist] += size * _torso(pose) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points


def exchanged(*names: str) -> Callable[[PoseSequence, np.ndarray, np.random.Generator], np.ndarray]:
    """Left and right of the joints called ``names`` change places."""

    def damage(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
        points = pose.keypoints.copy()
        for name in names:
            pair = [COCO18.index(f"right_{name}"), COCO18.index(f"left_{name}")]
            points[np.ix_(frames, pair)] = points[np.ix_(frames, pair[::-1])]
        return points

    return damage


def zeros(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A joint of an arm at 0, 0."""
    names = ("right_wrist", "left_wrist", "right_elbow", "left_elbow")
    points = pose.keypoints.copy()
    points[frames, COCO18.index(names[random.integers(4)])] = 0
    return points


def frozen(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Frames that show the one before them."""
    points = pose.keypoints.copy()
    for frame in frames:
        points[frame] = points[max(frame - 1, 0)]
    return points


def doubled(pose: PoseSequence, count: float, random: np.random.Generator) -> PoseSequence:
    """Frames that come twice, which makes the clip longer."""
    kept = np.sort(np.concatenate([np.arange(len(pose)), _somewhere(pose, count, random)]))
    times = np.arange(len(kept)) * float(np.median(np.diff(pose.times)))
    return replace(_frames(pose, kept), times=times)


def wrong(
    damage: Callable[[PoseSequence, np.ndarray, np.random.Generator], np.ndarray],
    frames: Callable[[PoseSequence, float, np.random.Generator], np.ndarray] = _somewhere,
) -> Callable[[PoseSequence, float, np.random.Generator], PoseSequence]:
    """``damage`` in as many of the ``frames`` as the strength says."""
    return lambda pose, count, random: replace(
        pose, keypoints=damage(pose, frames(pose, count, random), random)
    )


STRESSES = (
    Stress("joint dropout", "share missing", (0, 0.1, 0.2, 0.3, 0.4, 0.5), dropout),
    Stress("joint dropout in bursts", "share missing", (0, 0.1, 0.2, 0.3, 0.4, 0.5), bursts),
    Stress("jitter", "shoulder widths", (0, 0.05, 0.1, 0.2, 0.3), jitter),
    Stress("frame drops", "share lost", (0, 0.1, 0.2, 0.3, 0.5, 0.7), frame_drops),
    Stress("frame rate", "factor", (1, 0.25, 0.5, 2, 4), frame_rate),
    Stress("camera roll", "degrees", (0, 5, 10, 15, 20, 30), roll),
    Stress("scale and position", "factor", (1, 0.2, 0.5, 2, 10), scale),
    Stress("walking nearer", "growth", (1, 1.2, 1.5, 2), walk),
    Stress("mirrored", "other hand", (0, 1), mirror),
    Stress("clipped start and end", "share of each", (0, 0.05, 0.1, 0.15, 0.2, 0.3), clip_ends),
)
_ARMS = ("shoulder", "elbow", "wrist")
_all = exchanged(*_ARMS, "hip", "knee", "ankle", "eye", "ear")
_COUNTS = (0, 1, 2, 3, 5)
BAD_FRAMES = (
    Stress("a wrist 3 torsos off", "frames", _COUNTS, wrong(jumps)),
    Stress("a wrist off, in a row", "frames", (0, 2, 3, 5), wrong(jumps, _in_a_row)),
    Stress("a wrist off, at the start", "frames", (0, 1, 3), wrong(jumps, _at_the_start)),
    Stress("wrists exchanged", "frames", _COUNTS, wrong(exchanged("wrist"))),
    Stress("arms exchanged", "frames", _COUNTS, wrong(exchanged(*_ARMS))),
    Stress("all exchanged", "frames", _COUNTS, wrong(_all)),
    Stress("all exchanged, at the start", "frames", (0, 1, 3), wrong(_all, _at_the_start)),
    Stress("a joint at 0, 0", "frames", _COUNTS, wrong(zeros)),
    Stress("frozen", "frames", _COUNTS, wrong(frozen)),
    Stress("doubled", "frames", _COUNTS, doubled),
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
    parser.add_argument(
        "--frames", nargs="+", default=[], choices=[utd_openpose.__name__, body_gesture.__name__]
    )
    parser.add_argument(
        "--videos", nargs="+", type=Path, default=[], help="wrong frames in what a network found"
    )
    parser.add_argument("--both", action="store_true", help="with --frames: damage the examples, too")
    given = parser.parse_args()
    if given.frames or given.videos:
        modern = load_settings("modern", classify__kernel=given.kernel)
        sets = {
            read.__name__: read(given.shared)
            for read in (utd_openpose, body_gesture)
            if read.__name__ in given.frames
        }
        for folder in given.videos:
            clips = with_videos(body_gesture(given.shared), folder)
            sets[folder.name] = [replace(clip, pose=clip.pose.onto("coco18")) for clip in clips]
        for title, items in sets.items():
            found = {
                name: accuracies(items, modern.with_values([("signals.repair", on)]), BAD_FRAMES, given.both)
                for name, on in (("repaired", True), ("as they are", False))
            }
            print(f"\n{title}, {len(items)} clips")
            tables(BAD_FRAMES, found)
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
