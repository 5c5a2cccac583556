"""A run of a million rows, made and not extracted: what planning, exporting and merging it cost.

    python benchmarks/store.py --rows 1000000 --folder /tmp/store

Every input is a file with nothing in it; its row is as long as that of a clip that was recognised. Goals: the
plan of the finished run under 20 s and 1 GiB. Each step runs in a process of its own; the seconds are those
of its CPU, as the machine may be busy, and the peak is that of its resident memory.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from environment import header

from gesture_core.files import stamp
from gesture_core.records import Row
from gesture_core.run.inputs import Input
from gesture_core.run.results import open_results
from gesture_core.settings import LimitSettings

LABELS = ("clap", "point", "push", "wave")
FOLDER_HOLDS = 1000


def row_of(name: str, number: int, mark: str) -> Row:
    """A row as long as those of real runs."""
    label = LABELS[number % len(LABELS)]
    distance = 0.1 + 1e-7 * number
    neighbors = tuple((f"examples/{one}/anna_{number % 7}.mp4", one, distance) for one in LABELS[:3])
    return Row(
        name, f"{number:064x}", 0, label, distance, 0.25, neighbors, "ok", frames_read=90,
        frames_looked_at=90, frames_with_pose=88, start=0.033, end=2.9667, box=(101.5, 80.25, 420.0, 470.5),
        seconds=2.9667, selected=("right_wrist_x", "right_wrist_y"), plugin="gesture-core 0.1.0",
        fingerprint=mark,
    )  # fmt: skip


def make(folder: Path, rows: int) -> None:
    """Write the archive and a run of it: the first part by the program itself, then the rows."""
    from gesture_core.run.results import Results

    names = [f"videos/{number // FOLDER_HOLDS:04d}/{number % FOLDER_HOLDS:03d}.mp4" for number in range(rows)]
    for name in names:
        place = folder / name
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            place.touch()
    os.chdir(folder)
    for label in LABELS:
        write_example(folder / "examples" / label / "anna.npz", LABELS.index(label))
    shutil.rmtree(folder / "first", ignore_errors=True)
    first = [sys.executable, "-P", "-m", "gesture_core", *command("videos/0000/000.mp4", "first/")]
    subprocess.run(first, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    (folder / "run").mkdir(exist_ok=True)
    with open_results(folder / "first") as known, Results(folder / "run", create=True) as results:
        facts = {key: known.get(key) or "" for key in ("configuration", "fingerprint", "library")}
        results.set(facts)  # of the code as it is now
        if results.inputs() == rows:
            return
        results._db.execute("PRAGMA synchronous=OFF")
        started = time.process_time()
        for number, name in enumerate(names):
            item = Input(Path(name), name, "video")
            row = row_of(name, number, facts["fingerprint"])
            results.commit(replace(item, stamp=stamp(item.path)), [row])
        print(f"commit: {1e6 * (time.process_time() - started) / rows:.0f} µs of CPU a row")


def write_example(path: Path, number: int) -> None:
    """Somebody whose arm swings."""
    import numpy as np

    path.parent.mkdir(parents=True, exist_ok=True)
    points = np.random.default_rng(number).normal(200, 0.3, (40, 18, 2)) + 20 * np.arange(18)[:, None]
    points[:, 4 + number] += 60 * np.sin(np.arange(40) / 6)[:, None]
    np.savez(path, keypoints=points, scores=np.ones((40, 18)), times=np.arange(40) / 20, skeleton="coco18")


def command(source: str, out: str) -> list[str]:
    """The main job over ``source``."""
    return ["classify", source, "--examples", "examples/", "--out", out, "--kernel", "numpy"]


def plan(folder: Path) -> int:
    """The same command again, which finds nothing to do."""
    from gesture_core.run.pipeline import run_archive
    from gesture_core.run.plan import RunRequest
    from gesture_core.settings import load_settings

    settings = load_settings("modern", classify__kernel="numpy")
    summary = run_archive(RunRequest(("videos/",), Path("run"), settings, ("examples/",)))
    assert summary.done_now == 0, summary.done_now
    return sum(summary.counts.values())


def again(folder: Path) -> int:
    """The command as it is typed, its rows through a pipe."""
    from gesture_core.cli.main import run

    code = run(command("videos/", "run/"))
    assert code == 0, code
    return code


def export(folder: Path) -> int:
    """CSV, as `gesture export` writes it in a worker."""
    from gesture_core.run.export import export_rows

    export_rows(folder / "run", "csv", folder / "rows.csv", LimitSettings())
    return (folder / "rows.csv").stat().st_size


def parquet(folder: Path) -> int:
    """Parquet."""
    from gesture_core.run.export import export_rows

    export_rows(folder / "run", "parquet", folder / "rows.parquet", LimitSettings())
    return (folder / "rows.parquet").stat().st_size


def merge(folder: Path) -> int:
    """The run, taken as the only part of another one."""
    from gesture_core.run.shards import merge_runs

    return sum(merge_runs([folder / "run"], folder / "merged", overwrite=True).counts.values())


STEPS: Mapping[str, Callable[[Path], int]] = {
    step.__name__: step for step in (plan, again, export, parquet, merge)
}


def measured(name: str, folder: Path) -> Iterator[str]:
    """One step in a process of its own: CPU seconds, workers included, and MiB at its peak."""
    done = subprocess.run(
        [sys.executable, __file__, "--step", name, "--folder", str(folder)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    yield from done.stderr.strip().splitlines()[-1].split()


def main() -> None:
    """Print a row for each step."""
    asked = argparse.ArgumentParser()
    asked.add_argument("--rows", type=int, default=1_000_000)
    asked.add_argument("--folder", type=Path, required=True)
    asked.add_argument("--step", choices=STEPS)
    given = asked.parse_args()
    folder = given.folder.absolute()
    if given.step:
        os.chdir(folder)
        STEPS[given.step](folder)
        own, workers = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = own.ru_utime + own.ru_stime + workers.ru_utime + workers.ru_stime
        peak = max(own.ru_maxrss, workers.ru_maxrss)
        print(f"{cpu:.1f} {peak / 1024:.0f}", file=sys.stderr)
        return
    header()
    folder.mkdir(parents=True, exist_ok=True)
    # In a process of its own: what this one has used would count as the peak of those that it starts.
    maker = multiprocessing.get_context("spawn").Process(target=make, args=(folder, given.rows))
    maker.start()
    maker.join()
    with open_results(folder / "run") as results:
        rows = sum(results.counts().values())
    size = (folder / "run" / "run.db").stat().st_size
    print(f"{rows} rows, run.db {size / 2**20:.0f} MiB, {size / rows:.0f} bytes a row\n")
    print("| step | CPU s | peak MiB |\n|---|---|---|")
    for name in STEPS:
        print(f"| {name} | {' | '.join(measured(name, folder))} |", flush=True)


if __name__ == "__main__":
    main()
