"""Each folder of ``plugins/`` that is a distribution builds alone, and its wheel has what it announces."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest
from conftest import ROOT

DISTRIBUTIONS = sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))


@pytest.mark.slow
@pytest.mark.parametrize("folder", DISTRIBUTIONS, ids=lambda folder: folder.name)
def test_it_builds_alone(folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    done = subprocess.run([*command, "--wheel-dir", tmp_path, folder], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with ZipFile(wheel) as archive:
        names = archive.namelist()
        (entry_points,) = (name for name in names if name.endswith("entry_points.txt"))
        announced = archive.read(entry_points).decode()
    project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    assert wheel.name.startswith(f"{folder.name}-{project['version']}-")
    for name, module in project["entry-points"]["gesture_core"].items():
        assert f"{name} = {module}" in announced
        assert f"{module.replace('.', '/')}.py" in names
    kept = {path.relative_to(folder).as_posix() for path in (folder / folder.name).rglob("*.py")}
    assert kept <= set(names), "the wheel lacks a file of the package"
    inside = {name.split("/")[0] for name in names}
    assert inside == {folder.name, entry_points.split("/")[0]}, "the wheel has more than the package"


@pytest.mark.parametrize("folder", DISTRIBUTIONS, ids=lambda folder: folder.name)
def test_it_has_a_readme_and_tests_of_its_own(folder: Path) -> None:
    assert 8 <= len((folder / "README.md").read_text("utf-8").splitlines()) <= 60
    assert list((folder / "tests").glob("test_*.py"))


def test_no_two_test_files_have_one_name() -> None:
    """As pytest imports them, both would be one module."""
    files = [*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "plugins").glob("*/tests/**/test_*.py")]
    names = [file.name for file in files]
    assert len(set(names)) == len(names), sorted(name for name in names if names.count(name) > 1)
