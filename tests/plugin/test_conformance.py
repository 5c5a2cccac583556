"""Every registered plugin, the project's own and third parties', keeps the contract of its kind."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from _pytest.mark import ParameterSet
from conftest import ROOT
from tool_files import (
    BONES,
    NAMES,
    POINTS,
    write_bvh,
    write_c3d,
    write_csv,
    write_pose,
    write_sleap,
    write_trc,
)

from gesture_core.demo.archive import DemoArchive
from gesture_core.plugin import registry
from gesture_core.plugin.hooks import KINDS
from gesture_core.plugin.interfaces import INTERFACES
from gesture_core.plugin.template import write_plugin
from gesture_core.pose.models import find_model
from gesture_core.run.store import write_keypoints
from gesture_core.settings import LimitSettings, load_settings, presets
from gesture_core.skeletons import COCO18
from gesture_core.testing import checks_for, draw_pose

CHAIN = ("normalizer", "filter", "selector")
"""Kinds whose plugins take part in a preset with other options than their own defaults."""


def runs_its_suite(kind: str, name: str) -> bool:
    """Whether the tests in the plugin's own folder put it through the suite of its kind."""
    plugin = registry().make(kind, name)
    package = type(plugin).__module__.partition(".")[0]
    tests = (ROOT / "plugins" / package / "tests").glob("test_*.py")
    texts = [file.read_text("utf-8") for file in tests]
    return any(f"{type(plugin).__name__}(" in text and f"{kind.upper()}_CHECKS" in text for text in texts)


def every(*kinds: str) -> list[ParameterSet]:
    """A parameter set for each check of each usable plugin of ``kinds`` whose own tests do not make it."""
    return [
        # Kernels mostly compile, which a busy machine draws out.
        pytest.param(
            *(kind, name, check),
            id=f"{name}-{check.__name__}",
            marks=[pytest.mark.timeout(900)] if kind == "kernel" else [],
        )
        for kind in kinds
        for name in registry().names(kind, usable=True)
        if kind not in ("kernel", "classifier", *CHAIN) or not runs_its_suite(kind, name)
        for check in checks_for(kind)
    ]


@cache
def reference_page() -> str:
    """``docs/reference/plugins.md``, or what ``docs/generate.py`` makes of it while the site is built."""
    page, generator = ROOT / "docs" / "reference" / "plugins.md", ROOT / "docs" / "generate.py"
    if page.is_file():
        return page.read_text("utf-8")
    pytest.importorskip("mkdocs", reason="mkdocs makes the page, and is not installed")
    spec = spec_from_file_location("generate", generator)
    assert spec and spec.loader, "there is no page, and nothing that makes it"
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    pages: list[str] = [*module.interfaces_page(), *module.plugins_page()]
    return "\n".join(pages)


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_has_an_interface_a_suite_a_template_and_a_page(kind: str, tmp_path: Path) -> None:
    assert INTERFACES[kind] and checks_for(kind)
    assert write_plugin(kind, "something-new", tmp_path)
    text = reference_page()
    assert KINDS[kind].hook in text and KINDS[kind].title in text, f"the page names no {KINDS[kind].title}"
    assert INTERFACES[kind].__name__ in text


def test_an_unknown_kind_has_no_suite() -> None:
    with pytest.raises(ValueError, match="one of classifier, engine, filter, kernel"):
        checks_for("colour")


@pytest.mark.parametrize(("kind", "name", "check"), every("kernel", "classifier", "writer", "video", *CHAIN))
def test_the_contract(kind: str, name: str, check: Callable[[object], None]) -> None:
    check(registry().make(kind, name))


@pytest.mark.parametrize("preset", presets())
def test_the_contract_under_the_options_of_a_preset(preset: str) -> None:
    settings = load_settings(preset, environment={})
    steps = [("normalizer", settings.signals.normalizer), ("selector", settings.signals.selector)]
    steps += [("filter", name) for name in settings.signals.filters]
    for kind, name in steps:
        for check in checks_for(kind):
            check(registry().make(kind, name, settings.options.get(name, {})))


@pytest.mark.parametrize(("kind", "name", "check"), every("engine"))
def test_the_contract_of_an_engine(kind: str, name: str, check: Callable[[object], None]) -> None:
    check(registry().make(kind, name, {}, workers=2, limits=LimitSettings()))


@cache
def backend(name: str) -> object:
    return registry().make("pose", name, {}, model=find_model("compact"))


@pytest.mark.parametrize(("kind", "name", "check"), every("pose"))
def test_the_contract_of_a_pose_backend(kind: str, name: str, check: Callable[[object], None]) -> None:
    check(backend(name))


@pytest.fixture(scope="module")
def samples(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A sample for each keypoint reader, by its name."""
    folder = tmp_path_factory.mktemp("samples")
    poses = [draw_pose(seed, frames=8) for seed in range(2)]
    np.savez(folder / "two.npz", first=poses[0].keypoints, second=poses[1].keypoints)
    np.savetxt(folder / "bare.csv", poses[0].keypoints.reshape(8, -1), delimiter=",")
    write_keypoints(folder / "stored.parquet", poses[:1], {})
    (folder / "frames").mkdir()
    people = []
    for number, joints in enumerate(poses[0].keypoints):
        np.save(folder / "frames" / f"{number}.npy", joints)
        values = np.column_stack([joints, np.ones(len(joints))]).reshape(-1).tolist()
        people.append({"image_id": f"{number}.jpg", "keypoints": values, "score": 1.0})
    (folder / "list.json").write_text(json.dumps(people))
    (folder / "own.json").write_text(json.dumps(poses[0].keypoints.tolist()))
    scipy.io.savemat(folder / "clip.mat", {"keypoints": poses[0].keypoints})
    names = [f"{joint}_{axis}" for joint in COCO18.joints for axis in "xy"]
    columns = dict(zip(names, poses[0].keypoints.reshape(8, -1).T, strict=True))
    pq.write_table(pa.table(columns), folder / "table.parquet")
    (folder / "labels").mkdir()
    for number, joints in enumerate(poses[0].keypoints[:, :17] / (640, 480)):
        line = "0 0.5 0.5 0.9 0.9 " + " ".join(f"{x} {y} 1" for x, y in joints)
        (folder / "labels" / f"clip_{number}.txt").write_text(line)
    np.savetxt(folder / "acc.csv", POINTS[:, :3, 0], "%.2f", ",", header="acc_x,acc_y,acc_z", comments="")
    pytest.importorskip("h5py"), pytest.importorskip("pose_format"), pytest.importorskip("c3d")
    flat = np.concatenate([POINTS, np.zeros_like(POINTS[..., :1])], axis=2)
    return {
        "array-frames": folder / "frames",
        "bvh": write_bvh(folder / "clip.bvh", np.zeros((4, len(BONES), 3))),
        "c3d": write_c3d(folder / "clip.c3d", flat * [1, -1, 1], NAMES),
        "deeplabcut-csv": write_csv(folder / "dlc.csv", [""]),
        "hdf5": write_sleap(folder / "analysis.h5"),
        "pose-format": write_pose(folder / "clip.pose"),
        "result-list": folder / "list.json",
        "series": folder / "acc.csv",
        "trc": write_trc(folder / "clip.trc", flat, "px"),
        "arrays": folder / "two.npz",
        "csv": folder / "bare.csv",
        "json-table": folder / "own.json",
        "matlab": folder / "clip.mat",
        "arrow-table": folder / "table.parquet",
        "yolo-text": folder / "labels",
        "openpose-json": next(path for path in sorted(drawn.video_keypoints.iterdir()) if path.is_dir()),
        "store": folder / "stored.parquet",
    }


@pytest.mark.parametrize(("kind", "name", "check"), every("reader"))
def test_the_contract_of_a_keypoint_reader(
    kind: str, name: str, check: Callable[[object, Path], None], samples: dict[str, Path]
) -> None:
    assert name in samples, f"keypoint reader {name!r} needs a sample here"
    check(registry().make(kind, name), samples[name])
