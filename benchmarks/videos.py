"""Keypoints of body_gesture from its RGB videos, by a pose network of this machine.

    python benchmarks/videos.py --model compact --rate 10 --cache FOLDER [--shared FOLDER]
    python benchmarks/videos.py --model ../shared/models/hpe0001_f32_dynamic.onnx --follow --height 256 ...

Leaves one .npz for each clip in the cache folder (yours, never the project's), which
``benchmarks/evaluate.py --videos FOLDER`` reads; interrupted, it goes on where it stopped.
"""

from __future__ import annotations

import sys
import time
from argparse import BooleanOptionalAction
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from datasets import Item, arguments, body_gesture

from gesture_core.errors import GestureError
from gesture_core.plugin.interfaces import PoseBackend
from gesture_core.pose.extract import extract_poses, open_backend
from gesture_core.pose.parts import Parts, open_parts
from gesture_core.settings import load_settings
from gesture_core.types import PoseSequence
from gesture_core.video import at_rate, open_video, pictures


def video_of(item: Item, shared: Path) -> Path:
    """The clip of a body_gesture item."""
    return shared / "data" / "body_gesture" / item.subject / f"{item.name.split('__')[2]}.avi"


def extract(
    video: Path,
    backend: PoseBackend,
    rate: float,
    follow: bool | None = None,
    parts: Parts | None = None,
) -> PoseSequence:
    """Keypoints of a clip, as with ``pose.rate``."""
    with open_video(video) as frames:
        people = extract_poses(
            at_rate(pictures(frames), rate), backend, follow=follow, parts=parts, source=str(video)
        )
    return people[0]


def keep(pose: PoseSequence, path: Path) -> None:
    """Write a sequence to ``path``, whole or not at all."""
    part = path.with_suffix(".part.npz")
    np.savez(part, keypoints=pose.keypoints, scores=pose.scores, times=pose.times, skeleton=pose.skeleton)
    part.replace(path)


def with_videos(items: Sequence[Item], folder: Path) -> list[Item]:
    """The items of which the cache has a clip, with the keypoints found in the videos."""
    out = []
    for item in items:
        path = folder / f"{item.name}.npz"
        if path.is_file():
            with np.load(path, allow_pickle=False) as f:
                pose = PoseSequence(
                    f["keypoints"], f["scores"], f["times"], str(f["skeleton"]), source=item.name
                )
            out.append(replace(item, pose=pose))
    return out


def main() -> int:
    """Extract what the cache does not have yet."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--model", default="compact")
    parser.add_argument("--rate", type=float, default=0, help="frames a second that are looked at; 0: all")
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument(
        "--follow",
        action=BooleanOptionalAction,
        help="crop to the person; None: as the network's contract says",
    )
    parser.add_argument("--hands", action="store_true", help="find hands, too")
    parser.add_argument("--gestures", nargs="*", default=[], help="these alone")
    parser.add_argument("--height", type=int, help="of the input, for networks that take any size")
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args()
    given.cache.mkdir(parents=True, exist_ok=True)
    settings = load_settings(
        "hands" if given.hands else "modern", pose__model=given.model, pose__height=given.height
    )
    backend = open_backend(settings, given.threads)
    items = body_gesture(given.shared)
    items = [item for item in items if item.label in (given.gestures or [item.label])]
    # Clips of all gestures and subjects come early, so that a part of the set is a fair sample.
    order = sorted(items, key=lambda item: (items.index(item) * 97) % len(items))
    frames, started = 0, time.perf_counter()
    for number, item in enumerate(order, 1):
        path = given.cache / f"{item.name}.npz"
        if path.is_file():
            continue
        try:
            parts = open_parts(settings, backend.skeleton, given.threads)
            pose = extract(video_of(item, given.shared), backend, given.rate, given.follow, parts)
        except GestureError as error:
            print(f"{item.name}: {error}", file=sys.stderr)
            continue
        keep(pose, path)
        frames += len(pose)
        speed = frames / (time.perf_counter() - started)
        print(f"{number}/{len(order)} {item.name} {len(pose)} frames, {speed:.1f} frames/s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
