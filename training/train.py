"""The training loop: legs of growing picture size, averaged weights, checkpoints, and a curve."""

from __future__ import annotations

import copy
import csv
import math
import time
from pathlib import Path

import torch
from torch import nn
from torch.utils.data import DataLoader

from .batches import Batches, leg_of
from .grow import grow
from .losses import heat_loss, offset_loss, target_maps
from .network import STRIDE, Compact, build
from .settings import Settings

CURVE = ("step", "images", "minutes", "size", "rate", "heat", "offset_cells")


ANCHOR = "anchor.pt"


def finished(work: Path, settings: Settings) -> Compact:
    """The network that a training leaves in ``work``: the averaged weights of the last checkpoint.

    With ``settings.mean_from`` they are the mean of those and of the ones at that step (Izmailov et al.
    2018): a rate that falls to nothing fits the few real pictures, and the mean takes half of that back.
    """
    state = torch.load(work / "checkpoint.pt", weights_only=True)
    weights = state["slow"]
    if settings.mean_from and state["step"] > settings.mean_from:
        anchor = torch.load(work / ANCHOR, weights_only=True)
        for name, values in weights.items():
            if values.dtype.is_floating_point:
                values.lerp_(anchor[name], 0.5)
    model = build(settings.network_at(state["step"] - 1))
    model.load_state_dict(weights)
    return model.eval()


def rate(step: int, settings: Settings) -> float:
    """One-cycle rate of each leg: a short warm-up, then a cosine; the last leg goes down to a hundredth."""
    index, start = leg_of(step, settings.schedule)
    leg = settings.schedule[index]
    done = step - start
    warm = min(150, leg.steps // 5) if index == 0 else 20
    if done < warm:
        return leg.rate * (done + 1) / warm
    share = (done - warm) / max(1, leg.steps - warm)
    end = leg.final
    if not end:
        last = index == len(settings.schedule) - 1
        end = 0.01 if last else settings.schedule[index + 1].rate / leg.rate
    return leg.rate * (end + (1 - end) * 0.5 * (1 + math.cos(math.pi * share)))


def average(slow: nn.Module, fast: nn.Module, decay: float) -> None:
    """Move ``slow`` towards ``fast``: weights and the statistics of the batch norms."""
    with torch.no_grad():
        for a, b in zip(slow.state_dict().values(), fast.state_dict().values(), strict=True):
            if a.dtype.is_floating_point:
                a.lerp_(b, 1 - decay)
            else:
                a.copy_(b)


def _groups(model: nn.Module, decay: float) -> list[dict[str, object]]:
    """Only convolution weights decay, not norms and biases."""
    heavy = [p for p in model.parameters() if p.ndim > 1]
    light = [p for p in model.parameters() if p.ndim <= 1]
    return [{"params": heavy, "weight_decay": decay}, {"params": light, "weight_decay": 0.0}]


def train(batches: Batches, settings: Settings, work: Path, progress: bool = True) -> Compact:
    """Train, or go on from ``work/checkpoint.pt``; returns the network with averaged weights.

    At ``settings.grow_at`` the averaged weights of ``settings.first`` begin the larger network.

    Writes ``work/curve.csv`` and, every ``checkpoint_steps``, the checkpoint.
    """
    torch.manual_seed(settings.seed)
    torch.set_num_threads(settings.threads)
    path, step, spent = work / "checkpoint.pt", 0, 0.0
    state = torch.load(path, weights_only=True) if path.exists() else None
    if state:
        step, spent = state["step"], state["minutes"]
    model = build(settings.network_at(step))
    slow = copy.deepcopy(model)
    if state and step == settings.grow_at and settings.first is not None:
        small = build(settings.first)
        small.load_state_dict(state["slow"])
        grow(small, model)
        slow = copy.deepcopy(model)
        state = None
    optimiser = torch.optim.AdamW(_groups(model, settings.weight_decay), lr=1e-3, betas=(0.9, 0.98))
    if state:
        model.load_state_dict(state["model"])
        slow.load_state_dict(state["slow"])
        optimiser.load_state_dict(state["optimiser"])
    # channels last trains nearly twice as fast on CPUs (measured: 129 against 68 pictures a second)
    model = model.to(memory_format=torch.channels_last)
    model.train()
    total = len(batches)
    end = settings.grow_at if step < settings.grow_at and settings.first is not None else total
    loader = DataLoader(batches, batch_size=None, sampler=range(step, end), num_workers=1, prefetch_factor=4)
    began, images, sums, count = time.monotonic() - spent * 60, 0, [0.0, 0.0], 0
    bar = _Bar(total, step) if progress else None
    for pictures, joints in loader:
        leg = settings.schedule[leg_of(step, settings.schedule)[0]]
        now = rate(step, settings)
        for group in optimiser.param_groups:
            group["lr"] = now
        heat = model.heat(pictures.float().contiguous(memory_format=torch.channels_last))
        target = target_maps(joints, leg.size // STRIDE, leg.size // STRIDE, settings.sigma)
        first = heat_loss(heat, target, joints)
        second = offset_loss(heat, joints)
        loss = first + leg.offset * second
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimiser.step()
        average(slow, model, min(settings.average, (step + 1) / (step + 10)))
        step, images, count = step + 1, images + leg.batch, count + 1
        if step == settings.mean_from:
            torch.save(slow.state_dict(), work / ANCHOR)
        sums = [sums[0] + first.item(), sums[1] + second.item()]
        minutes = (time.monotonic() - began) / 60
        late = bool(settings.minutes) and minutes > settings.minutes
        if step % settings.checkpoint_steps == 0 or step == end or late:
            _note(work, step, settings, minutes, now, [s / count for s in sums])
            sums, count = [0.0, 0.0], 0
            _save(path, model, slow, optimiser, step, minutes)
        if bar:
            bar.update(step, first.item(), second.item())
        if late:
            return slow.eval()
    return slow.eval() if end == total else train(batches, settings, work, progress)


def _note(work: Path, step: int, settings: Settings, minutes: float, now: float, losses: list[float]) -> None:
    path = work / "curve.csv"
    fresh = not path.exists()
    index, start = leg_of(step - 1, settings.schedule)
    leg = settings.schedule[index]
    seen = sum(s.steps * s.batch for s in settings.schedule[:index]) + (step - start) * leg.batch
    with path.open("a", encoding="utf-8", newline="") as handle:
        writer = csv.writer(handle)
        if fresh:
            writer.writerow(CURVE)
        row = [step, seen, f"{minutes:.1f}", leg.size, f"{now:.2e}", *(f"{v:.4f}" for v in losses)]
        writer.writerow(row)


def _save(
    path: Path, model: nn.Module, slow: nn.Module, optimiser: torch.optim.Optimizer, step: int, minutes: float
) -> None:
    state = {
        "model": model.state_dict(),
        "slow": slow.state_dict(),
        "optimiser": optimiser.state_dict(),
        "step": step,
        "minutes": minutes,
    }
    part = path.with_suffix(".part")
    torch.save(state, part)
    part.replace(path)


class _Bar:
    """A progress bar with the losses of the last step."""

    def __init__(self, total: int, done: int) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self._progress = Progress(
            TextColumn("train"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[loss]}"),
        )
        self._task = self._progress.add_task("train", total=total, completed=done, loss="")
        self._progress.start()
        self._total = total

    def update(self, step: int, heat: float, offset: float) -> None:
        self._progress.update(self._task, completed=step, loss=f"heat {heat:.3f} offset {offset:.2f} cells")
        if step == self._total:
            self._progress.stop()
