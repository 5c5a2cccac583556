"""How the weights of the preset `modern` were chosen, and what that choice is worth on unseen subjects.

    python benchmarks/choose.py [--videos FOLDER ...] [--starts 2] [--nested] [--cache FOLDER]

Every candidate (`parts` terms such as ``wrist.energy``) gets a matrix of warping distances of its
own, once as performed and once mirrored, and the size of every sequence. The preset's distance is
the weighted sum of the matrices over the geometric mean of the weighted sizes, so it can be had for
any weights without another warping, and its gradient too. The loss is that of a soft nearest
neighbour (Goldberger et al. 2005): under leave-one-subject-out, summed over the data sets and their
groups of classes, and with one example a class from a single subject. A penalty on the roots of the
weights takes candidates out. Adam (Kingma and Ba 2015) descends from random starts; the lowest loss
wins. ``--videos`` adds body_gesture as networks see it (folders of benchmarks/videos.py).

``--nested`` repeats the whole descent for each subject of each data set with that subject taken out
of all versions of it, and tests the weights on it: the honest estimate beside the figures of the one
preset, which has seen all subjects. Needs torch.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from choose_tests import tested
from datasets import Item, arguments, body_gesture, pose_trainer, utd_openpose, utd_skeleton
from videos import with_videos

from gesture_core.classify.comparison import compare
from gesture_core.settings import load_settings
from gesture_core.signals.chain import Chain
from gesture_core.signals.mirror import mirrored

TERMS = (
    "wrist", "wrist@0.5", "elbow@0.5", "elbow@1", "shoulder@1", "nose@0.5", "hip@1", "knee@1", "ankle@1",
    "forearm", "forearm@0.5", "upper_arm@0.5", "arm@0.5", "hands",
    "forearm.direction", "upper_arm.direction", "arm.bend",
    "wrist.velocity", "forearm.velocity", "wrist.energy", "forearm.energy", "hands.energy",
    "wrist.spread", "forearm.turning",
)  # fmt: skip
PENALTY = 0.04
SHARPNESS = 12.0
DONOR = 3.0
VIDEOS = 0.5
STEPS = 100
LARGE = 300
SMALLEST = 0.01


@dataclass(frozen=True, eq=False)
class Problem:
    """One data set: its items and, for each term, distances as performed and mirrored, and sizes."""

    name: str
    labels: np.ndarray
    subjects: np.ndarray
    groups: np.ndarray
    names: np.ndarray
    frames: np.ndarray
    same: np.ndarray
    other: np.ndarray
    sizes: np.ndarray

    def take(self, kept: np.ndarray) -> Problem:
        """The problem among the items in ``kept``."""
        matrices = {key: getattr(self, key)[:, kept][:, :, kept] for key in ("same", "other")}
        facts = {k: getattr(self, k)[kept] for k in ("labels", "subjects", "groups", "names", "frames")}
        return replace(self, sizes=self.sizes[:, kept], **facts, **matrices)

    def without(self, subject: str) -> Problem:
        """The problem as if ``subject`` had never been recorded."""
        return self.take(np.flatnonzero(self.subjects != subject))

    @cached_property
    def codes(self) -> np.ndarray:
        """(N,) class of each item."""
        return np.unique(self.labels, return_inverse=True)[1]

    @cached_property
    def tensors(self) -> tuple[Any, ...]:
        """Pairs above the diagonal (the matrices are symmetric), and the place of each pair of items."""
        import torch

        n = len(self.labels)
        upper = np.triu_indices(n, 1)
        where = np.zeros((n, n), np.int64)
        where[upper] = np.arange(len(upper[0]))
        where = np.maximum(where, where.T)
        pairs = [torch.tensor(np.ascontiguousarray(m[:, *upper].T)) for m in (self.same, self.other)]
        return *pairs, torch.tensor(where), torch.tensor(self.sizes), torch.tensor(np.float32(self.frames))

    def distances(self, weights: Any, mirror: Any, rest: Any) -> Any:
        """(N, N) distances under torch ``weights``."""
        import torch

        same, other, where, sizes, frames = self.tensors
        nearer = torch.minimum(same @ weights, (other @ weights) * mirror)[where]
        size = weights @ sizes
        size = size + rest * frames * size.detach().median() / frames.median()
        return nearer / torch.sqrt(size[:, None] * size[None])

    @cached_property
    def donors(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Queries and examples: one trial a class of each subject, up to four trials in turn."""
        found = []
        for subject in np.unique(self.subjects):
            members = [
                np.flatnonzero((self.subjects == subject) & (self.codes == c)) for c in np.unique(self.codes)
            ]
            members = [m for m in members if len(m)]
            for trial in range(max(len(m) for m in members)):
                examples = np.array([m[trial % len(m)] for m in members])
                known = np.isin(self.codes, self.codes[examples])
                found.append((np.flatnonzero((self.subjects != subject) & known), examples))
        return found


@dataclass(frozen=True, eq=False)
class Choice:
    """What a search found: a weight for each term, the price of a mirror, the size of a frame at rest."""

    weights: np.ndarray
    mirror: float
    rest: float
    loss: float

    def distances(self, problem: Problem) -> np.ndarray:
        """(N, N) distances."""
        import torch

        with torch.no_grad():
            found = problem.distances(torch.tensor(self.weights), self.mirror, self.rest)
        return found.numpy().astype(np.float64)


def problem_loss(problem: Problem, distances: Any) -> Any:
    """Soft nearest-neighbour loss of one data set: of all items, of each group, of single donors."""
    import torch

    strangers = torch.tensor(problem.subjects[:, None] != problem.subjects[None])
    apart = torch.where(strangers, distances, torch.tensor(1e9))
    total = soft_loss(apart, problem.codes, problem.codes)
    groups = np.unique(problem.groups)
    for group in groups if len(groups) > 1 else ():
        own = np.flatnonzero(problem.groups == group)
        total = total + soft_loss(apart[own][:, own], problem.codes[own], problem.codes[own])
    if problem.name.startswith("utd"):
        losses = [
            soft_loss(distances[q][:, e], problem.codes[q], problem.codes[e]) for q, e in problem.donors
        ]
        total = total + (DONOR if problem.name == "utd_openpose" else 1.0) * torch.stack(losses).mean()
    return total * {"pose_trainer": 0.3}.get(problem.name, VIDEOS if "," in problem.name else 1.0)


def soft_loss(distances: Any, queries: np.ndarray, examples: np.ndarray) -> Any:
    """Mean of 1 - p(own class), p falling with the power `SHARPNESS` of the distance to each class."""
    import torch

    classes, codes = np.unique(examples, return_inverse=True)
    to = torch.tensor(codes)[None].expand(len(queries), -1)
    nearest = torch.full((len(queries), len(classes)), torch.inf).scatter_reduce(1, to, distances, "amin")
    chances = torch.softmax(-SHARPNESS * torch.log(nearest.clamp_min(1e-12)), dim=1)
    own = torch.tensor(np.searchsorted(classes, queries))
    return 1 - chances[torch.arange(len(queries)), own].mean()


def search(problems: list[Problem], starts: int) -> Choice:
    """The choice of the lowest loss of several starts."""
    thin = [p.take(np.arange(0, len(p.labels), 2)) if len(p.labels) > LARGE else p for p in problems]
    found = [descend(thin, seed) for seed in range(starts)]
    return min(found, key=lambda choice: choice.loss)


def descend(problems: list[Problem], seed: int) -> Choice:
    """One descent on the logarithms of the weights."""
    import torch

    # Terms differ in their unit; a weight of one means the same share of the distance for each.
    unit = torch.stack([torch.stack([p.tensors[0][:, t].median() for p in problems]).mean() for t in each()])
    random = torch.Generator().manual_seed(seed)
    weights = torch.log(torch.rand(len(TERMS), generator=random) * 0.3 + 0.05).requires_grad_()
    price, rest = torch.tensor(-1.5, requires_grad=True), torch.tensor(-3.9, requires_grad=True)
    adam = torch.optim.Adam([{"params": [weights]}, {"params": [price, rest], "lr": 0.05}], lr=0.08)
    for _ in range(STEPS):
        adam.zero_grad()
        shares = torch.softmax(weights, dim=0)
        mirror, still = 1 + torch.exp(price), torch.exp(rest)
        loss = PENALTY * torch.sqrt(shares + 1e-5).sum()
        for problem in problems:
            loss = loss + problem_loss(problem, problem.distances(shares / unit, mirror, still))
        loss.backward()
        adam.step()
    with torch.no_grad():
        shares = torch.softmax(weights, dim=0)
        shares = torch.where(shares < SMALLEST, 0.0, shares) / unit
    found = (float(value.detach()) for value in (mirror, still, loss))
    return Choice((shares / shares.max()).numpy(), *found)


def each() -> range:
    """The terms' indices."""
    return range(len(TERMS))


def load(name: str, read: Callable[[], list[Item]], kernel: str, folder: Path | None) -> Problem:
    """Distances and sizes of every term on one data set, kept in ``folder`` where one is given."""
    path = folder / f"{name}.npz" if folder else None
    fields = ("labels", "subjects", "groups", "names", "frames", "same", "other", "sizes")
    if path is not None and path.is_file():
        with np.load(path, allow_pickle=False) as archive:
            return Problem(name, *(archive[key] for key in fields))
    items = read()
    facts = [
        np.array([getattr(item, key) for item in items]) for key in ("label", "subject", "group", "name")
    ]
    same, other, sizes = [], [], []
    for term in TERMS:
        modern = load_settings("modern", signals__selector="all", classify__kernel=kernel)
        modern = replace(modern, options={**modern.options, "parts": {"weights": {term: 1.0}}})
        plain = {"coverage": False, "mirror": None, "relative": None, "separate": False}
        modern = replace(modern, classify=replace(modern.classify, **plain))
        signals = replace(Chain.from_settings(modern), allow_still=True).all(item.pose for item in items)
        found = compare(signals, [*signals, *map(mirrored, signals)], modern)
        # A pair that lacks the joint is as far as pairs of this term usually are.
        found = np.where(np.isfinite(found), found, np.median(found[np.isfinite(found)]))
        same.append(found[:, : len(items)])
        other.append(found[:, len(items) :])
        sizes.append([float(np.square(s.values, dtype=np.float64).sum()) for s in signals])
    frames = np.array([len(s) for s in signals])
    problem = Problem(name, *facts, frames, np.float32(same), np.float32(other), np.float32(sizes))
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **{key: getattr(problem, key) for key in fields})
    return problem


def as_toml(choice: Choice, problems: list[Problem]) -> str:
    """The values of the preset that the search decides."""
    sizes = [np.median(choice.weights @ p.sizes) / np.median(p.frames) for p in problems]
    rest = choice.rest * float(np.exp(np.mean(np.log(sizes))))
    lines = [f"mirror = {choice.mirror:.2f}", f"rest = {rest:.2g}", "", "[options.parts.weights]"]
    order = np.argsort(-choice.weights)
    return "\n".join(
        lines + [f'"{TERMS[i]}" = {choice.weights[i]:.3g}' for i in order if choice.weights[i] > 0]
    )


def main() -> int:
    """Search, print the preset's values, and test the choice on subjects that it has not seen."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--kernel", default="auto")
    parser.add_argument("--videos", nargs="+", type=Path, default=[], help="folders of benchmarks/videos.py")
    parser.add_argument("--nested", action="store_true", help="repeat the search without each subject")
    parser.add_argument("--cache", type=Path, help="folder of your own that keeps the matrices")
    given = parser.parse_args()
    sources: dict[str, Callable[[], list[Item]]] = {
        read.__name__: lambda read=read: read(given.shared)  # type: ignore[misc]
        for read in (utd_openpose, utd_skeleton, body_gesture, pose_trainer)
    }
    for folder in given.videos:
        sources[f"body_gesture, {folder.name}"] = lambda folder=folder: with_videos(  # type: ignore[misc]
            body_gesture(given.shared), folder
        )
    problems = [load(name, read, given.kernel, given.cache) for name, read in sources.items()]
    choice = search(problems, given.starts)
    print(f"loss {choice.loss:.4f}\n{as_toml(choice, problems)}\n", flush=True)
    if not given.nested:
        return 0
    for family in ("utd_openpose", "utd_skeleton", "body_gesture"):
        own = [p for p in problems if p.name.startswith(family)]
        right: dict[str, list[bool]] = {}
        for subject in np.unique(own[0].subjects):
            seen = [p.without(subject) if p in own else p for p in problems]
            choice = search(seen, given.starts)
            for problem in own:
                for row, hits in tested(problem, subject, choice.distances(problem)).items():
                    right.setdefault(row, []).extend(hits)
        for row, hits in right.items():
            print(f"nested, {row}: {sum(hits)}/{len(hits)} {100 * np.mean(hits):.1f} %", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
