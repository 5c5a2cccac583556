"""Batches by number: batch ``n`` of a seed is always the same, so that a training can go on anywhere."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from .augment import Sample, augment
from .joints import HIPS, NECK, PRESENT, WRISTS
from .settings import Schedule
from .store import Store


def leg_of(step: int, schedule: tuple[Schedule, ...]) -> tuple[int, int]:
    """Leg that ``step`` belongs to, and the first step of that leg."""
    start = 0
    for index, leg in enumerate(schedule):
        if step < start + leg.steps:
            return index, start
        start += leg.steps
    raise IndexError(f"step {step} is beyond the schedule of {start} steps")


class Batches(Dataset[tuple[Tensor, Tensor]]):
    """Item ``step`` is a whole batch: pictures (B, 3, H, W) uint8 and joints (B, 18, 3) float32.

    Parameters
    ----------
    real, rendered : Store
    scenes : (K, 256, 256, 3) uint8
    schedule : legs of the training
    seed : int
    """

    def __init__(
        self, real: Store, rendered: Store, scenes: np.ndarray, schedule: tuple[Schedule, ...], seed: int
    ) -> None:
        self.real, self.rendered, self.scenes = real, rendered, scenes
        self.schedule, self.seed = schedule, seed
        # neighbouring frames of one film are nearly the same picture, and a portrait shows no arm
        film = np.array(["." in name for name in real.names])[real.groups]
        arms = (real.joints[:, list(WRISTS), 2] == PRESENT).any(axis=1)
        weights = np.where(film, 0.3, 1.0) * np.where(arms, 1.0, 0.4)
        self.odds = weights / weights.sum()
        # whole people who stand, their hands above their hips: what lends its legs
        low = rendered.joints[:, :, 1]
        hands, hips, feet = (low[:, list(j)] for j in (WRISTS, HIPS, (10, 13)))
        spread = feet.min(axis=1) - hips.max(axis=1)
        whole = (rendered.bottoms > rendered.pictures.shape[1]) & (hands.max(axis=1) < hips.min(axis=1))
        self.whole = np.flatnonzero(whole & (spread > 1.2 * (hips.mean(axis=1) - low[:, NECK])))

    def __len__(self) -> int:
        return sum(leg.steps for leg in self.schedule)

    def __getitem__(self, step: int) -> tuple[Tensor, Tensor]:
        leg = self.schedule[leg_of(step, self.schedule)[0]]
        rng = np.random.default_rng([self.seed, step])
        pictures = np.empty((leg.batch, leg.size, leg.size, 3), np.uint8)
        joints = np.empty((leg.batch, 18, 3), np.float32)
        for index in range(leg.batch):
            real = rng.random() < leg.real
            sample = self._real(rng) if real else self._rendered(rng)
            extra = self._rendered(rng) if rng.random() < 0.12 else None
            legs = self._legs(rng) if real and rng.random() < 0.35 else None
            pictures[index], joints[index] = augment(rng, sample, leg.size, self.scenes, extra, legs)
        return torch.from_numpy(pictures.transpose(0, 3, 1, 2)), torch.from_numpy(joints)

    def _real(self, rng: np.random.Generator) -> Sample:
        return self._take(self.real, int(rng.choice(len(self.odds), p=self.odds)), False)

    def _rendered(self, rng: np.random.Generator) -> Sample:
        return self._take(self.rendered, int(rng.integers(len(self.rendered))), True)

    def _legs(self, rng: np.random.Generator) -> Sample | None:
        return self._take(self.rendered, int(rng.choice(self.whole)), True) if len(self.whole) else None

    @staticmethod
    def _take(store: Store, index: int, rendered: bool) -> Sample:
        picture = store.pictures[index]
        return Sample(
            np.ascontiguousarray(picture[..., :3]),
            np.ascontiguousarray(picture[..., 3]),
            store.joints[index],
            float(store.bottoms[index]),
            rendered,
        )
