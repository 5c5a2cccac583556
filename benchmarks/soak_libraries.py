"""Files of example libraries and pose networks, mutated: read, or refused in words, cheaply.

Called by ``python benchmarks/soak.py libraries``. Libraries go through discovery, labelling and
extraction, networks through the probe in a process that may die of them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from queue import Empty, Queue
from threading import Thread

TESTS = Path(__file__).resolve().parents[1] / "tests"
FOLDERS = [str(TESTS), str(TESTS / "run"), str(TESTS / "video")]
SECONDS = 2.0
_MODEL_SECONDS = 60.0
_SHARE_OF_MODELS = 4


def libraries(folder: Path, count: int, seed: int) -> int:
    """Mutate ``count`` files, three of four of libraries; print what became of them; the number of faults."""
    sys.path[:0] = FOLDERS
    from library_fuzz import library_files, model_files
    from mutations import mutate

    os.environ["GESTURE_CACHE"] = str(folder / "cache")
    os.environ["GESTURE_MODELS"] = str(folder / "models")
    (folder / "made").mkdir()
    shelves = library_files(folder / "made")
    networks = model_files(folder / "made")
    counts: Counter[tuple[str, str]] = Counter()
    faults, slowest, models = 0, 0.0, _Models()
    for number in range(count):
        network = number % _SHARE_OF_MODELS == 0
        kinds = networks if network else shelves
        name = sorted(kinds)[number // _SHARE_OF_MODELS % len(kinds)]
        kind, data = mutate(kinds[name], f"{seed}:{number}")
        started = time.process_time()
        outcome = models.check(folder / name, data) if network else _library(folder, name, data)
        spent = 0.0 if network else time.process_time() - started
        slowest = max(slowest, spent)
        counts[outcome.split()[0], "networks" if network else "libraries"] += 1
        if outcome.startswith(("untyped", "hang")) or spent > SECONDS:
            faults += 1
            print(f"FAULT {seed}:{number} {name} {kind} {spent:.1f} s: {outcome}")
    models.end()
    for (outcome, what), n in sorted(counts.items()):
        print(f"{what:>10} {outcome:<24} {n:>7}")
    print(f"{count} files, slowest library file {slowest:.2f} s, peak {_peak_mib()} MiB, {faults} faults")
    return faults


def _library(folder: Path, name: str, data: bytes) -> str:
    from library_fuzz import check_library

    try:
        return str(check_library(folder, name, data))
    except Exception as error:  # noqa: BLE001 - whatever is not typed is what is looked for
        return f"untyped {type(error).__name__}: {error}"


class _Models:
    """The disposable process; ``crash`` and ``hang`` are what a run would turn into E_MODEL_PROBE."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def check(self, path: Path, data: bytes) -> str:
        path.write_bytes(data)
        if self._process is None:
            self._start()
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write(f"{path}\n")
        self._process.stdin.flush()
        try:
            line = self._lines.get(timeout=_MODEL_SECONDS)
        except Empty:
            self.end()
            return "hang"
        if not line:
            self.end()
            return "crash"
        return str(json.loads(line))

    def end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._process = None

    def _start(self) -> None:
        path = os.pathsep.join([*FOLDERS, *filter(None, [os.environ.get("PYTHONPATH")])])
        self._process = subprocess.Popen(
            [sys.executable, str(TESTS / "run" / "library_fuzz.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        )
        self._lines: Queue[str] = Queue()
        Thread(target=self._listen, args=(self._process, self._lines), daemon=True).start()

    @staticmethod
    def _listen(process: subprocess.Popen[str], lines: Queue[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            lines.put(line)
        lines.put("")


def _peak_mib() -> int:
    status = Path("/proc/self/status")
    return int(status.read_text().split("VmHWM:")[1].split()[0]) // 1024 if status.is_file() else 0
