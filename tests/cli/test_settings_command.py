"""`gesture settings`: everything that can be set, with its meaning, from the code itself."""

from __future__ import annotations

import json
import sys
from dataclasses import fields

import pytest

from gesture_core.cli.main import run
from gesture_core.cli.settings import every_setting
from gesture_core.settings import Settings, load_settings, presets
from gesture_core.settings.schema import SECTIONS


def asked(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, dict[str, str]]:
    """What the command says through a pipe, by key."""
    assert run(["settings", *words]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    return {line["key"]: line for line in lines}


@pytest.mark.parametrize("preset", presets())
def test_every_setting_is_explained(preset: str) -> None:
    found = {setting.key: setting for setting in every_setting(load_settings(preset, environment={}))}
    for section, kind in SECTIONS.items():
        for known in fields(kind):
            assert f"{section}.{known.name}" in found
    for setting in found.values():
        assert setting.type and setting.meaning.endswith(".") and setting.default and setting.value, setting


def test_a_pipe_gets_json(capsys: pytest.CaptureFixture[str]) -> None:
    every = asked(capsys)
    assert every["classify.neighbors"]["default"] == "1" and every["classify.neighbors"]["value"] == "0"
    assert every["dtw.window"]["preset"] == "modern" and "variance.t_var" not in every
    paper = asked(capsys, "--preset", "paper")
    assert paper["classify.neighbors"]["value"] == "1" and paper["variance.t_var"]["value"] == "0.1"


def test_a_key_is_shown_in_full(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(asked(capsys, "gaussian.sigma")) == ["gaussian.sigma"]
    assert list(asked(capsys, "variance.t_var")) == ["variance.t_var"], "though it takes no part in modern"
    assert list(asked(capsys, "neighbors")) == ["classify.neighbors"]
    assert list(asked(capsys, "limits")) == [f"limits.{known.name}" for known in fields(Settings().limits)]
    assert list(asked(capsys, "gaussian")) == ["gaussian.sigma", "gaussian.seconds"]
    assert asked(capsys, "gaussian:wide.sigma")["gaussian:wide.sigma"]["value"] == "1.0"


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("dtw.windw", "did you mean dtw.window"),
        ("windw", "did you mean dtw.window"),
        ("gaussian.sgima", "did you mean gaussian.sigma"),
        ("gausian.sigma", "did you mean gaussian.sigma?"),
        ("clasify.margn", "did you mean classify.margin?"),
        ("t_var", "--preset paper"),
        ("center.nothing", "center.share"),
    ],
)
def test_unknown_keys_name_the_nearest(key: str, hint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["settings", key]) == 2
    assert hint in capsys.readouterr().err


def test_a_terminal_gets_text(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sys.stdout, "isatty", lambda: True)
        assert run(["settings"]) == 0
        assert run(["settings", "reject_sd"]) == 0
    shown = capsys.readouterr().out
    assert "classify.neighbors = 0  (int; default 1)" in shown and "{" not in shown.split("parts.weights")[0]
    assert shown.endswith("where reject is set too, the lower of the two counts.\n")


def test_the_environment_counts(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("GESTURE_SET_DTW__WINDOW", "0.1")
    assert asked(capsys, "dtw.window")["dtw.window"]["value"] == "0.1"
