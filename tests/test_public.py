"""The public face: every name is there, lazily, typed, and documented by an example that runs."""

from __future__ import annotations

import ast
import doctest
import importlib
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

import gesture_core
from gesture_core.demo.archive import DemoArchive


def test_the_lazy_names_are_those_that_type_checkers_see() -> None:
    tree = ast.parse((ROOT / "gesture_core" / "__init__.py").read_text("utf-8"))
    (block,) = (
        node for node in tree.body if isinstance(node, ast.If) and "not" not in ast.unparse(node.test)
    )
    typed = {
        alias.asname: f"{node.module}".removeprefix("gesture_core.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert typed == gesture_core._PUBLIC
    assert sorted(gesture_core.__all__) == dir(gesture_core)


@pytest.mark.slow
def test_type_checkers_know_every_name(tmp_path: Path) -> None:
    names = [name for name in gesture_core.__all__ if name != "__version__"]
    lines = ["import gesture_core", *(f"reveal_type(gesture_core.{name})" for name in names)]
    lines += ["reveal_type(gesture_core.load_poses('clip.mp4'))", "gesture_core.nonsense"]
    (tmp_path / "snippet.py").write_text("\n".join(lines) + "\n", "utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", str(ROOT / "pyproject.toml")]
    done = subprocess.run(
        [*command, str(tmp_path / "snippet.py")], capture_output=True, text=True, cwd=ROOT, timeout=240
    )
    revealed = [line.split('"')[1] for line in done.stdout.splitlines() if "Revealed type is" in line]
    assert len(revealed) == len(names) + 1, done.stdout
    for name, kind in zip(names, revealed, strict=False):
        assert kind != "Any", name
    assert revealed[-1] in (
        "list[gesture_core.types.PoseSequence]",
        "builtins.list[gesture_core.types.PoseSequence]",
    )
    shown = dict(zip(names, revealed, strict=False))
    assert "queries:" in shown["warping_distances"] and "numpy.ndarray" in shown["warping_distances"]
    assert 'Module has no attribute "nonsense"' in done.stdout
    assert done.stdout.strip().endswith("Found 1 error in 1 file (checked 1 source file)")


@pytest.mark.parametrize(
    "name",
    ["run.evaluate.evaluate_archive", "run.explain.explain", "run.find.find",
     "report.evaluation.write_evaluation", "errors.Code", "settings.schema.Settings",
     "settings.load.load_settings"],
)  # fmt: skip
def test_examples_of_docstrings_run(
    name: str, drawn: DemoArchive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, _, attribute = name.rpartition(".")
    target = importlib.import_module(f"gesture_core.{module}")
    monkeypatch.chdir(tmp_path)
    for label in drawn.example_keypoints.iterdir():
        Path("examples", label.name).mkdir(parents=True)
        Path("examples", label.name, "1").symlink_to(label / "1")
        for clip in sorted(drawn.video_keypoints.iterdir()):
            if truth(drawn)[clip.name] == label.name and not Path("examples", label.name, "2").exists():
                Path("examples", label.name, "2").symlink_to(clip)
    if attribute == "explain":
        gesture_core.classify_archive(drawn.video_keypoints, "examples", "run")
    finder = doctest.DocTestFinder(recurse=False)
    (found,) = finder.find(getattr(target, attribute), attribute, module=target)
    assert found.examples
    result = doctest.DocTestRunner(optionflags=doctest.FAIL_FAST).run(found)
    assert result.failed == 0


def truth(drawn: DemoArchive) -> dict[str, str]:
    """The label of each clip by its name."""
    import csv

    with drawn.truth.open(newline="", encoding="utf-8") as file:
        return {Path(row["path"]).stem: row["label"] for row in csv.DictReader(file)}
