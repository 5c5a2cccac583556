"""The rules of the house: imports point one way, and nothing heavy is imported before it is used."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from conftest import ROOT

CORE = ROOT / "gesture_core"
HEAVY = {"jax", "torch", "cv2", "onnxruntime", "numba", "pyarrow", "av", "sklearn", "matplotlib"}
FLOORS = [
    {"errors", "files", "colours", "__init__"},
    {"joints", "skeletons", "joint_names"},
    {"dtw.spec"},
    {"records", "channel_names", "recordings", "types", "plugin"},
    {"settings"},
    {"video", "pose", "signals", "dtw", "demo"},
    {"classify"},
    {"spot"},
    {"run"},
    {"report", "testing"},
    {"cli", "__main__"},
]


def floor(module: str) -> int:
    """The floor of a module below ``gesture_core``; imports may only go down or stay."""
    prefixes = {".".join(module.split(".")[:depth]) for depth in (1, 2)}
    for level, names in enumerate(FLOORS):
        if prefixes & names:
            return level
    raise AssertionError(f"{module} stands on no floor")


def imports(path: Path, *, everywhere: bool) -> set[str]:
    """Absolute modules that a file imports: at module level only, or in functions and for types as well."""
    tree = ast.parse(path.read_text("utf-8"))
    found: set[str] = set()
    for node in ast.walk(tree) if everywhere else iter(tree.body):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(CORE).with_suffix("").parts).removesuffix(".__init__")


CORE_FILES = sorted(CORE.rglob("*.py"))
PLUGIN_FILES = sorted((ROOT / "plugins").glob("*/gesture_*/**/*.py"))


@pytest.mark.parametrize("path", CORE_FILES, ids=module_name)
def test_core_imports_point_down(path: Path) -> None:
    """Also inside functions and for types alone; but for the public face, which names what lies anywhere."""
    mine = floor(module_name(path))
    for name in imports(path, everywhere=path != CORE / "__init__.py"):
        if name.startswith("gesture_core."):
            inner = name.removeprefix("gesture_core.")
            if inner != "__version__":
                assert floor(inner) <= mine, f"{module_name(path)} imports {name}"


@pytest.mark.parametrize("path", CORE_FILES, ids=module_name)
def test_core_never_imports_a_plugin_nor_anything_heavy_at_module_level(path: Path) -> None:
    plugins = {p.name for p in (ROOT / "plugins").iterdir()}
    assert not {name.split(".")[0] for name in imports(path, everywhere=True)} & plugins
    needed = {"sklearn"} if module_name(path) == "classify.estimator" else set()  # a class needs its bases
    assert not {name.split(".")[0] for name in imports(path, everywhere=False)} & (HEAVY - needed)


@pytest.mark.parametrize("path", PLUGIN_FILES, ids=lambda p: str(p.relative_to(ROOT / "plugins")))
def test_plugins_import_neither_each_other_nor_the_upper_floors(path: Path) -> None:
    own = path.relative_to(ROOT / "plugins").parts[0]
    for name in imports(path, everywhere=True):
        if name.startswith("gesture_") and not name.startswith("gesture_core"):
            assert name.split(".")[0] == own, name
        if name.startswith("gesture_core."):
            inner = name.removeprefix("gesture_core.")
            for_engines = own.startswith("gesture_engine_") and inner.startswith("run.workers.worker")
            assert for_engines or floor(inner) <= floor("dtw"), name


FOR_KERNELS = {
    "files",
    "dtw.bands",
    "dtw.batches",
    "dtw.lanes",
    "dtw.subsequence",
    "dtw.spec",
    "errors",
    "plugin.abilities",
    "plugin.hooks",
    "plugin.interfaces",
    "types",
}
PUBLIC_FOR = {
    "gesture_dtw_jax": FOR_KERNELS,
    "gesture_dtw_numba": FOR_KERNELS,
    "gesture_dtw_numpy": FOR_KERNELS,
    "gesture_dtw_torch": FOR_KERNELS | {"signals.mirror"},
    "gesture_engine_ray": {
        "errors",
        "files",
        "plugin.hooks",
        "records",
        "run.workers.worker",
        "settings",
    },
    "gesture_pose_files": {
        "errors",
        "files",
        "plugin.hooks",
        "joint_names",
        "joints",
        "plugin.interfaces",
        "plugin.reading",
        "pose",
        "channel_names",
        "recordings",
        "skeletons",
        "types",
    },
    "gesture_pose_onnx": {"errors", "plugin.hooks", "pose"},
    "gesture_pose_opencv": {"errors", "plugin.hooks", "pose"},
    "gesture_signals": {"errors", "joints", "plugin.hooks", "skeletons", "types"},
    "gesture_video": {"errors", "plugin.hooks", "records", "video"},
}
"""Modules below ``gesture_core`` from which a plugin may import what their ``__all__`` lists, or all where
there is none."""


@pytest.mark.parametrize(
    "path",
    [path for path in PLUGIN_FILES if path.parent.name in PUBLIC_FOR],
    ids=lambda p: str(p.relative_to(ROOT / "plugins")),
)
def test_plugins_import_only_what_is_public_for_their_kind(path: Path) -> None:
    modules = {f"gesture_core.{name}" for name in PUBLIC_FOR[path.parent.name]}
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            assert not [alias.name for alias in node.names if alias.name.startswith("gesture_core")]
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("gesture_core"):
            assert node.module in modules, node.module
            public = getattr(import_module(node.module), "__all__", None)
            names = {alias.name for alias in node.names}
            assert names <= set(public) if public else not any(name.startswith("_") for name in names), names


@pytest.mark.parametrize("path", sorted((ROOT / "plugins").glob("*/*/hooks.py")), ids=lambda p: p.parent.name)
def test_hooks_hold_registrations_only(path: Path) -> None:
    allowed = {"gesture_core.plugin.hooks", "gesture_core.plugin.hooks.Register"}
    allowed |= {"gesture_core.plugin.hooks.hookimpl", "__future__", "__future__.annotations"}
    assert imports(path, everywhere=True) <= allowed


def loaded_by(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter has after ``code``."""
    script = f"import sys\n{code}\nprint(*{{m.split('.')[0] for m in sys.modules}}, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stderr.split())


def test_importing_the_package_imports_no_numpy() -> None:
    assert not loaded_by("import gesture_core") & (HEAVY | {"numpy", "scipy"})


def test_help_imports_nothing_heavy() -> None:
    code = "from gesture_core.cli.main import _COMMANDS, run\nassert run(['--help']) == 0"
    assert not loaded_by(code) & (HEAVY | {"numpy", "scipy", "pluggy"})
    code += "\nfor name in _COMMANDS:\n    assert run([name, '--help']) == 0"
    assert not loaded_by(code) & (HEAVY | {"numpy", "scipy"})


def test_listing_plugins_imports_none_of_them() -> None:
    assert not loaded_by("from gesture_core.cli.main import run\nassert run(['plugins']) == 0") & HEAVY


def test_recognizing_needs_no_scikit_learn() -> None:
    assert "sklearn" not in loaded_by("from gesture_core.classify.recognizer import Recognizer")


def test_public_names_exist() -> None:
    import gesture_core

    for name in gesture_core.__all__:
        assert getattr(gesture_core, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = gesture_core.nonsense  # type: ignore[attr-defined]
