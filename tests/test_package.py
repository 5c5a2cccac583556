"""What would be published: one version, a wheel and an sdist that hold what they must."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from importlib.util import find_spec
from pathlib import Path

import pytest
from conftest import ROOT

import gesture_core

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def test_the_version_stands_in_one_place() -> None:
    assert "version" not in PROJECT["project"]
    assert PROJECT["project"]["dynamic"] == ["version"]
    assert PROJECT["tool"]["hatch"]["version"]["path"] == "gesture_core/__init__.py"


def test_every_package_says_that_it_is_typed() -> None:
    packages = [ROOT / name for name in PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]]
    assert len(packages) > 5
    for package in packages:
        assert (package / "py.typed").is_file(), package


@pytest.mark.slow
def test_wheel_and_sdist_hold_what_they_must(tmp_path: Path) -> None:
    for module in ("hatchling", "twine"):
        if find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install 'gesture-core[test]'")
    for command in (["hatchling", "build", "-d", str(tmp_path)], ["twine", "check", "--strict"]):
        built = [str(path) for path in sorted(tmp_path.iterdir())]
        more = built if command[0] == "twine" else []
        done = subprocess.run(
            [sys.executable, "-m", *command, *more], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
    (wheel,), (sdist,) = tmp_path.glob("*.whl"), tmp_path.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (described,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = message_from_bytes(archive.read(described))
    assert metadata["Version"] == gesture_core.__version__
    urls = dict(entry.split(", ") for entry in metadata.get_all("Project-URL", []))
    assert {"Home", "Documentation", "Issues", "Changelog"} <= set(urls)
    tops = {name.split("/")[0] for name in names if name.endswith(".py")}
    assert tops >= {"gesture_core", "gesture_signals", "gesture_pose_onnx"}
    assert {f"{top}/py.typed" for top in tops} <= names
    assert not tops & {"tests", "training", "benchmarks", "docs"}
    with tarfile.open(sdist) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    for name in (
        "README.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "LICENSE",
        "mkdocs.yml",
        "docs/index.md",
        "run",
    ):
        assert name in inside, name
    for name in ("tests/conftest.py", "training/__main__.py", "constraints.txt", "gesture_core/py.typed"):
        assert name in inside, name
