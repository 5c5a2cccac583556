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

from gesture_core.classify.classifiers import (
    Series,
    State,
    Table,
    Weighed,
    content_order,
    left_out,
    resampled,
)
from gesture_core.classify.learning import targets_of
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals

_PLACES = 9
_KERNELS = np.array(list(combinations(range(_PLACES), 3)))
"""Places of the three weights of 2 among nine; the others are -1."""
_WEIGHTS = np.where((np.arange(_PLACES) == _KERNELS[:, :, None]).any(axis=1), 2, -1).astype(np.float32)
_CHANNELS = 9
"""Channels that a kernel looks at, at most."""
_BLOCK = 16
"""Sequences that are convolved together: what they take stays in the processor's cache."""
_PENALTIES = np.logspace(-2, 4, 13)
_FLAT = 0.1
"""Part of the usual deviation that is added to that of a channel before it divides: jitter stays small."""
_ROCKET = "rocket."
"""In front of the names of what `Rocket` has learned."""
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
        self, examples: Series, codes: np.ndarray, classes: int, distances: Table, marks: np.ndarray
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
        if not queries:
            return np.empty((0, state["weights"].shape[1]))
        forms = [self._shares(form, state) for form in self._forms(queries, state["usual"])]
        # One row at a time: the bits of a row do not depend on its batch.
        return np.array([(row - state["mean"]) @ state["weights"] for row in np.mean(forms, axis=0)])

    def _described(self, examples: Series) -> tuple[list[np.ndarray], State]:
        """The shares of the examples in each form, and what they were made with."""
        usual = usual_deviation(examples, self.frames)
        forms = self._forms(examples, usual)
        order = content_order(examples)
        state = {**self._levels(np.concatenate([form[order] for form in forms])), "usual": usual}
        return [self._shares(form, state) for form in forms], state

    def _forms(self, series: Series, usual: np.ndarray) -> list[np.ndarray]:
        """(N, D, frames) float32 of the sequences as they are, and mirrored where that counts."""
        forms = [list(series)]
        if self.mirror is not None and all(isinstance(item, Signals) for item in series):
            forms.append([mirrored(item) for item in series if isinstance(item, Signals)])
        return [standardised(form, usual, self.frames) for form in forms]

    def _levels(self, sequences: np.ndarray) -> State:
        """For each dilation the channels that each kernel looks at, and its levels.

        These are drawn by the place of ``sequences``, which therefore come in an order that is their own.
        """
        random = np.random.default_rng(self.seed)
        channels, frames = sequences.shape[1:]
        most, state, done = min(channels, _CHANNELS), {}, 0
        for dilation, count in dilations(frames, self.features // len(_KERNELS)):
            seen = np.full((len(_KERNELS), most), -1)
            levels = np.empty((len(_KERNELS), count), np.float32)
            for index in range(len(_KERNELS)):
                number = min(max(int(2 ** random.uniform(0, np.log2(most + 1))), 1), most)
                seen[index, :number] = random.choice(channels, number, replace=False)
                one, own = random.integers(len(sequences)), slice(index, index + 1)
                found = _convolved(sequences[one : one + 1], seen[own], _WEIGHTS[own], dilation)
                # Levels are quantiles of what one example gives, spread evenly by the golden ratio.
                levels[index] = np.quantile(found, (np.arange(done + 1, done + count + 1) * _GOLDEN) % 1)
                done += count
            state[f"channels.{dilation}"] = seen
            state[f"levels.{dilation}"] = levels
        return state

    def _shares(self, sequences: np.ndarray, state: State) -> np.ndarray:
        """(N, F) float32: how much of each convolution is above each of its levels."""
        steps = [int(name.partition(".")[2]) for name in state if name.startswith("levels.")]
        shares: list[np.ndarray] = []
        for start in range(0, len(sequences), _BLOCK):
            some, columns = sequences[start : start + _BLOCK], []
            for number, step in enumerate(steps):
                found = _convolved(some, state[f"channels.{step}"], _WEIGHTS, step)
                levels = state[f"levels.{step}"]
                # Every other kernel looks only where it lies inside the sequence, as the others may not.
                for inside in (0, 1):
                    own = slice((inside + number) % 2, None, 2)
                    edge = 4 * step if inside and found.shape[2] > 8 * step else 0
                    part = found[:, own, edge : found.shape[2] - edge]
                    above = np.count_nonzero(part[:, :, None] > levels[own][:, :, None], axis=3)
                    columns.append(above.reshape(len(some), -1) / part.shape[2])
            shares.append(np.concatenate(columns, axis=1))
        return np.concatenate(shares).astype(np.float32)


@dataclass(frozen=True)
class Blend(Weighed):
    """The scores of ``weighed`` and a quarter of those of ``rocket``, as a mean.

    Both are ridge regressions on the same targets, so that nothing has to be fitted to add them. Where no
    class has two examples, or the weight is zero, ``weighed`` alone decides.

    Parameters
    ----------
    weight : float
        Of ``rocket``, where ``weighed`` has 1. With 0.5 actions of the whole body gain more, and gestures of
        the hands in front of the body lose.
    """

    mirror: float | None = None
    weight: float = 0.25

    def __post_init__(self) -> None:
        if not 0 <= self.weight < float("inf"):
            raise ValueError(f"weight {self.weight} is no finite number of zero or more")

    def fit(
        self, examples: Series, codes: np.ndarray, classes: int, distances: Table, marks: np.ndarray
    ) -> State:
        """What ``weighed`` learns, and what ``rocket`` does with its name in front."""
        state = super().fit(examples, codes, classes, distances, marks)
        if self._alone(examples, codes):
            return state
        learned = Rocket(self.mirror).fit(examples, codes, classes, distances, marks)
        return {**state, **{_ROCKET + name: array for name, array in learned.items()}}

    def ordered(self, state: State, queries: Series, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The scores; alone, ``weighed`` orders the classes as it does by itself."""
        both = self.members(state, queries, distances)
        if len(both) == 1:
            return super().ordered(state, queries, distances)
        scores: np.ndarray = np.sum(list(both.values()), axis=0)
        return scores, scores

    def members(self, state: State, queries: Series, distances: np.ndarray) -> Mapping[str, np.ndarray]:
        """What each adds to the scores."""
        learned = {n.removeprefix(_ROCKET): array for n, array in state.items() if n.startswith(_ROCKET)}
        weighed = super().ordered(state, queries, distances)[0]
        if not learned:
            return {"weighed": weighed}
        rocket = Rocket(self.mirror).scores(learned, queries, distances)
        return {"weighed": weighed / (1 + self.weight), "rocket": self._share * rocket}

    def contributions(self, state: State, distances: np.ndarray) -> np.ndarray:
        """(Q, M, C) what each example adds through ``weighed``."""
        alone = not any(name.startswith(_ROCKET) for name in state)
        return super().contributions(state, distances) / (1 if alone else 1 + self.weight)

    def left_out(
        self, examples: Series, codes: np.ndarray, classes: int, distances: np.ndarray
    ) -> np.ndarray:
        """(N, C)."""
        weighed = left_out(Weighed(self.sharpness, self.shrinkage), examples, codes, classes, distances)
        if self._alone(examples, codes):
            return weighed
        rocket = Rocket(self.mirror).left_out(examples, codes, classes, distances)
        return weighed / (1 + self.weight) + self._share * rocket

    @property
    def _share(self) -> float:
        """Of ``rocket`` in the scores."""
        return self.weight / (1 + self.weight)

    def _alone(self, examples: Series, codes: np.ndarray) -> bool:
        """Whether there is nothing that ``rocket`` could add."""
        return not self.weight or not len(examples) or int(np.bincount(codes).max()) < 2


def dilations(frames: int, each: int) -> list[tuple[int, int]]:
    """How far apart the places of a kernel are, and how many levels each such kernel has; ``each`` in all.

    They grow exponentially from 1 to what the length allows (Dempster, Schmidt and Webb 2021).
    """
    top = np.log2(max((frames - 1) / 8, 1))
    steps, counts = np.unique(np.logspace(0, top, min(each, 32), base=2).astype(int), return_counts=True)
    counts = counts * each // min(each, 32)
    counts[: each - counts.sum()] += 1
    return list(zip(steps.tolist(), counts.tolist(), strict=True))


def _convolved(sequences: np.ndarray, seen: np.ndarray, weights: np.ndarray, step: int) -> np.ndarray:
    """(N, K, T): (K, 9) weights, ``step`` frames apart, on the sum of the channels that each kernel has seen.

    Of (N, D, T) sequences, zero outside; ``seen`` is (K, C), -1 where a kernel looks at fewer channels.
    Summed in one order whatever the batch and the machine, so that no bit depends on either.
    """
    count, _, frames = sequences.shape
    summed = np.zeros((count, len(seen), frames + 8 * step), sequences.dtype)
    inside = summed[:, :, 4 * step : 4 * step + frames]
    for column in seen.T:
        own = np.flatnonzero(column >= 0)
        inside[:, own] += sequences[:, column[own]]
    found: np.ndarray = np.zeros((count, len(seen), frames), sequences.dtype)
    for place, weight in enumerate(weights.T):
        found += weight[:, None] * summed[:, :, step * place : step * place + frames]
    return found


def standardised(series: Series, usual: np.ndarray, frames: int) -> np.ndarray:
    """(N, D, frames) float32: resampled, each channel with zero mean and unit deviation in each sequence."""
    found = np.array([resampled(item, frames) for item in series]).reshape(len(series), -1, frames)
    found -= found.mean(axis=2, keepdims=True)
    found /= found.std(axis=2, keepdims=True) + _FLAT * usual
    return found.astype(np.float32)


def usual_deviation(series: Series, frames: int) -> np.ndarray:
    """Root mean square of the deviations of all channels of all sequences; 1 where nothing ever moves."""
    # Sorted, so that the order of the series moves no last digit.
    square = np.mean(np.sort([resampled(item, frames).var(axis=1).mean() for item in series]))
    return np.array(np.sqrt(square) if square > 0 else 1.0)


def ridge(
    forms: Sequence[np.ndarray], codes: np.ndarray, classes: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Ridge regression of the classes on (N, F) shares in one or two forms, all of which teach.

    Targets and weights are those of `learn_weights`: 1 for the own class and 0 for others, less the mean, and
    more for a class of few examples. The penalty is the one under which the examples, each left out in all
    its forms, are hit best.

    Returns
    -------
    weights : mapping
        ``mean`` (F,) and ``weights`` (F, C): a score is ``(shares - mean) @ weights``.
    scores : (N, C)
        Of each example by all others, the mean over its forms.
    """
    targets, scarcity = targets_of(codes, classes)
    targets = np.tile(targets, (len(forms), 1))
    roots = np.tile(np.sqrt(scarcity), len(forms))[:, None]
    shares = np.concatenate(forms).astype(np.float64)
    mean, spread = np.average(shares, axis=0, weights=roots[:, 0] ** 2), shares.std(axis=0)
    scale = 1 / ((spread + 1e-8) * np.sqrt(shares.shape[1]))
    known, wanted = (shares - mean) * scale * roots, targets * roots
    # With known = U S V', what is left out of the residuals needs U S alone, from the smaller Gram matrix.
    if len(known) > known.shape[1]:
        squares, right = np.linalg.eigh(known.T @ known)
        rotated = known @ right
    else:
        squares, left = np.linalg.eigh(known @ known.T)
        rotated = left * np.sqrt(np.maximum(squares, 0.0))
    squares, seen, count = np.maximum(squares, 0.0), rotated.T @ wanted, len(codes)
    twins = rotated.reshape(len(forms), count, -1)
    best: tuple[float, float, np.ndarray, np.ndarray] | None = None
    for penalty in _PENALTIES:
        kept = 1 / (squares + penalty)
        residuals = wanted - rotated @ (kept[:, None] * seen)
        # I minus the hat matrix among the forms of an example, inverted, undoes what they taught.
        hats = np.array([[((a * b) @ kept) for b in twins] for a in twins]).transpose(2, 0, 1)
        own = residuals.reshape(len(forms), count, classes).transpose(1, 0, 2)
        missed = np.linalg.solve(np.eye(len(forms)) - hats, own)
        error = float((missed**2).sum())
        if best is None or error < best[0]:
            off = missed.transpose(1, 0, 2).reshape(-1, classes) / roots
            guessed = (targets - off).reshape(len(forms), count, classes)
            best = error, float(penalty), guessed.mean(axis=0), residuals
    assert best is not None
    # Of the least squares with a penalty, the dual solution is the residuals over the penalty.
    weights = known.T @ (best[3] / best[1])
    return {"mean": mean, "weights": scale[:, None] * weights}, best[2]
