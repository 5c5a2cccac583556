"""A keypoint reader that misbehaves as its input asks it to: a ``.trap`` file holds a name of `TRAPS`."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gesture_core import PoseSequence, hookimpl
from gesture_core.plugin.hooks import Register


def _good() -> list[PoseSequence]:
    t = np.linspace(0, 1, 30)
    rng = np.random.default_rng(5)
    points = rng.normal(100, 1, (30, 18, 2)) + np.sin(6 * t)[:, None, None] * np.arange(18)[None, :, None]
    return [PoseSequence(points, np.ones((30, 18)), t)]


def _stdout() -> list[PoseSequence]:
    print('{"outcome": {"number": 0}}')
    os.write(1, b"not json at all\n")
    sys.stdout.flush()
    return _good()


def _hungry() -> list[PoseSequence]:
    kept = []
    while True:
        kept.append(bytearray(b"x") * (32 << 20))


def _nan_times() -> list[PoseSequence]:
    return [PoseSequence(np.ones((2, 18, 2)), np.ones((2, 18)), np.array([0, float("nan")]))]


def _recursion() -> list[PoseSequence]:
    return _recursion()


TRAPS: dict[str, Callable[[], object]] = {
    "raise": lambda: 1 / 0,
    "exit": lambda: sys.exit(0),
    "os-exit": lambda: os._exit(0),
    "kill": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "segfault": lambda: ctypes.string_at(0),
    "hang": lambda: time.sleep(600),
    "hungry": _hungry,
    "huge": lambda: np.ones(1 << 44),
    "wrong-type": lambda: 5,
    "wrong-item": lambda: ["pose"],
    "wrong-shape": lambda: [PoseSequence(np.ones((2, 5, 2)), np.ones((2, 5)), np.arange(2.0))],
    "nan-times": _nan_times,
    "interrupt": lambda: (_ for _ in ()).throw(KeyboardInterrupt()),
    "recursion": _recursion,
    "stdout": _stdout,
    "close": lambda: os.closerange(0, 64),
}


class TrapReader:
    def accepts(self, path: Path) -> bool:
        return path.suffix == ".trap"

    def members(self, path: Path) -> list[str]:
        return [""]

    def read(self, path: Path, member: str = "") -> object:
        return TRAPS[path.read_text()]()


@hookimpl
def register_keypoint_readers(register: Register) -> None:
    register("trap", "trap:TrapReader")
