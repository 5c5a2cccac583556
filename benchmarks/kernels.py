"""The DTW engine against other libraries and against hand-written C.

    python benchmarks/kernels.py [--shared ../shared] [--plot docs/images/kernels.png]
    python benchmarks/kernels.py --only subsequence

Installs the peers into an environment of their own (``.venv-peers``), compiles ``lanes.c``, and
prints one table for each goal. CPU-seconds are of one thread unless a row says otherwise; medians.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from environment import header, one_thread

from gesture_core.dtw.batches import make_batches
from gesture_core.dtw.reference import reference_distance
from gesture_core.dtw.soft import soft_warping_gradient
from gesture_core.dtw.spec import DtwSpec
from gesture_core.dtw.subsequence import choose_subsequence_kernel, reference_subsequences
from gesture_core.plugin import registry
from gesture_core.types import Signals

HERE = Path(__file__).resolve().parent
PEERS = HERE.parent / ".venv-peers"
PACKAGES = ("aeon==1.6.0", "tslearn==0.10.0", "dtaidistance==2.5.1", "fastdtw==0.3.4", "stumpy==1.14.1")
KERNELS = ("numba", "jax", "torch", "torch, compiled", "numpy")
PLAIN = ("numba", "jax", "torch")
TASKS = ("one", "several", "paper", "soft", "subsequence")
BLOCK = 512
"""Frames of a stream at once, where real time is asked for."""
FLOOR = 0.05
"""Under the variances of subsequences, as `spot.floor`."""
RUNS = 7
WARM_UP = 0.5
SQUARED = DtwSpec(cost="squared", reduce="sum")


def peer_environment() -> Path:
    """The peers' Python, made on first use."""
    python = PEERS / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(PEERS)], check=True)
    have = subprocess.run(
        [python, "-c", "import aeon, tslearn, dtaidistance, fastdtw, stumpy"], capture_output=True
    )
    if have.returncode:
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    return python


def hand_written() -> float | None:
    """Billions of cells for each CPU-second of the C program; None without gcc or AVX2."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "lanes"
        command = ["gcc", "-O3", "-mavx2", "-mfma", str(HERE / "lanes.c"), "-o", str(program)]
        try:
            subprocess.run(command, check=True, capture_output=True)
            done = subprocess.run([program], check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"no C program here: {error}")
            return None
        return float(done.stdout)


def measure(compute: Callable[[], object], runs: int = RUNS) -> tuple[float, float]:
    """Median CPU-seconds and wall seconds, after a warm-up that outlasts what ran before."""
    warm = time.perf_counter() + WARM_UP
    compute()
    while time.perf_counter() < warm:
        compute()
    cpu, wall = [], []
    for _ in range(runs):
        start = time.process_time(), time.perf_counter()
        compute()
        cpu.append(time.process_time() - start[0])
        wall.append(time.perf_counter() - start[1])
    return statistics.median(cpu), statistics.median(wall)


def table_of(name: str, a: list, b: list, spec: DtwSpec, threads: int = 1) -> Callable[[], np.ndarray]:
    """What computes all distances on kernel ``name``, preparation of the examples left out."""
    options = {"numba": {"threads": threads}, "torch, compiled": {"compiled": True}}
    kernel = registry().make("kernel", name.partition(",")[0], options.get(name, {}))
    queries, examples = make_batches(a, b, spec)
    state = kernel.prepare(examples, spec)
    return lambda: kernel.distances(state, queries)


def usable() -> list[str]:
    """The kernels to measure."""
    if "torch" in registry().names("kernel", usable=True):
        import torch

        torch.set_num_threads(1)
    return [name for name in KERNELS if name.partition(",")[0] in registry().names("kernel", usable=True)]


def walks(rng: np.random.Generator, count: int, length: int, width: int) -> np.ndarray:
    """(count, length, width) float32 random walks."""
    return np.cumsum(rng.normal(size=(count, length, width)), axis=1).astype(np.float32) / 4


def gestures(rng: np.random.Generator, count: int, width: int = 36) -> list[Signals]:
    """Series of 40 to 90 frames of which about a third of the channels are salient, as the paper's are."""
    names = tuple(f"c{d}" for d in range(width))
    lengths = rng.integers(40, 91, count)
    return [
        Signals(walks(rng, 1, n, width)[0], np.arange(n), names, rng.random(width) < 0.2) for n in lengths
    ]


def ask_peers(data: dict[str, np.ndarray]) -> dict:
    """Run peers.py in its environment."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "input.npz"
        np.savez(path, **data)
        done = subprocess.run(
            [peer_environment(), HERE / "peers.py", path], check=True, capture_output=True, text=True
        )
    return json.loads(done.stdout.splitlines()[-1])


def check_conventions(peers: dict, data: dict[str, np.ndarray]) -> None:
    """Ask the reference for what the peers computed: the same choices, or the ratios mean nothing."""
    rooted = SQUARED.replace(mode="dependent", root=True)
    specs = {"one": rooted, "several": rooted, "soft": rooted.replace(root=False, gamma=float(data["gamma"]))}
    wanted = {}
    for task, spec in specs.items():
        x, y = (data[f"{task}_{side}"][0].reshape(64, -1) for side in "ab")
        wanted[task] = reference_distance(x, y, spec)
    # Steps through a stream are other ones than the kernel's: here the libraries are held to each other.
    wanted["subsequence"] = peers["subsequence"]["tslearn"][1]
    for task in wanted.keys() & peers.keys():
        for name, (_, found) in peers[task].items():
            if np.isfinite(found) and abs(found - wanted[task]) > 1e-5 * abs(wanted[task]):
                raise SystemExit(f"{name} computes {found} where {wanted[task]} is expected ({task})")


def line(name: str, cpu: float, cells: float, best: float, *more: str) -> None:
    """A row: kernel, CPU-microseconds for each pair, billions of cells, ratio to the best peer."""
    extra = "".join(f" {text} |" for text in more)
    print(f"| {name} | {cpu * 1e6:.3f} | {cells / cpu / 1e9:.3f} | {best / cpu:.1f} |{extra}", flush=True)


def heading(title: str, *more: str) -> None:
    """A table's head."""
    print(f"\n### {title}\n")
    print("| | µs CPU / pair | Gcells / CPU-s | × best peer |" + "".join(f" {text} |" for text in more))
    print("|---|---|---|---|" + "---|" * len(more), flush=True)


def peer_lines(peers: dict, cells: float) -> float:
    """Print the peers' rows; the best one's CPU-seconds for each pair."""
    best = min(cpu for cpu, _ in peers.values())
    for name, (cpu, _) in sorted(peers.items(), key=lambda item: item[1][0]):
        line(name, cpu, cells, best)
    return best


def subsequences(query: np.ndarray, stream: np.ndarray, examples: list[np.ndarray], peers: dict) -> None:
    """Tables 8 and 9: one query in a stream beside the peers, and many examples against real time."""
    heading(f"8. One query of {len(query)} frames × {query.shape[1]} channels over {len(stream):,} frames")
    cells = float(len(query) * len(stream))
    best = peer_lines(peers, cells)
    names = [name for name in PLAIN if name in registry().names("kernel", usable=True)]
    for name in names:
        kernel = choose_subsequence_kernel(name, {name: {"threads": 1}} if name == "numba" else None)[1]
        found = kernel.subsequences([query], FLOOR).push(stream[:300])[0][:, 0]
        np.testing.assert_allclose(found, reference_subsequences(stream[:300], query, FLOOR)[0], 1e-4)
        cpu, _ = measure(lambda kernel=kernel: kernel.subsequences([query], FLOOR).push(stream))
        line(f"**{name}**", cpu, cells, best)
    shape = f"{len(examples)} examples of {len(query)} frames × {query.shape[1]} channels"
    print(f"\n### 9. {shape}, blocks of {BLOCK} frames\n")
    print("| | µs CPU / frame | µs wall / frame | × real time at 20 Hz |\n|---|---|---|---|", flush=True)
    for name, threads in [("numba", 1), ("numba", 2)] if "numba" in names else []:
        kernel = choose_subsequence_kernel(name, {name: {"threads": threads}})[1]
        state = kernel.subsequences(examples, FLOOR)
        cpu, wall = measure(lambda state=state: state.push(stream[:BLOCK]), 101)
        row = f"| **{name}**, threads: {threads} | {cpu / BLOCK * 1e6:.1f} | {wall / BLOCK * 1e6:.1f} |"
        print(f"{row} {BLOCK / 20 / wall:,.0f} |", flush=True)


def main() -> None:
    """Print every table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shared", type=Path, default=HERE.parent / ".." / "shared")
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--only", choices=["subsequence"])
    arguments = parser.parse_args()
    one_thread()
    kernels = usable()
    rng = np.random.default_rng(0)
    one_a, one_b = walks(rng, 256, 64, 1), walks(rng, 256, 64, 1)
    many_a, many_b = walks(rng, 64, 64, 28), walks(rng, 64, 64, 28)
    queries, examples = gestures(rng, 1000), gestures(rng, 100)
    sample = [(queries[i], examples[i]) for i in range(40)]
    data: dict[str, np.ndarray] = {
        "one_a": one_a[:, :, 0],
        "one_b": one_b[:, :, 0],
        "several_a": many_a,
        "several_b": many_b,
        "soft_a": many_a[:24, :, :3],
        "soft_b": many_b[:24, :, :3],
        "gamma": np.array(1.0),
        "paper_count": np.array(len(sample)),
        "tasks": np.array([arguments.only] if arguments.only else TASKS),
        "query": rng.normal(size=(40, 36)).astype(np.float32),
        "stream": rng.normal(size=(12_000, 36)).astype(np.float32),
    }
    many = [rng.normal(size=(40, 36)).astype(np.float32) for _ in range(180)]
    for i, (x, y) in enumerate(sample):
        data[f"paper_{i}_x"] = np.ascontiguousarray(x.values.T, np.float64)
        data[f"paper_{i}_y"] = np.ascontiguousarray(y.values.T, np.float64)
        data[f"paper_{i}_use"] = np.asarray(x.mask) | np.asarray(y.mask)
    peers = ask_peers(data)
    check_conventions(peers, data)
    header({name: str(number) for name, number in peers.pop("versions").items()})
    if arguments.only:
        subsequences(data["query"], data["stream"], many, peers["subsequence"])
        return

    heading("1. Hard, one dimension, length 64, 256 × 256, one thread", "× C")
    square = 64.0 * 64
    best = peer_lines(peers["one"], square)
    compiled = hand_written()
    if compiled is not None:
        line("C, AVX2 by hand", square / compiled / 1e9, square, best, "1.00")
    rates = {}
    for name in kernels:
        for dtype in (np.float32, np.float64):
            a, b = list(one_a.astype(dtype)), list(one_b.astype(dtype))
            compute = table_of(name, a, b, SQUARED)
            cpu = measure(compute)[0] / 256**2
            rates[f"{name} {dtype.__name__}"] = square / cpu / 1e9
            share = "" if compiled is None else f"{square / cpu / 1e9 / compiled:.2f}"
            line(f"**{name}** {dtype.__name__}", cpu, square, best, share)

    print("\n### 2. Threads, numba, wall seconds\n")
    big = list(walks(rng, 1024, 64, 1))
    walls = {threads: measure(table_of("numba", big, big, SQUARED, threads))[1] for threads in (1, 2)}
    print(f"one {walls[1]:.3f} s, two {walls[2]:.3f} s: × {walls[1] / walls[2]:.2f}", flush=True)

    heading("3. The paper's form: 36 channels, masks, 40 to 90 frames, 1,000 × 100", "wall s, all cores")
    counts = [int((np.asarray(x.mask) | np.asarray(y.mask)).sum()) * len(x) * len(y) for x, y in sample]
    each = float(np.mean(counts))
    best = peer_lines(peers["paper"], each)
    for name in (name for name in PLAIN if name in kernels):
        cpu, wall = measure(
            table_of(name, queries, examples, DtwSpec(), threads=0), 3 if name == "numba" else 1
        )
        line(f"**{name}**", cpu / 100_000, each, best, f"{wall:.2f}")

    heading("4. Dependent, 28 dimensions, length 64")
    best = peer_lines(peers["several"], square)
    for name in kernels:
        for dtype in (np.float32, np.float64):
            a, b = list(many_a.astype(dtype)), list(many_b.astype(dtype))
            compute = table_of(name, a, b, SQUARED.replace(mode="dependent"))
            line(f"**{name}** {dtype.__name__}", measure(compute)[0] / 64**2, square, best)

    heading("5. Soft-DTW, value and gradient, 3 dimensions, length 64, gamma 1")
    best = peer_lines(peers["soft"], square)
    soft = SQUARED.replace(mode="dependent", gamma=1.0)
    for name in (name for name in PLAIN if name in kernels):
        for dtype in (np.float32, np.float64):
            a, b = list(many_a[:48, :, :3].astype(dtype)), list(many_b[:48, :, :3].astype(dtype))
            cpu = measure(lambda a=a, b=b, name=name: soft_warping_gradient(a, b, soft, kernel=name), 3)[0]
            line(f"**{name}** {dtype.__name__}", cpu / 48**2, square, best)

    for script in ("search.py", "memory.py"):
        print(flush=True)
        subprocess.run([sys.executable, HERE / script, arguments.shared], check=False)
    subsequences(data["query"], data["stream"], many, peers["subsequence"])
    if arguments.plot:
        plot(arguments.plot, rates, peers["one"], compiled)


def plot(path: Path, rates: dict[str, float], peers: dict, compiled: float | None) -> None:
    """Bars of billions of cells for each CPU-second, on a logarithmic axis."""
    from gesture_core.colours import BLUE, GREY
    from gesture_core.report.style import new_figure, save

    bars = {**rates, **{name: 4096 / cpu / 1e9 for name, (cpu, _) in peers.items()}}
    if compiled is not None:
        bars["C, AVX2 by hand"] = compiled
    names = sorted(bars, key=bars.__getitem__)
    figure = new_figure(8, 4.6)
    axes = figure.add_subplot()
    for whose, colour, own in (("gesture-core", BLUE, True), ("others", GREY, False)):
        places = [place for place, name in enumerate(names) if (name in rates) is own]
        drawn = axes.barh(places, [bars[names[place]] for place in places], color=colour, label=whose)
        axes.bar_label(drawn, [f"{bars[names[place]]:.2g}" for place in places], padding=4, fontsize=9)
    axes.set_yticks(range(len(names)), names)
    axes.set_xscale("log")
    axes.set_xticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
    axes.set_xlim(right=3 * max(bars.values()))
    axes.set_xlabel("billions of cells for each CPU-second (hard, one dimension, length 64)")
    axes.legend(loc="lower right", frameon=False)
    for edge in ("top", "right"):
        axes.spines[edge].set_visible(False)
    save(figure, path)


if __name__ == "__main__":
    main()
