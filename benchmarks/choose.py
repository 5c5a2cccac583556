"""How the weights of the preset `modern` were chosen, and what that choice is worth on unseen subjects.

    python benchmarks/choose.py [--videos FOLDER ...] [--starts 2] [--nested] [--cache FOLDER]

Every candidate (`parts` terms such as ``wrist.energy``) gets a matrix of warping distances of its
own, once as performed and once mirrored, and the size of every sequence in what each pair has in
common. The preset's distance is the weighted sum of the matrices over the weighted sizes, by the same
rule for missing joints as in the product, so it can be had for any weights without another warping,
and its gradient too. The loss is that of a soft nearest
neighbour (Goldberger et al. 2005): under leave-one-subject-out, summed over the data sets and their
groups of classes, and with one example a class from a single subject. A penalty on the roots of the
weights takes candidates out. Adam (Kingma and Ba 2015) descends from random starts; the lowest loss
wins. ``--videos`` adds body_gesture as networks see it (folders of benchmarks/videos.py).

``--nested`` repeats the whole descent for each subject of each data set with that subject taken out
of all versions of it, and tests the weights on it, decided as the preset decides: the honest estimate
beside the figures of the one preset, which has seen all subjects. ``--nested FAMILY`` does so for the
subjects of one family alone. ``--wrong N`` adds each clip of utd_openpose and body_gesture with N wrong
frames of one of the kinds of benchmarks/damage.py, at the same weight. The loss of the preset as it is
shipped stands beside that of the choice. Needs torch.
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
from damage import BAD_FRAMES
from datasets import Item, arguments, body_gesture, pose_trainer, utd_openpose, utd_skeleton
from videos import with_videos

from gesture_core.classify.comparison import Extents, common_sum, compare
from gesture_core.settings import Settings, load_settings
from gesture_core.signals.chain import Chain
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals

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
VIDEOS = 0.25
STEPS = 100
LARGE = 300
FAR = 1e6
SMALLEST = 0.01
_WEIGHTS = {"pose_trainer": 0.3, "utd_openpose, wrong": 1.0, "body_gesture, wrong": 1.0}
FACTS = ("labels", "subjects", "groups", "names", "frames", "still")
MATRICES = ("same", "other", "common", "common_other")


@dataclass(frozen=True, eq=False)
class Problem:
    """One data set: its items and, for each term, distances as performed and mirrored, and sizes.

    ``common`` and ``common_other`` are the sizes of the first of a pair in what both have of a term.
    """

    name: str
    labels: np.ndarray
    subjects: np.ndarray
    groups: np.ndarray
    names: np.ndarray
    frames: np.ndarray
    still: np.ndarray
    same: np.ndarray
    other: np.ndarray
    common: np.ndarray
    common_other: np.ndarray
    sizes: np.ndarray

    def take(self, kept: np.ndarray) -> Problem:
        """The problem among the items in ``kept``."""
        matrices = {key: getattr(self, key)[:, kept][:, :, kept] for key in MATRICES}
        facts = {key: getattr(self, key)[kept] for key in FACTS}
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
        """The four matrices as (N * N, T), sizes (N, T), frames, and which pairs are still apart."""
        import torch

        terms = len(self.same)
        pairs = [torch.tensor(getattr(self, key).reshape(terms, -1).T.copy()) for key in MATRICES]
        apart = torch.tensor(self.still[:, None] & ~self.still[None])
        return *pairs, torch.tensor(self.sizes.T.copy()), torch.tensor(np.float32(self.frames)), apart

    @cached_property
    def whole(self) -> bool:
        """Whether no joint of any term is missing anywhere."""
        sizes = self.sizes[:, :, None]
        return bool((self.common == sizes).all() and (self.common_other == sizes).all())

    @cached_property
    def units(self) -> np.ndarray:
        """(T,) usual distance of each term, NaN for one that nobody has."""
        upper = np.triu_indices(len(self.labels), 1)
        found = np.where(self.same[:, *upper] > 0, self.same[:, *upper], np.nan)
        return np.array([np.nanmedian(f) if np.isfinite(f).any() else np.nan for f in found])

    def distances(self, weights: Any, mirror: Any, rest: Any) -> Any:
        """(N, N) distances under torch ``weights``, as `gesture_core.classify.comparison` computes them."""
        import torch

        same, other, common, common_other, sizes, frames, apart = self.tensors
        size = sizes @ weights
        rest = rest * frames * (size.median() / frames.median()).detach()
        size = size + rest
        both = torch.sqrt(size[:, None] * size[None])
        readings = []
        for sums, held in ((same, common), (other, common_other)):
            by = both
            if not self.whole:
                own = (held @ weights).reshape(both.shape) + rest[:, None]
                by = own * own.T / both
            readings.append((sums @ weights).reshape(both.shape) / by.clamp_min(1e-9))
        nearer = torch.minimum(readings[0], readings[1] * mirror)
        return torch.where(apart, torch.tensor(FAR), nearer)

    @cached_property
    def donors(self) -> tuple[Any, Any]:
        """(K, C) one trial a class of a subject, up to four trials in turn, and (K, N) who else is asked."""
        import torch

        examples, asked = [], []
        for subject in np.unique(self.subjects):
            members = [np.flatnonzero((self.subjects == subject) & (self.codes == c)) for c in self.classes]
            if all(len(m) for m in members):
                for trial in range(max(len(m) for m in members)):
                    examples.append([m[trial % len(m)] for m in members])
                    asked.append(self.subjects != subject)
        return torch.tensor(np.array(examples)), torch.tensor(np.array(asked, np.float32))

    @property
    def classes(self) -> np.ndarray:
        """(C,) the codes of the classes."""
        return np.unique(self.codes)


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
        distances = found.numpy().astype(np.float64)
        return np.where(distances < FAR, distances, np.inf)


def problem_loss(problem: Problem, distances: Any) -> Any:
    """Soft nearest-neighbour loss of one data set: of all items, of each group, of single donors."""
    import torch

    logs = torch.log(distances.clamp_min(1e-12))
    strangers = torch.tensor(problem.subjects[:, None] != problem.subjects[None])
    apart = torch.where(strangers, logs, torch.inf)
    groups = np.unique(problem.groups)
    total = torch.tensor(0.0)
    everyone = np.ones(len(problem.labels), bool)
    for own in (everyone, *(problem.groups == group for group in groups if len(groups) > 1)):
        classes, codes = np.unique(problem.codes[own], return_inverse=True)
        members = [torch.tensor(np.flatnonzero(own & (problem.codes == c))) for c in classes]
        nearest = torch.stack([apart[:, m].amin(dim=1) for m in members], dim=1)
        total = total + soft_loss(nearest[torch.tensor(own)], torch.tensor(codes)).mean()
    if problem.name in ("utd_openpose", "utd_skeleton"):
        examples, asked = problem.donors
        codes = torch.tensor(problem.codes)[:, None].expand(-1, len(examples))
        losses = soft_loss(logs[:, examples].flatten(0, 1), codes.flatten()).reshape(codes.shape).T
        share = (losses * asked).sum(dim=1) / asked.sum(dim=1)
        total = total + (DONOR if problem.name == "utd_openpose" else 1.0) * share.mean()
    return total * _WEIGHTS.get(problem.name, VIDEOS if "," in problem.name else 1.0)


def soft_loss(nearest: Any, own: Any) -> Any:
    """(Q,) 1 - p(own class), p falling with the power `SHARPNESS` of the distance to each class.

    ``nearest`` are (Q, C) logarithms of the distances, ``own`` (Q,) the columns of the own classes.
    """
    import torch

    return 1 - torch.softmax(-SHARPNESS * nearest, dim=1).gather(1, own[:, None])[:, 0]


def search(problems: list[Problem], starts: int) -> Choice:
    """The choice of the lowest loss of several starts."""
    found = [descend(thinned(problems), seed) for seed in range(starts)]
    return min(found, key=lambda choice: choice.loss)


def thinned(problems: list[Problem]) -> list[Problem]:
    """Every other item of the large ones."""
    return [p.take(np.arange(0, len(p.labels), 2)) if len(p.labels) > LARGE else p for p in problems]


def descend(problems: list[Problem], seed: int) -> Choice:
    """One descent on the logarithms of the weights."""
    import torch

    # Terms differ in their unit; a weight of one means the same share of the distance for each.
    unit = torch.tensor(np.float32(np.nanmean([p.units for p in problems], axis=0)))
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


def shipped(problems: list[Problem]) -> Choice:
    """What the preset holds, and its loss."""
    import torch

    modern = load_settings("modern")
    given = modern.options["parts"]["weights"]
    weights = np.float32([given.get(term, 0.0) for term in TERMS])
    rest = modern.classify.rest / float(np.exp(np.mean(np.log(_sizes(weights, problems)))))
    choice = Choice(weights, float(modern.classify.mirror), rest, 0.0)
    shares = weights * np.nanmean([p.units for p in problems], axis=0)
    with torch.no_grad():
        loss = PENALTY * float(np.sqrt(shares / shares.sum() + 1e-5).sum())
        for problem in problems:
            found = problem.distances(torch.tensor(weights), choice.mirror, rest)
            loss += float(problem_loss(problem, found))
    return replace(choice, loss=loss)


def _sizes(weights: np.ndarray, problems: list[Problem]) -> list[float]:
    return [float(np.median(weights @ p.sizes) / np.median(p.frames)) for p in problems]


def wrong(items: list[Item], count: int) -> list[Item]:
    """The items with so many wrong frames each, of all kinds in turn."""
    random = np.random.default_rng(7)
    kinds = [BAD_FRAMES[i % len(BAD_FRAMES)] for i in range(len(items))]
    return [
        replace(item, pose=kind.damage(item.pose, count, random))
        for item, kind in zip(items, kinds, strict=True)
    ]


def load(name: str, read: Callable[[], list[Item]], kernel: str, folder: Path | None) -> Problem:
    """Distances and sizes of every term on one data set, kept in ``folder`` where one is given."""
    path = folder / f"{name}.npz" if folder else None
    fields = (*FACTS, *MATRICES, "sizes")
    if path is not None and path.is_file():
        with np.load(path, allow_pickle=False) as archive:
            return Problem(name, *(archive[key] for key in fields))
    items = read()
    facts = [
        np.array([getattr(item, key) for item in items]) for key in ("label", "subject", "group", "name")
    ]
    modern = load_settings("modern", classify__kernel=kernel)
    still = [not signals.selected for signals in _signals(modern, items)]
    plain = {"coverage": False, "mirror": None, "relative": None, "separate": False}
    modern = replace(modern, classify=replace(modern.classify, **plain))
    modern = replace(modern, signals=replace(modern.signals, selector="all"))
    found: dict[str, list[np.ndarray]] = {key: [] for key in (*MATRICES, "sizes")}
    for term in TERMS:
        signals = _signals(
            replace(modern, options={**modern.options, "parts": {"weights": {term: 1.0}}}), items
        )
        squares = np.array([np.square(s.values, dtype=np.float64).sum(axis=0) for s in signals])
        for tail, series in (("", signals), ("_other", [mirrored(s) for s in signals])):
            distances = compare(signals, series, modern)
            found["other" if tail else "same"].append(np.where(np.isfinite(distances), distances, 0.0))
            found["common" + tail].append(common_sum(Extents.of(signals), Extents.of(series), squares, 1.0))
        found["sizes"].append(squares.sum(axis=1))
    frames = np.array([len(s) for s in signals])
    arrays = {key: np.array(values, np.float32) for key, values in found.items()}
    problem = Problem(name, *facts, frames, np.array(still), **arrays)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **{key: getattr(problem, key) for key in fields})
    return problem


def _signals(settings: Settings, items: list[Item]) -> list[Signals]:
    chain = replace(Chain.from_settings(settings), allow_still=True)
    return [chain(item.pose) for item in items]


def as_toml(choice: Choice, problems: list[Problem]) -> str:
    """The values of the preset that the search decides."""
    rest = choice.rest * float(np.exp(np.mean(np.log(_sizes(choice.weights, problems)))))
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
    parser.add_argument("--wrong", type=int, default=0, help="wrong frames in further versions of the clips")
    families = ("utd_openpose", "utd_skeleton", "body_gesture")
    parser.add_argument(
        "--nested", nargs="*", choices=families, help="repeat the search without each subject, of these sets"
    )
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
    for read in (utd_openpose, body_gesture) if given.wrong else ():
        sources[f"{read.__name__}, wrong"] = lambda read=read: wrong(read(given.shared), given.wrong)  # type: ignore[misc]
    problems = [load(name, read, given.kernel, given.cache) for name, read in sources.items()]
    print(f"loss of the preset as shipped {shipped(thinned(problems)).loss:.4f}", flush=True)
    choice = search(problems, given.starts)
    print(f"loss {choice.loss:.4f}\n{as_toml(choice, problems)}\n", flush=True)
    if given.nested is None:
        return 0
    for family in given.nested or families:
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
