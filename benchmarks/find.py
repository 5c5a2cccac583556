"""What `gesture find` costs: CPU seconds and memory for hours of made keypoints.

The recordings are strings of drawn gestures and of rests, 20 frames a second, as files of the keypoint store:

    python benchmarks/find.py --hours 10
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
from pathlib import Path

import numpy as np

from gesture_core import find, load_poses
from gesture_core.demo.archive import write_archive
from gesture_core.run.store import write_keypoints
from gesture_core.types import PoseSequence

_FPS = 20
_HOURS_A_FILE = 2.5


def made(poses: list[PoseSequence], frames: int, seed: int) -> PoseSequence:
    """A recording of so many frames: gestures, and rests of 1 to 30 s, with half a pixel of noise."""
    rng = np.random.default_rng(seed)
    points: list[np.ndarray] = []
    scores: list[np.ndarray] = []
    count = 0
    while count < frames:
        pose, rest = poses[rng.integers(len(poses))], int(rng.integers(_FPS, 30 * _FPS))
        own = np.concatenate([pose.keypoints, np.repeat(pose.keypoints[-1:], rest, axis=0)])
        points.append(own + rng.normal(0, 0.5, own.shape))
        scores += [pose.scores, np.repeat(pose.scores[-1:], rest, axis=0)]
        count += len(own)
    times = np.arange(frames) / _FPS
    return PoseSequence(np.concatenate(points)[:frames], np.concatenate(scores)[:frames], times)


def main() -> None:
    """Make the recordings, search them twice, and print what the second search took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=10.0)
    hours = parser.parse_args().hours
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GESTURE_CACHE"] = f"{folder}/cache"
        drawn = write_archive(Path(folder, "drawn"), queries=2, examples=1)
        poses = load_poses(drawn.video_keypoints, workers=1)
        files = max(1, round(hours / _HOURS_A_FILE))
        frames = round(hours * 3600 * _FPS / files)
        for number in range(files):
            facts = {
                "frames_declared": None, "frames_read": frames, "frames_looked_at": frames, "complete": True,
                "notes": [], "seconds": frames / _FPS, "assumed": "",
            }  # fmt: skip
            target = Path(folder, "recordings", f"{number}.parquet")
            write_keypoints(target, [made(poses, frames, number)], facts)
        clip = next(drawn.example_keypoints.glob("wave/*"))
        for _ in range(2):  # the first brings the keypoints into the store
            before = cpu()
            found = find(clip, Path(folder, "recordings"), workers=1)
        largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        print(
            f"{found.frames} frames, {found.warped} of them warped, {len(found.hits)} places: "
            f"{cpu() - before:.1f} CPU seconds, the largest process {largest:.0f} MiB"
        )


def cpu() -> float:
    """Seconds of this process and of those that have ended."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in both)


if __name__ == "__main__":
    main()
