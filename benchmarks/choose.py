"""How the weights of the preset `modern` were chosen, and what that choice is worth on unseen subjects.

    python benchmarks/choose.py [--shared FOLDER] [--starts 3] [--nested] [--out FILE.toml]

Every candidate channel group (`parts` terms such as ``wrist.energy``) gets a matrix of warping
distances of its own, once as performed and once mirrored. The weighted sum of these matrices stands
in for one warping over all channels together; it costs nothing to evaluate, so the weights can be
searched: from random starts, one weight at a time is multiplied, divided or set to zero, and kept
where the loss falls. The loss is that of a soft nearest neighbour (Goldberger et al. 2005) under
leave-one-subject-out, summed over the data sets, with a small price for each group that is used.

``--nested`` repeats the whole search for each subject of each data set with that subject taken out,
and tests the weights on it: the honest estimate beside the figures of the one preset, which has seen
all subjects. `transfer` leaves out utd_openpose as a whole.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from datasets import Item, arguments, body_gesture, pose_trainer, utd_openpose, utd_skeleton

from gesture_core.classify.comparison import compare
from gesture_core.settings import load_settings
from gesture_core.signals.chain import Chain
from gesture_core.signals.mirror import mirrored

TERMS = (
    "wrist", "wrist@0.5", "elbow@1", "shoulder@1", "nose@0.5", "hip@1", "knee@1", "ankle@1",
    "forearm@0.5", "forearm@1", "upper_arm@0.5", "arm@0.5",
    "forearm.direction", "upper_arm.direction",
    "wrist.velocity", "forearm.velocity", "wrist.energy", "forearm.energy", "forearm.turning",
)  # fmt: skip
PRICE = 0.004
SHARPNESS = 12.0
DONOR = 3.0


@dataclass(frozen=True, eq=False)
class Problem:
    """One data set: its items and, for each term, distances as performed and mirrored."""

    name: str
    labels: np.ndarray
    subjects: np.ndarray
    groups: np.ndarray
    same: np.ndarray
    other: np.ndarray

    def take(self, kept: np.ndarray) -> Problem:
        """The problem among the items in ``kept``."""
        where = np.ix_(np.arange(len(self.same)), kept, kept)
        return replace(
            self,
            labels=self.labels[kept],
            subjects=self.subjects[kept],
            groups=self.groups[kept],
            same=self.same[where],
            other=self.other[where],
        )


@dataclass(eq=False)
class State:
    """Weights with the sums of matrices that belong to them, updated one weight at a time."""

    problems: list[Problem]
    weights: np.ndarray
    mirror: float
    same: list[np.ndarray] = field(default_factory=list)
    other: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.same = [np.tensordot(self.weights, p.same, 1) for p in self.problems]
        self.other = [np.tensordot(self.weights, p.other, 1) for p in self.problems]

    def loss(self, term: int = 0, change: float = 0.0, mirror: float = 0.0) -> float:
        """The loss with one weight changed and another mirror factor, both tentative."""
        total = 0.0
        for problem, same, other in zip(self.problems, self.same, self.other, strict=True):
            step = np.float32(change)
            reached = (other + step * problem.other[term]) * np.float32(mirror or self.mirror)
            total += problem_loss(problem, np.minimum(same + step * problem.same[term], reached))
        used = int((self.weights > 0).sum())
        used += int(self.weights[term] + change > 0) - int(self.weights[term] > 0)
        return total + PRICE * used

    def change(self, term: int, change: float) -> None:
        """Make a change of one weight."""
        self.weights[term] += change
        for index, problem in enumerate(self.problems):
            self.same[index] = self.same[index] + np.float32(change) * problem.same[term]
            self.other[index] = self.other[index] + np.float32(change) * problem.other[term]


def problem_loss(problem: Problem, distances: np.ndarray) -> float:
    """Soft nearest-neighbour loss of one data set: of all items, of each group, of single donors."""
    strangers = problem.subjects[:, None] != problem.subjects[None]
    apart = np.where(strangers, distances, np.float32(1e9))
    if problem.name == "utd_openpose":
        return 0.5 * soft_loss(apart, problem.labels) + DONOR * donor_loss(problem, distances)
    total = soft_loss(apart, problem.labels)
    groups = np.unique(problem.groups)
    if len(groups) > 1:
        for group in groups:
            own = np.flatnonzero(problem.groups == group)
            total += soft_loss(apart[np.ix_(own, own)], problem.labels[own])
    return total


def soft_loss(distances: np.ndarray, labels: np.ndarray) -> float:
    """Mean of 1 - p(own class), p falling with the power `SHARPNESS` of the distance; labels sorted."""
    _, starts, codes = np.unique(labels, return_index=True, return_inverse=True)
    return chances(np.minimum.reduceat(distances, starts, axis=1), codes)


def chances(nearest: np.ndarray, codes: np.ndarray) -> float:
    """The same from the (Q, C) distances to each class."""
    power = -SHARPNESS * np.log(np.maximum(nearest, 1e-9))
    power = np.exp(power - power.max(axis=1, keepdims=True))
    return float(1 - (power[np.arange(len(codes)), codes] / power.sum(axis=1)).mean())


def donor_loss(problem: Problem, distances: np.ndarray) -> float:
    """Mean over subjects of the loss when only that subject's trials are examples, averaged in a class."""
    classes, codes = np.unique(problem.labels, return_inverse=True)
    losses = []
    for subject in np.unique(problem.subjects):
        own = problem.subjects == subject
        members = [np.flatnonzero(own & (problem.labels == label)) for label in classes]
        if all(len(m) for m in members) and not own.all():
            means = np.stack([distances[np.ix_(~own, m)].mean(axis=1) for m in members], axis=1)
            losses.append(chances(means, codes[~own]))
    return float(np.mean(losses)) if losses else 0.0


def kept(folder: Path | None, name: str) -> Problem | None:
    """A problem whose matrices an earlier run left in ``folder``."""
    path = folder / f"{name}.npz" if folder else None
    if path is None or not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as found:
        return Problem(name, *(found[key] for key in ("labels", "subjects", "groups", "same", "other")))


def load(name: str, items: list[Item], kernel: str, folder: Path | None = None) -> Problem:
    """Distances of every term on one data set, kept in ``folder`` where one is given."""
    items = sorted(items, key=lambda item: item.label)
    modern = load_settings("modern", signals__selector="all")
    same, other = [], []
    for term in TERMS:
        options = {**modern.options, "parts": {"weights": {term: 1.0}}}
        settings = replace(modern, options=options, dtw=modern.dtw.replace(reduce="sum"))
        settings = replace(settings, classify=replace(settings.classify, coverage=False, mirror=None))
        settings = replace(settings, classify=replace(settings.classify, kernel=kernel))
        chain = replace(Chain.from_settings(settings), allow_still=True)
        signals = chain.all(item.pose for item in items)
        found = compare(signals, [*signals, *map(mirrored, signals)], settings)
        # A pair that lacks the joint is as far as pairs of this term usually are.
        found = np.where(np.isfinite(found), found, np.median(found[np.isfinite(found)]))
        same.append(found[:, : len(items)])
        other.append(found[:, len(items) :])
    facts = [np.array([getattr(item, key) for item in items]) for key in ("label", "subject", "group")]
    problem = Problem(name, *facts, np.float32(same), np.float32(other))
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        arrays = {key: getattr(problem, key) for key in ("labels", "subjects", "groups", "same", "other")}
        np.savez(folder / f"{name}.npz", **arrays)
    return problem


def search(problems: list[Problem], starts: int) -> tuple[np.ndarray, float, float]:
    """The best weights of several starts, their mirror factor and loss."""
    best = None
    for seed in range(starts):
        random = np.random.default_rng(seed)
        state = State(problems, np.float32(random.uniform(0.05, 0.4, len(TERMS))), 1.2)
        loss, step = state.loss(), 4.0
        for _ in range(5):
            for term in random.permutation(len(TERMS)):
                weight = float(state.weights[term])
                tries = [weight * step, weight / step, 0.0] if weight else [0.05 * float(state.weights.max())]
                for target in tries:
                    change = target - float(state.weights[term])
                    if change and (found := state.loss(term, change)) < loss - 1e-4:
                        state.change(term, change)
                        loss = found
                        break
            for factor in (state.mirror * 1.1, state.mirror / 1.1):
                if factor >= 1 and (found := state.loss(mirror=factor)) < loss - 1e-4:
                    state.mirror, loss = factor, found
            step = 1 + (step - 1) / 1.7
        if best is None or loss < best[2]:
            best = (state.weights / state.weights.max(), state.mirror, loss)
    assert best is not None
    return best


def nearest_labels(problem: Problem, weights: np.ndarray, mirror: float) -> np.ndarray:
    """(N, N) distances under ``weights``."""
    same, other = np.tensordot(weights, problem.same, 1), np.tensordot(weights, problem.other, 1)
    return np.minimum(same, mirror * other)


def tested(problem: Problem, subject: str, weights: np.ndarray, mirror: float) -> dict[str, list[bool]]:
    """Whether each item of ``subject`` is recognised from all others, overall and in each group."""
    distances = nearest_labels(problem, weights, mirror)
    out = {}
    for group in ("", *np.unique(problem.groups)):
        there = np.ones(len(problem.labels), bool) if not group else problem.groups == group
        queries = np.flatnonzero((problem.subjects == subject) & there)
        examples = np.flatnonzero((problem.subjects != subject) & there)
        near = examples[distances[np.ix_(queries, examples)].argmin(axis=1)]
        out[str(group) or "all"] = list(problem.labels[near] == problem.labels[queries])
    return out


def as_toml(weights: np.ndarray, mirror: float) -> str:
    """The tables of the preset that the search decides."""
    lines = [f"mirror = {max(mirror, 1):.2f}", "", "[options.parts.weights]"]
    order = np.argsort(-weights)
    return "\n".join(lines + [f'"{TERMS[i]}" = {weights[i]:.3g}' for i in order if weights[i] > 0])


def main() -> int:
    """Search, print the preset's weights, and test the choice on subjects that it has not seen."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=3)
    parser.add_argument("--kernel", default="auto")
    parser.add_argument("--nested", action="store_true", help="repeat the search without each subject")
    parser.add_argument("--cache", type=Path, help="folder of your own that keeps the matrices")
    given = parser.parse_args()
    readers = {"utd_openpose": utd_openpose, "utd_skeleton": utd_skeleton}
    readers |= {"body_gesture": body_gesture, "pose_trainer": pose_trainer}
    sources = {name: read(given.shared) for name, read in readers.items()}
    problems = [
        kept(given.cache, name) or load(name, items, given.kernel, given.cache)
        for name, items in sources.items()
    ]
    weights, mirror, loss = search(problems, given.starts)
    print(f"loss {loss:.4f}\n{as_toml(weights, mirror)}\n", flush=True)
    if not given.nested:
        return 0
    rest = [p for p in problems if p.name != "utd_openpose"]
    weights, mirror, _ = search(rest, given.starts)
    print(f"without utd_openpose:\n{as_toml(weights, mirror)}\n", flush=True)
    for problem in problems[:3]:
        right: dict[str, list[bool]] = {}
        for subject in np.unique(problem.subjects):
            without = problem.take(np.flatnonzero(problem.subjects != subject))
            others = [p for p in problems if p is not problem]
            weights, mirror, _ = search([*others, without], given.starts)
            for group, hits in tested(problem, subject, weights, mirror).items():
                right.setdefault(group, []).extend(hits)
        shares = "  ".join(f"{g} {sum(h)}/{len(h)} {100 * np.mean(h):.1f} %" for g, h in right.items())
        print(f"nested, {problem.name}: {shares}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
