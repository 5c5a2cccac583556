"""Classifier that learns movements from many examples: a recurrent network over the signals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals

_RATE, _DECAY, _SMOOTH = 5e-3, 1e-2, 0.1
"""Learning rate at its peak, weight decay, and what is taken from the target of the own class."""
_DROPPED = 0.3
_BATCH, _STEPS = 32, 100
"""Sequences of a step, and steps at least."""
_PARTS = 3
"""Networks that learn, each without one part of the examples, to say what none of them had seen."""

Series = Sequence[Signals | np.ndarray]


class _Network(nn.Module):
    """Gated recurrent units that read a sequence both ways; the mean of what they say decides."""

    def __init__(self, channels: int, hidden: int, classes: int) -> None:
        super().__init__()
        self.drop = nn.Dropout(_DROPPED)
        self.units = nn.GRU(channels, hidden, batch_first=True, bidirectional=True)
        self.decide = nn.Linear(2 * hidden, classes)

    def forward(self, series: Tensor) -> Tensor:
        """(B, C) of (B, T, D)."""
        said: Tensor = self.decide(self.drop(self.units(self.drop(series))[0].mean(dim=1)))
        return said


@dataclass(frozen=True)
class Recurrent:
    """Gated recurrent units (Cho et al. 2014) over the signals, for hundreds of examples.

    Of the family of Chai et al. (2016) and Molchanov et al. (2016), whose networks read pictures; this one
    reads what distances are made of, resampled to one length. Where examples also stand for the other hand,
    their mirror images teach too, and a query is asked about in both forms. Scores are the network's
    probabilities. On one machine the same seed learns the same, to the bit; it takes one thread.

    Parameters
    ----------
    mirror : float, optional
        That of [classify].
    hidden : int
        Units of each direction.
    epochs : int
        How often each example is shown, and more often where there are few.
    frames : int
        Length of a sequence.
    seed : int
        Of the first weights, and of the order in which examples are shown.
    """

    mirror: float | None = None
    hidden: int = 64
    epochs: int = 30
    frames: int = 32
    seed: int = 0
    least = 8
    compares = False

    def __post_init__(self) -> None:
        for name in ("hidden", "epochs", "frames"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} {getattr(self, name)}: 1 at least")

    def fit(
        self,
        examples: Series,
        codes: np.ndarray,
        classes: int,
        distances: np.ndarray | None,
        marks: np.ndarray,
    ) -> Mapping[str, np.ndarray]:
        """The network's weights, the mean of each channel and the deviation of all."""
        forms = self._forms(examples)
        with _apart():
            return self._learn(forms, np.asarray(codes, np.int64), classes)

    def left_out(
        self, examples: Series, codes: np.ndarray, classes: int, distances: np.ndarray
    ) -> np.ndarray:
        """(N, C): of each example by a network that did not see its part of each class, one in three."""
        forms, codes = self._forms(examples), np.asarray(codes, np.int64)
        turn: np.ndarray = np.empty(len(codes), np.int64)
        for code in np.unique(codes):
            own = np.flatnonzero(codes == code)
            turn[own] = np.arange(len(own)) % _PARTS
        scores: np.ndarray = np.empty((len(codes), classes))
        with _apart():
            for part in np.unique(turn):
                out, kept = np.flatnonzero(turn == part), np.flatnonzero(turn != part)
                state = self._learn([form[kept] for form in forms], codes[kept], classes)
                scores[out] = self._asked([form[out] for form in forms], state)
        return scores

    def scores(self, state: Mapping[str, np.ndarray], queries: Series, distances: np.ndarray) -> np.ndarray:
        """(Q, C) probabilities, the mean of what both forms get."""
        if not queries:
            return np.empty((0, len(state["decide.bias"])))
        with _apart():
            return self._asked(self._forms(queries), state)

    def _learn(self, forms: Sequence[Tensor], codes: np.ndarray, classes: int) -> Mapping[str, np.ndarray]:
        """What `scores` needs, from (N, T, D) series in each form."""
        torch.default_generator.manual_seed(self.seed)  # torch.manual_seed would seed every device, too
        series, targets = torch.cat(list(forms)), torch.from_numpy(np.tile(codes, len(forms)))
        mean = series.mean(dim=(0, 1))
        # One for all channels: they weigh as they do in the distances, and what trembles is not magnified.
        deviation = (series - mean).square().mean().sqrt()
        deviation = torch.where(deviation > 0, deviation, 1.0)
        series = ((series - mean) / deviation).float()
        members = torch.bincount(targets, minlength=classes).clamp(min=1)
        network = _Network(series.shape[2], self.hidden, classes)
        lost = nn.CrossEntropyLoss(weight=len(targets) / (classes * members.float()), label_smoothing=_SMOOTH)
        optimizer = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY)
        parts = -(-len(series) // _BATCH)
        epochs = max(self.epochs, -(-_STEPS // parts))
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _RATE, total_steps=epochs * parts)
        for _ in range(epochs):
            order = torch.randperm(len(series))
            for start in range(0, len(order), _BATCH):
                some = order[start : start + _BATCH]
                optimizer.zero_grad()
                lost(network(series[some]), targets[some]).backward()
                optimizer.step()
                schedule.step()
        learned = {name: value.numpy() for name, value in network.state_dict().items()}
        return {**learned, "mean": mean.numpy(), "deviation": deviation.numpy()}

    def _asked(self, forms: Sequence[Tensor], state: Mapping[str, np.ndarray]) -> np.ndarray:
        """(Q, C) of (Q, T, D) in each form."""
        own = {name: torch.from_numpy(np.array(array)) for name, array in state.items()}
        mean, deviation = own.pop("mean"), own.pop("deviation")
        network = _Network(len(mean), own["units.weight_hh_l0"].shape[1], len(own["decide.bias"]))
        network.load_state_dict(own)
        network.eval()
        found: np.ndarray = np.empty((len(forms[0]), len(own["decide.bias"])))
        with torch.no_grad():
            # One query at a time: the bits of a row do not depend on its batch.
            for row, both in enumerate(zip(*forms, strict=True)):
                said = network(((torch.stack(both) - mean) / deviation).float())
                found[row] = said.double().softmax(dim=1).mean(dim=0).numpy()
        return found

    def _forms(self, series: Series) -> list[Tensor]:
        """(N, T, D) float64 of the sequences as they are, and mirrored where that counts."""
        forms = [list(series)]
        if self.mirror is not None and all(isinstance(item, Signals) for item in series):
            forms.append([mirrored(item) for item in series if isinstance(item, Signals)])
        return [torch.stack([self._resampled(item) for item in form]) for form in forms]

    def _resampled(self, item: Signals | np.ndarray) -> Tensor:
        """(T, D) by linear interpolation from the first frame to the last one; what is absent is zero."""
        values = np.asarray(item.values if isinstance(item, Signals) else item, np.float64)
        if isinstance(item, Signals):
            values = np.where(np.asarray(item.present), values, 0.0)
        turned = torch.from_numpy(np.array(values.T[None]))
        return nn.functional.interpolate(turned, size=self.frames, mode="linear", align_corners=True)[0].T


@contextmanager
def _apart() -> Iterator[None]:
    """One thread, and random numbers that no one else sees; both are Torch's, for the whole process."""
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)
