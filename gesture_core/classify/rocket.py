"""Classifiers that look at the signals: random convolutions, and their sum with the weighed examples.

MiniRocket (Dempster, Schmidt and Webb 2021): a sequence is described by how often each of a few hundred
convolutions with fixed kernels exceeds some levels, and a ridge regression on these shares separates the
classes. It sees the shape of a movement where warping sees its way, and is wrong elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gesture_core.classify.classifiers import Series, State, Weighed, left_out
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals

_PLACES = 9
_KERNELS = np.array(list(combinations(range(_PLACES), 3)))
"""Places of the three weights of 2 among nine; the others are -1."""
_CHANNELS = 9
"""Channels that a kernel looks at, at most."""
_PENALTIES = np.logspace(-2, 4, 13)
_FLAT = 0.1
"""Part of the usual deviation that is added to that of a channel before it divides: jitter stays small."""
_GOLDEN = (np.sqrt(5) + 1) / 2


@dataclass(frozen=True)
class Rocket:
    """Ridge regression on random convolutions: MiniRocket, on channels of zero mean and unit deviation.

    Every sequence is resampled to one length. Where examples also stand for the other hand, their mirror
    images teach too, and a query is asked about in both forms. Channels that a sequence lacks are zero.

    Parameters
    ----------
    mirror : float, optional
        That of [classify].
    features : int
        How many shares; 840 say as much as 4,956.
    frames : int
        Length of a sequence.
    seed : int
        Of the channels that each kernel looks at, and of the examples that give the levels.
    """

    mirror: float | None = None
    features: int = 840
    frames: int = 64
    seed: int = 0
    least = 1
    compares = False

    def __post_init__(self) -> None:
        if self.features < len(_KERNELS):
            raise ValueError(f"{self.features} features: {len(_KERNELS)} at least, one of each kernel")
        if self.frames < _PLACES:
            raise ValueError(f"{self.frames} frames: {_PLACES} at least, the length of a kernel")

    def fit(
        self,
        examples: Series,
        codes: np.ndarray,
        classes: int,
        distances: np.ndarray | None,
        marks: np.ndarray,
    ) -> State:
        """Levels of the convolutions, and the weights of the shares."""
        described, state = self._described(examples)
        weights, _ = ridge(described, codes, classes)
        return {**state, **weights}

    def left_out(
        self, examples: Series, codes: np.ndarray, classes: int, distances: np.ndarray
    ) -> np.ndarray:
        """(N, C): leaving out is exact for the regression; the levels are those of all examples."""
        described, _ = self._described(examples)
        scores: np.ndarray = ridge(described, codes, classes)[1]
        return scores

    def scores(self, state: State, queries: Series, distances: np.ndarray) -> np.ndarray:
        """(Q, C), the mean of what both forms get."""
        forms = [self._shares(form, state) for form in self._forms(queries, state["usual"])]
        # One row at a time: the bits of a row do not depend on its batch.
        rows = [(row - state["mean"]) @ state["weights"] for row in np.mean(forms, axis=0)]
        return np.array(rows).reshape(len(queries), state["weights"].shape[1])

    def _described(self, examples: Series) -> tuple[list[np.ndarray], State]:
        """The shares of the examples in each form, and what they were made with."""
        usual = usual_deviation(examples, self.frames)
        forms = self._forms(examples, usual)
        state = {**self._levels(np.concatenate(forms)), "usual": usual}
        return [self._shares(form, state) for form in forms], state

    def _forms(self, series: Series, usual: np.ndarray) -> list[np.ndarray]:
        """(N, D, frames) float32 of the sequences as they are, and mirrored where that counts."""
        forms = [list(series)]
        if self.mirror is not None and all(isinstance(item, Signals) for item in series):
            forms.append([mirrored(item) for item in series if isinstance(item, Signals)])
        return [standardised(form, usual, self.frames) for form in forms]

    def _levels(self, sequences: np.ndarray) -> State:
        """For each dilation the weights of the kernels over channels and places, and their levels."""
        random = np.random.default_rng(self.seed)
        channels, frames = sequences.shape[1:]
        most, state, done = min(channels, _CHANNELS), {}, 0
        for dilation, count in dilations(frames, self.features // len(_KERNELS)):
            kernels = np.zeros((len(_KERNELS), channels, _PLACES), np.float32)
            levels = np.empty((len(_KERNELS), count), np.float32)
            for index, three in enumerate(_KERNELS):
                number = int(2 ** random.uniform(0, np.log2(most + 1)))
                seen = random.choice(channels, min(max(number, 1), most), replace=False)
                kernels[index, seen] = -1
                kernels[np.ix_([index], seen, three)] = 2
                found = kernels[index].reshape(-1) @ _shifted(
                    sequences[random.integers(len(sequences))], dilation
                )
                # Levels are quantiles of what one example gives, spread evenly by the golden ratio.
                levels[index] = np.quantile(found, (np.arange(done + 1, done + count + 1) * _GOLDEN) % 1)
                done += count
            state[f"kernels.{dilation}"] = kernels.reshape(len(_KERNELS), -1)
            state[f"levels.{dilation}"] = levels
        return state

    def _shares(self, sequences: np.ndarray, state: State) -> np.ndarray:
        """(N, F) float32: how much of each convolution is above each of its levels."""
        steps = [int(name.partition(".")[2]) for name in state if name.startswith("levels.")]
        rows = []
        for sequence in sequences:
            row = []
            for number, step in enumerate(steps):
                found = state[f"kernels.{step}"] @ _shifted(sequence, step)
                levels = state[f"levels.{step}"]
                # Every other kernel looks only where it lies inside the sequence, as the others may not.
                for inside in (0, 1):
                    own = slice((inside + number) % 2, None, 2)
                    edge = 4 * step if inside and found.shape[1] > 8 * step else 0
                    part = found[own, edge : found.shape[1] - edge]
                    row.append((part[:, None, :] > levels[own][:, :, None]).mean(axis=2).reshape(-1))
            rows.append(np.concatenate(row))
        return np.array(rows, np.float32)


@dataclass(frozen=True)
class Blend:
    """The scores of ``weighed`` and a quarter of those of ``rocket``, as a mean.

    Both are ridge regressions on the same targets, so that nothing has to be fitted to add them. Where no
    class has two examples, ``weighed`` alone decides.

    Parameters
    ----------
    sharpness, shrinkage, mirror
        Those of [classify].
    weight : float
        Of ``rocket``, where ``weighed`` has 1. With 0.5 actions of the whole body gain more, and gestures of
        the hands in front of the body lose.
    """

    sharpness: float = 3.0
    shrinkage: float = 0.1
    mirror: float | None = None
    weight: float = 0.25
    least = 1
    compares = True

    def __post_init__(self) -> None:
        if not 0 <= self.weight < float("inf"):
            raise ValueError(f"weight {self.weight} is no finite number of zero or more")

    @property
    def _weighed(self) -> Weighed:
        return Weighed(self.sharpness, self.shrinkage)

    @property
    def _rocket(self) -> Rocket:
        return Rocket(self.mirror)

    def _shares(self, alone: bool) -> tuple[float, float]:
        """Of both members in the scores."""
        weight = 0.0 if alone else self.weight
        return 1 / (1 + weight), weight / (1 + weight)

    def fit(
        self,
        examples: Series,
        codes: np.ndarray,
        classes: int,
        distances: np.ndarray | None,
        marks: np.ndarray,
    ) -> State:
        """What both learn, with their names in front."""
        state = self._weighed.fit(examples, codes, classes, distances, marks)
        found = {f"weighed.{name}": array for name, array in state.items()}
        if _alone(codes) or not len(examples):
            return found
        state = self._rocket.fit(examples, codes, classes, distances, marks)
        return found | {f"rocket.{name}": array for name, array in state.items()}

    def scores(self, state: State, queries: Series, distances: np.ndarray) -> np.ndarray:
        """(Q, C)."""
        return self.ordered(state, queries, distances)[0]

    def ordered(self, state: State, queries: Series, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The scores; alone, ``weighed`` orders the classes as it does by itself."""
        both, own = self.members(state, queries, distances), _part(state, "weighed.")
        scores: np.ndarray = np.sum(list(both.values()), axis=0)
        return scores, self._weighed.ordered(own, queries, distances)[1] if len(both) == 1 else scores

    def members(self, state: State, queries: Series, distances: np.ndarray) -> Mapping[str, np.ndarray]:
        """What each adds to the scores."""
        learned = _part(state, "rocket.")
        ours, theirs = self._shares(not learned)
        weighed = ours * self._weighed.scores(_part(state, "weighed."), queries, distances)
        if not learned:
            return {"weighed alone, no class has two examples": weighed}
        return {"weighed": weighed, "rocket": theirs * self._rocket.scores(learned, queries, distances)}

    def contributions(self, state: State, distances: np.ndarray) -> np.ndarray:
        """(Q, M, C) what each example adds through ``weighed``."""
        ours, _ = self._shares(not _part(state, "rocket."))
        return ours * self._weighed.contributions(_part(state, "weighed."), distances)

    def left_out(
        self, examples: Series, codes: np.ndarray, classes: int, distances: np.ndarray
    ) -> np.ndarray:
        """(N, C)."""
        alone = _alone(codes) or not len(examples)
        ours, theirs = self._shares(alone)
        scores = ours * left_out(self._weighed, examples, codes, classes, distances)
        if alone:
            return scores
        return scores + theirs * self._rocket.left_out(examples, codes, classes, distances)


def _alone(codes: np.ndarray) -> bool:
    """Whether no class has two examples."""
    return int(np.bincount(codes).max()) < 2


def _part(state: State, prefix: str) -> State:
    return {name.removeprefix(prefix): array for name, array in state.items() if name.startswith(prefix)}


def dilations(frames: int, each: int) -> list[tuple[int, int]]:
    """How far apart the places of a kernel are, and how many levels each such kernel has; ``each`` in all.

    They grow exponentially from 1 to what the length allows (Dempster, Schmidt and Webb 2021).
    """
    top = np.log2(max((frames - 1) / 8, 1))
    steps, counts = np.unique(np.logspace(0, top, min(each, 32), base=2).astype(int), return_counts=True)
    counts = counts * each // min(each, 32)
    counts[: each - counts.sum()] += 1
    return list(zip(steps.tolist(), counts.tolist(), strict=True))


def _shifted(sequence: np.ndarray, step: int) -> np.ndarray:
    """(D * 9, T) of a (D, T) sequence: each channel as each place of a kernel sees it, zero outside."""
    channels, frames = sequence.shape
    padded = np.zeros((channels, frames + 8 * step), sequence.dtype)
    padded[:, 4 * step : 4 * step + frames] = sequence
    seen = [padded[:, step * place : step * place + frames] for place in range(9)]
    return np.stack(seen, axis=1).reshape(channels * 9, frames)


def standardised(series: Series, usual: np.ndarray, frames: int) -> np.ndarray:
    """(N, D, frames) float32: resampled, each channel with zero mean and unit deviation in each sequence."""
    found = np.array([_resampled(item, frames) for item in series]).reshape(len(series), -1, frames)
    found -= found.mean(axis=2, keepdims=True)
    found /= found.std(axis=2, keepdims=True) + _FLAT * usual
    return found.astype(np.float32)


def usual_deviation(series: Series, frames: int) -> np.ndarray:
    """Root mean square of the deviations of all channels of all sequences; 1 where nothing ever moves."""
    square = np.mean([_resampled(item, frames).var(axis=1).mean() for item in series])
    return np.array(np.sqrt(square) if square > 0 else 1.0)


def _resampled(item: Signals | np.ndarray, frames: int) -> np.ndarray:
    """(D, frames) float64 by linear interpolation from the first frame to the last one."""
    values = np.asarray(item.values if isinstance(item, Signals) else item, np.float64)
    if isinstance(item, Signals):
        values = np.where(np.asarray(item.present), values, 0.0)
    places = np.linspace(0, len(values) - 1, frames)
    before = np.minimum(places.astype(int), len(values) - 1)
    after, share = np.minimum(before + 1, len(values) - 1), (places - places.astype(int))[:, None]
    found: np.ndarray = (values[before] * (1 - share) + values[after] * share).T
    return found


def ridge(
    forms: Sequence[np.ndarray], codes: np.ndarray, classes: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Ridge regression of the classes on (N, F) shares in one or two forms, all of which teach.

    Targets are 1 for the own class and 0 for others, less the means. The penalty is the one under which the
    examples, each left out in all its forms, are hit best.

    Returns
    -------
    weights : mapping
        ``mean`` (F,) and ``weights`` (F, C): a score is ``(shares - mean) @ weights``.
    scores : (N, C)
        Of each example by all others, the mean over its forms.
    """
    shares = np.concatenate(forms).astype(np.float64)
    mean, spread = shares.mean(axis=0), shares.std(axis=0)
    scale = 1 / ((spread + 1e-8) * np.sqrt(shares.shape[1]))
    known = (shares - mean) * scale
    targets = np.eye(classes)[np.tile(codes, len(forms))]
    targets -= targets.mean(axis=0)
    # With known = U S V', what is left out of the residuals needs the rows of U alone.
    left, sizes, right = np.linalg.svd(known, full_matrices=False)
    seen, count = left.T @ targets, len(codes)
    best: tuple[float, float, np.ndarray] | None = None
    for penalty in _PENALTIES:
        kept = sizes**2 / (sizes**2 + penalty)
        residuals = targets - left @ (kept[:, None] * seen)
        twins = left.reshape(len(forms), count, -1)
        # I minus the hat matrix among the forms of an example, inverted, undoes what they taught.
        hats = np.einsum("anr,r,bnr->nab", twins, kept, twins)
        own = residuals.reshape(len(forms), count, classes).transpose(1, 0, 2)
        missed = np.linalg.solve(np.eye(len(forms)) - hats, own)
        error = float((missed**2).sum())
        if best is None or error < best[0]:
            guessed = targets.reshape(len(forms), count, classes) - missed.transpose(1, 0, 2)
            best = error, float(penalty), guessed.mean(axis=0)
    assert best is not None
    weights = right.T @ ((sizes / (sizes**2 + best[1]))[:, None] * seen)
    return {"mean": mean, "weights": scale[:, None] * weights}, best[2]
