"""The engine on Ray keeps the contract of engines, and a machine that dies costs nothing but time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from gesture_engine_ray.engine import RayEngine

from gesture_core import classify_archive
from gesture_core.errors import ConfigError
from gesture_core.records import Job, Task
from gesture_core.run.export import export_rows
from gesture_core.run.extract import Listener
from gesture_core.run.workers.worker import Worker
from gesture_core.settings import LimitSettings, load_settings
from gesture_core.testing import ENGINE_CHECKS

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'gesture-core[ray]'")
pytestmark = pytest.mark.slow
LIMITS = LimitSettings(memory=200)
OPTIONS: dict[str, Any] = {"limits__memory": 200, "classify__kernel": "numpy"}


FIGURE = (
    (0.50, 0.10), (0.50, 0.22), (0.38, 0.22), (0.32, 0.36), (0.30, 0.50), (0.62, 0.22), (0.68, 0.36),
    (0.70, 0.50), (0.42, 0.52), (0.42, 0.72), (0.42, 0.92), (0.58, 0.52), (0.58, 0.72), (0.58, 0.92),
    (0.44, 0.02), (0.56, 0.02), (0.38, 0.08), (0.62, 0.08),
)  # fmt: skip
"""Somebody who stands, in COCO-18."""
DEADLY = """
import logging, os, time
from gesture_core import hookimpl
@hookimpl
def register_keypoint_readers(register):
    register("deadly", "deadly:Deadly", suffixes=(".deadly", ".hanging"))
class Deadly:
    def accepts(self, path):
        if path.suffix == ".raising":
            raise ValueError("not today")
        time.sleep(600) if path.suffix == ".hanging" else os._exit(9)
    def members(self, path):
        logging.getLogger("gesture_core").warning("looked into it")
        return [f"{name}={os.environ.get(name)}" for name in path.suffix.split("+")[1:]] or [""]
    def read(self, path, member=""):
        return []
"""


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Two machines of one core each, on which a deadly reader is installed."""
    from ray.cluster_utils import Cluster

    site = tmp_path_factory.mktemp("site")
    (site / "deadly.py").write_text(DEADLY, "utf-8")
    facts = site / "deadly-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: deadly\nVersion: 1.0\n", "utf-8")
    (facts / "entry_points.txt").write_text("[gesture_core]\ndeadly = deadly\n", "utf-8")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])])
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    made.second = made.add_node(num_cpus=1)
    ray.init(address=made.address, log_to_driver=False)
    yield made
    ray.shutdown()
    made.shutdown()


@pytest.mark.parametrize("check", ENGINE_CHECKS, ids=lambda check: check.__name__)
def test_the_contract(cluster: Any, check: Callable[[RayEngine], None]) -> None:
    check(RayEngine(workers=2, limits=LIMITS))


def test_what_cannot_be_declared_is_refused() -> None:
    with pytest.raises(ConfigError, match="cpus above zero"):
        RayEngine(workers=1, limits=LIMITS, cpus=0)


def test_a_task_that_ends_its_process_twice_is_given_up(cluster: Any) -> None:
    engine = RayEngine(workers=2, limits=LIMITS)
    job = Job(load_settings("paper").as_dict(), "")
    tasks = [Task(n, "suffix", {"format": "csv"}) for n in range(6)]
    deadly = Task(6, "accepts", {"reader": "deadly", "paths": [os.fsencode("a.deadly").hex()]})
    try:
        outcomes = {one.number: one for one in engine.run(job, [deadly, *tasks], lambda task, frames: None)}
    finally:
        engine.close()
    assert [outcomes[number].value for number in range(6)] == [".csv"] * 6
    error = outcomes[6].error
    assert error is not None and (error.code, outcomes[6].attempts) == ("E_WORKER_CRASH", 2)


def test_a_task_that_hangs_is_given_up(cluster: Any) -> None:
    engine = RayEngine(workers=1, limits=LimitSettings(memory=200, seconds=1))
    job = Job(load_settings("paper").as_dict(), "")
    hanging = Task(0, "accepts", {"reader": "deadly", "paths": [os.fsencode("a.hanging").hex()]})
    try:
        (outcome,) = engine.run(job, [hanging], lambda task, frames: None)
    finally:
        engine.close()
    assert outcome.error is not None and outcome.error.code == "E_WORKER_HANG"


def test_what_is_asked_for_here_is_done_there(
    cluster: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Flags hold for the actors; a folder of this machine does where there is one of that name."""
    clip, store = tmp_path / "clip.npz", tmp_path / "cache" / "keypoints"
    write_clip(clip, 4, 0)
    job = Job(load_settings("paper").as_dict(), str(store), {"reader arrays": "0" * 16})
    extract = Task(1, "extract", {"path": os.fsencode(clip).hex(), "member": "", "reader": "arrays"})
    kept = Worker(job, lambda message: None).perform(extract).value["stored"]
    assert Worker(job, lambda message: None).perform(extract).value["cached"]
    places = {"GESTURE_CACHE": str(tmp_path / "cache"), "GESTURE_MODELS": str(tmp_path / "models")}
    flags = {"GESTURE_NO_CACHE": "1", "GESTURE_TRACEBACK": "1", "GESTURE_OFFLINE": ""}
    for name, value in {**places, **flags}.items():
        monkeypatch.setenv(name, value)
    names = os.fsencode(f"clip.+{'+'.join([*places, *flags])}").hex()
    tasks = [
        Task(0, "members", {"reader": "deadly", "path": names}),
        extract,
        Task(2, "accepts", {"reader": "deadly", "paths": [os.fsencode("a.raising").hex()]}),
    ]
    engine = RayEngine(workers=1, limits=LIMITS, actors=1)
    try:
        outcomes = {one.number: one.value for one in engine.run(job, tasks, lambda task, frames: None)}
    finally:
        engine.close()
    there = {**places, "GESTURE_MODELS": None, **flags}
    assert outcomes[0] == [f"{name}={value}" for name, value in there.items()]
    assert "looked into it" in caplog.text
    assert (outcomes[1]["stored"], outcomes[1]["cached"]) == (kept, False)
    assert "in accepts" in capsys.readouterr().err


class Killing(Listener):
    """Kills a machine, and adds another one, at each ``every``-th input, ``kills`` times in all."""

    def __init__(self, cluster: Any, every: int, kills: int) -> None:
        self._cluster, self._every, self.kills, self.names = cluster, every, kills, list[str]()

    def extracted(self, name: str, cached: bool) -> None:
        self.names.append(name)
        if self.kills and len(self.names) % self._every == 0:
            self.kills -= 1
            self._cluster.remove_node(self._cluster.second, allow_graceful=False)
            self._cluster.second = self._cluster.add_node(num_cpus=1)


def write_clip(path: Path, joint: int, seed: int) -> None:
    """Somebody whose arm swings."""
    import numpy as np

    path.parent.mkdir(parents=True, exist_ok=True)
    rng, t = np.random.default_rng(seed), np.arange(40)
    points = 200 * np.array(FIGURE) + rng.normal(0, 0.3, (40, 18, 2))
    points[:, joint] += np.stack([60 * np.sin(t / 6), 40 * np.cos(t / 6)], axis=1)
    np.savez(path, keypoints=points, scores=np.ones((40, 18)), times=t / 20, skeleton=np.array("coco18"))


def test_a_machine_that_is_killed_changes_no_row(
    cluster: Any, tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", joint, joint)
    count, kills = (1000, 20) if pytestconfig.getoption("--thorough", False) else (60, 1)
    for number in range(count):
        write_clip(tmp_path / "videos" / f"{number:04d}.npz", (4, 7)[number % 2], 100 + number)
    killing, exports = Killing(cluster, 18 if kills == 1 else 45, kills), []
    for engine in ("ray", "inline"):
        listener = killing if engine == "ray" else Listener()
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("GESTURE_CACHE", str(tmp_path / engine))
            summary = classify_archive(
                tmp_path / "videos", tmp_path / "examples", tmp_path / f"run-{engine}", "paper",
                engine=engine, listener=listener, **OPTIONS,
            )  # fmt: skip
        assert sum(summary.counts.values()) == count
        export_rows(tmp_path / f"run-{engine}", "csv", tmp_path / f"{engine}.csv", LimitSettings())
        exports.append((tmp_path / f"{engine}.csv").read_text("utf-8").splitlines())
    assert not killing.kills, "a machine lives that was to be killed"
    ray_rows, one = exports
    assert len(ray_rows) == len(one) == count + 1
    assert ray_rows == one  # whose inputs lie in the same folder: byte for byte
