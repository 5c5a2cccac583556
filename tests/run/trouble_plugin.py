"""Plugins of every kind that do well until they meet a poisoned input, and then whatever it is poisoned with.

A poisoned input is known by its length: ``BASE`` frames and the position of ``<kind> <trouble>`` in
`POISONS`; a poisoned video by its width. A healthy one is shorter.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from gesture_signals.normalizers import ShoulderNormalizer

from gesture_core import DtwSpec, PoseSequence, SignalBatch, Signals, hookimpl
from gesture_core.plugin.hooks import Register
from gesture_core.plugin.interfaces import Person

FIGURE = np.array(
    [
        (0.50, 0.10), (0.50, 0.22), (0.38, 0.22), (0.32, 0.36), (0.30, 0.50), (0.62, 0.22),
        (0.68, 0.36), (0.70, 0.50), (0.42, 0.52), (0.42, 0.72), (0.42, 0.92), (0.58, 0.52),
        (0.58, 0.72), (0.58, 0.92), (0.44, 0.02), (0.56, 0.02), (0.38, 0.08), (0.62, 0.08),
    ]
)  # fmt: skip
BASE = 100
KINDS = ("normalizer", "filter", "selector", "kernel", "pose")


def _raise() -> None:
    raise RuntimeError("not today")


def _hungry() -> None:
    kept = []
    while True:
        kept.append(bytearray(b"x") * (32 << 20))


def _recursion() -> None:
    return _recursion()


def _interrupt() -> None:
    raise KeyboardInterrupt


def _print() -> None:
    print('{"answer": null}', flush=True)
    os.write(1, b"not json at all\n")


class _Unprintable(Exception):
    def __str__(self) -> str:
        return str(1 / 0)


def _unprintable() -> None:
    raise _Unprintable


DEADLY: dict[str, Callable[[], object]] = {
    "os-exit": lambda: os._exit(0),
    "segfault": lambda: ctypes.string_at(0),
    "hang": lambda: time.sleep(600),
    "hungry": _hungry,
    "kill": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "abort": os.abort,
    "interrupt": _interrupt,
    "close": lambda: os.closerange(0, 64),
    "unprintable": _unprintable,
}
RAISING: dict[str, Callable[[], object]] = {
    "raise": _raise,
    "exit": lambda: sys.exit(0),
    "huge": lambda: np.ones(1 << 44),
    "recursion": _recursion,
}
WRONG = ("none", "shape", "nan", "text", "infinite")
HARMLESS: dict[str, Callable[[], object]] = {
    "print": _print,
    "mutate": lambda: None,
    "slow": lambda: time.sleep(0.2),
}
TROUBLES = (*DEADLY, *RAISING, *WRONG, *HARMLESS)
POISONS = tuple(f"{kind} {trouble}" for kind in KINDS for trouble in TROUBLES)


def length(kind: str, trouble: str) -> int:
    """Frames of an input that is poisoned with ``trouble`` for the plugin of ``kind``."""
    return BASE + POISONS.index(f"{kind} {trouble}")


def poison(kind: str, frames: int) -> str:
    """What an input of that length does to the plugin of ``kind``; done here where it is an action."""
    known = POISONS[frames - BASE].split() if BASE <= frames < BASE + len(POISONS) else ("", "")
    trouble = known[1] if known[0] == kind else ""
    action = {**DEADLY, **RAISING, **HARMLESS}.get(trouble)
    if action:
        action()
    return trouble


def spoil(trouble: str, answer: Any, argument: np.ndarray) -> Any:
    """The wrong answer that ``trouble`` stands for, else ``answer``."""
    if trouble == "mutate":
        argument.flags.writeable = True
        argument[...] = 0
    wrong: dict[str, object] = {
        "none": None,
        "shape": np.ones((1, 1, 1)),
        "nan": np.full(np.shape(answer), np.nan),
        "infinite": np.full(np.shape(answer), -np.inf),
        "text": "an answer",
    }
    return wrong.get(trouble, answer)


class Normalizer:
    def normalize(self, pose: PoseSequence) -> object:
        trouble = poison("normalizer", len(pose))
        return spoil(trouble, ShoulderNormalizer().normalize(pose), pose.keypoints)


class Filter:
    def apply(self, signals: Signals) -> Signals | None:
        trouble = poison("filter", len(signals))
        values = spoil(trouble, signals.values, signals.values)
        if trouble == "none":
            return None
        return signals if values is signals.values else replace(signals, values=values)


class Selector:
    def select(self, signals: Signals) -> object:
        trouble = poison("selector", len(signals))
        return spoil(trouble, signals.values.std(axis=0) > 0.1, signals.values)


class Kernel:
    def supports(self, spec: DtwSpec) -> bool:
        return True

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> tuple[np.ndarray, np.ndarray]:
        return examples.values, examples.lengths

    def distances(self, state: tuple[np.ndarray, np.ndarray], queries: SignalBatch) -> object:
        trouble = ""
        for frames in queries.lengths:
            trouble = poison("kernel", int(frames)) or trouble
        each = [
            [np.abs(q[:n].std(axis=0) - e[:m].std(axis=0)).sum() for e, m in zip(*state, strict=True)]
            for q, n in zip(queries.values, queries.lengths, strict=True)
        ]
        return spoil(trouble, np.array(each), queries.values)


class Pose:
    skeleton = "coco18"
    batch_size = 4

    def __init__(self, model: object) -> None:
        pass

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]] | None:
        found = []
        for frame in frames:
            # Codecs want even sides: twice the length of a poisoned keypoint file.
            trouble = poison("pose", frame.shape[1] // 2)
            points = FIGURE * 200
            # A wrist is where the bar is: the right one where it is bright, the left one where it is grey.
            points[4 if frame.max() > 190 else 7, 0] += 3.0 * frame[:, :, 0].mean(axis=0).argmax()
            found.append([Person(spoil(trouble, points, frame), np.ones(18))])
        return None if trouble == "none" else found


class Writer:
    suffix = ".bad"

    def write(self, rows: object, columns: Sequence[str], path: Path) -> None:
        trouble = os.environ.get("TROUBLE", "")
        path.write_text("half")
        if trouble == "none":
            path.unlink()
        action = {**DEADLY, **RAISING}.get(trouble)
        if action:
            action()


class Reader:
    def accepts(self, path: Path) -> bool:
        if path.suffix == ".poison" and path.read_text().startswith("accepts "):
            DEADLY[path.read_text().split()[1]]()
        return path.suffix == ".poison"

    def members(self, path: Path) -> object:
        what, trouble = path.read_text().split()
        if what != "members":
            return [""]
        return {"empty": [], "numbers": [1, 2]}[trouble] if trouble not in DEADLY else DEADLY[trouble]()

    def read(self, path: Path, member: str = "") -> object:
        return DEADLY[path.read_text().split()[1]]()


@hookimpl
def register_normalizers(register: Register) -> None:
    register("trouble-normalizer", "trouble:Normalizer")


@hookimpl
def register_filters(register: Register) -> None:
    register("trouble-filter", "trouble:Filter")


@hookimpl
def register_selectors(register: Register) -> None:
    register("trouble-selector", "trouble:Selector")


@hookimpl
def register_distance_kernels(register: Register) -> None:
    register("trouble-kernel", "trouble:Kernel")


@hookimpl
def register_pose_backends(register: Register) -> None:
    register("trouble-pose", "trouble:Pose")


@hookimpl
def register_result_writers(register: Register) -> None:
    register("trouble-writer", "trouble:Writer")


@hookimpl
def register_keypoint_readers(register: Register) -> None:
    register("trouble-reader", "trouble:Reader")
