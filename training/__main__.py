"""``python -m training``, from the root of the repository: every step that is not yet done."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

# Threads that spin while they wait starve each other on a busy machine: 5 against 85 pictures a second.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from . import settings as settings_module
from .batches import Batches
from .export import export
from .label import label
from .presence import presence
from .render import render
from .scenes import harvest, patches
from .store import Store
from .train import finished, train

PACKAGED = Path(__file__).parents[1] / "plugins/gesture_pose_onnx/gesture_pose_onnx/models/compact.onnx"
STEPS = ("label", "render", "train", "export", "presence", "quantise", "evaluate", "show")


def track(things: Iterable[object], title: str) -> Iterator[object]:
    """A progress bar over ``things``."""
    from rich.progress import track as bar

    return iter(bar(list(things), title))


def _open_or_make(folder: Path, make: object) -> Store:
    if (folder / "index.json").exists():
        return Store.open(folder)
    return make()  # type: ignore[operator,no-any-return]


def main() -> None:
    """Run the steps in order; each leaves its result in the work folder and is skipped when done."""
    parser = argparse.ArgumentParser(prog="python -m training", description=__doc__)
    parser.add_argument("--shared", type=Path, default=Path("../shared"), help="data and teachers")
    parser.add_argument("--work", type=Path, default=Path(".work/training"), help="caches and checkpoints")
    parser.add_argument("--config", type=Path, default=settings_module.DEFAULT)
    parser.add_argument("--out", type=Path, default=PACKAGED, help="the network, with its pictures beside it")
    parser.add_argument("--only", choices=STEPS, action="append", help="these steps alone")
    args = parser.parse_args()
    settings = settings_module.load(args.config)
    steps = args.only or list(STEPS)
    data = settings.data
    real = rendered = None
    if {"label", "train"} & set(steps):
        real = _open_or_make(
            args.work / "real",
            lambda: label(args.shared, args.work / "real", data, settings.threads, track),
        )
        print(f"real: {len(real)} samples")
    if {"render", "train"} & set(steps):
        rendered = _open_or_make(
            args.work / "people",
            lambda: render(args.work / "people", data, settings.seed, patches(args.shared), track),
        )
        print(f"rendered: {len(rendered)} samples")
    if "train" in steps:
        assert real is not None and rendered is not None
        batches = Batches(real, rendered, harvest(real), settings.schedule, settings.seed)
        train(batches, settings, args.work)
    if "export" in steps:
        print(f"{args.out}: SHA-256 {export(finished(args.work, settings), args.out)}")
    if "presence" in steps:
        print(presence(args.out, args.shared, args.work, settings.seed, track))
    if "quantise" in steps:
        from .quantise import calibration, quantise

        small = args.out.with_name("compact-int8.onnx")
        print(f"{small}: SHA-256 {quantise(args.out, small, calibration(args.shared, settings.seed, track))}")
    if "evaluate" in steps:
        from .evaluate import evaluate

        print(evaluate(args.out, args.shared, args.work))
    if "show" in steps:
        from .show import curve, overlay

        overlay(args.out, args.out.with_name("overlay.png"))
        curve(args.work / "curve.csv", args.out.with_name("curve.png"))


if __name__ == "__main__":
    main()
