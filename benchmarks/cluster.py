"""How much faster do two machines of a Ray cluster extract than one?

    python benchmarks/cluster.py --clips 120 --rounds 2

Machines of one core each are Ray nodes on this machine, which needs a core for each of them and little other
work. Beside them are worker processes without Ray, one and two: what the machine itself gives. Everybody's
network has one thread, and the cache is off. The first round of each is a warm-up, in which actors start and
load their network; of the others the shortest counts. `cores` is the CPU time of the workers over the time on
the clock: more than one for one worker would be a network with more threads than it declares.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from environment import header

from gesture_core.records import Job, Task, encoded
from gesture_core.settings import load_settings


@contextmanager
def cluster(nodes: int) -> Iterator[str]:
    """A cluster of machines of one core each; its address."""
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    for _ in range(nodes - 1):
        made.add_node(num_cpus=1)
    made.wait_for_nodes()
    try:
        yield made.address
    finally:
        made.shutdown()


def worked() -> float:
    """CPU seconds of all workers, of both kinds, since they began."""
    import psutil

    seconds = 0.0
    for process in psutil.Process().children(recursive=True):
        try:
            command = " ".join(process.cmdline())
            if "ray::" in command or "workers.worker" in command:
                seconds += sum(process.cpu_times()[:2])
        except psutil.Error:
            continue
    return seconds


def measured(engine: Any, job: Job, tasks: Sequence[Task], rounds: int) -> tuple[float, float]:
    """The seconds of the shortest round after the first, and how many cores its workers had at work."""
    best, cores = float("inf"), 0.0
    for number in range(rounds + 1):
        before, began = worked(), time.perf_counter()
        failed = [one.error for one in engine.run(job, tasks, lambda task, frames: None) if one.error]
        took = time.perf_counter() - began
        if failed:
            raise SystemExit(f"{len(failed)} of {len(tasks)} clips failed: {failed[0]}")
        if number and took < best:
            best, cores = took, (worked() - before) / took
    engine.close()
    return best, cores


def main() -> None:
    """Print a row for each engine and number of machines."""
    asked = argparse.ArgumentParser()
    asked.add_argument("--clips", type=int, default=120)
    asked.add_argument("--rounds", type=int, default=2)
    asked.add_argument("--videos", type=Path, help="a folder of clips instead of drawn ones")
    asked.add_argument("--model", default="compact")
    given = asked.parse_args()
    header()
    from gesture_engine_ray.engine import RayEngine

    from gesture_core.demo.archive import write_archive
    from gesture_core.run.workers.engines import ProcessEngine

    settings = load_settings(None, pose__model=given.model, pose__backend="onnx", limits__memory=1024)
    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"GESTURE_CACHE": folder, "GESTURE_NO_CACHE": "1", "RAY_USAGE_STATS_ENABLED": "0"}
        videos = given.videos
        if videos is None:
            videos = write_archive(Path(folder, "drawn"), queries=-(-given.clips // 6), examples=1).videos
        paths = sorted(path for path in videos.rglob("*") if path.is_file())[: given.clips]
        tasks = [
            Task(number, "extract", {"path": encoded(path.absolute()), "member": "", "reader": ""})
            for number, path in enumerate(paths)
        ]
        job = Job(settings.as_dict(), str(Path(folder, "keypoints")), {"video": "0" * 16}, threads=1)
        print(f"{len(paths)} clips, {given.rounds} rounds after a warm-up\n", flush=True)
        print("| | seconds with one | cores | seconds with two | cores | ratio |\n|---|---|---|---|---|---|")
        for name in ("worker processes", "Ray nodes of one core"):
            found = []
            for count in (1, 2):
                if name == "worker processes":
                    found += measured(ProcessEngine(count, settings.limits), job, tasks, given.rounds)
                    continue
                with cluster(count) as address:
                    engine = RayEngine(count, settings.limits, address=address)
                    found += measured(engine, job, tasks, given.rounds)
            one, cores, two, both = found
            print(
                f"| {name} | {one:.1f} | {cores:.2f} | {two:.1f} | {both:.2f} | {one / two:.2f} |", flush=True
            )


if __name__ == "__main__":
    main()
