"""The enumeration of codes is the one list of them: every code of the sources is in it, and none is idle."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from conftest import ROOT

from gesture_core import errors
from gesture_core.cli.main import exit_code
from gesture_core.errors import Code, ConfigError, GestureError, PluginError, Status
from gesture_core.settings.schema import SECTIONS

PACKAGES = (ROOT / "gesture_core", *(ROOT / "plugins").glob("*/gesture_*"))
FILES = sorted(path for package in PACKAGES for path in package.rglob("*.py"))
CODE = re.compile(r"\bE_[A-Z]+(?:_[A-Z]+)*\b")


def literals(path: Path) -> Iterator[str]:
    """The codes that a file names as text or as a member, but for those that docstrings speak of."""
    tree = ast.parse(path.read_text("utf-8"))
    spoken = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in spoken:
            yield from CODE.findall(node.value)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "Code":
            yield f"E_{node.attr}" if node.attr.isupper() else ""


def test_every_code_of_the_sources_is_a_member_and_no_member_is_idle() -> None:
    mine = Path(errors.__file__)
    used = {code for path in FILES if path != mine for code in literals(path)} - {""}
    defaults = {
        kind.code
        for kind in vars(errors).values()
        if isinstance(kind, type) and issubclass(kind, GestureError)
    }
    assert sorted(used - set(Code)) == []
    assert sorted(set(Code) - used - defaults) == []


def test_every_code_that_a_docstring_speaks_of_is_a_member() -> None:
    for path in FILES:
        for code in CODE.findall(path.read_text("utf-8")):
            assert Code.of(code) or code in ("E_OF_ANOTHER_PACKAGE",), f"{path.name}: {code}"


def test_no_code_is_taken_apart() -> None:
    for path in FILES:
        for line in path.read_text("utf-8").splitlines():
            assert not re.search(r"code\w*\.startswith|startswith\(.*(E_|CODE)", line), f"{path.name}: {line}"


UNTYPED = re.compile(rf"(?<!--set )(?<!such as )(?<![\w.])({'|'.join(SECTIONS)})\.[a-z_]+=(?! )")


def test_a_setting_that_is_suggested_stands_as_it_is_typed() -> None:
    """After ``--set``, wherever a text of the sources gives one a value; a remedy names none without one."""
    for path in FILES:
        tree = ast.parse(path.read_text("utf-8"))
        spoken = {
            id(node.value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in spoken:
                assert not UNTYPED.search(node.value), f"{path.name}:{node.lineno}: {node.value}"
    for code in Code:
        assert not re.search(rf"(?<!--set )\b({'|'.join(SECTIONS)})\.", code.remedy), code.remedy


@pytest.mark.parametrize("code", Code)
def test_every_code_says_what_it_is(code: Code) -> None:
    assert code.value == f"E_{code.name}" == str(code)
    assert (code.meaning and code.remedy and code.meaning[0].islower()) or code.meaning.startswith("run.db")
    assert code.exit_code in (1, 2, 11)
    assert code.status in get_args(Status)
    assert Code.of(str(code)) is code
    assert len(code.meaning) < 70 and len(code.remedy) < 50


def test_a_command_exits_as_its_code_says() -> None:
    assert exit_code(GestureError("x", code="E_RUN_LOCKED")) == 11
    assert exit_code(ConfigError("x")) == 2
    assert exit_code(PluginError("x")) == 1
    assert exit_code(PluginError("x", code="E_PLUGIN_UNKNOWN")) == 2
    assert exit_code(ConfigError("x", code="E_OF_ANOTHER_PACKAGE")) == 2, "its class still says that much"
    assert exit_code(GestureError("x", code="E_OF_ANOTHER_PACKAGE")) == 1


def test_what_is_rejected_is_not_an_error() -> None:
    rejected = {code for code in Code if code.status == "rejected"}
    assert rejected == {
        "E_NO_PERSON", "E_POSE_SHORT", "E_POSE_SPARSE", "E_POSE_SCALE",
        "E_NO_SALIENT", "E_NO_COMMON", "E_NO_EVENT", "E_REJECTED", "E_UNSURE",
    }  # fmt: skip
    assert {code for code in Code if code.status == "skipped"} == {"E_NOT_AN_INPUT"}
    assert {code for code in Code if code.plugin} == {
        *(code for code in Code if code.split("_")[1] in ("PLUGIN", "WORKER"))
    }
