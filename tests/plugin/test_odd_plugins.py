"""What an odd plugin raises, whoever asks it what, is an error that names it and never a raw exception."""

from __future__ import annotations

from pathlib import Path

import pytest
from distributions import gesture, make_distribution

ODD = '''
from gesture_core import hookimpl

class Unreadable(type):
    @property
    def __signature__(cls):
        raise RuntimeError("no signature today")

class Closed(metaclass=Unreadable):
    """Says nothing of its options."""
    def apply(self, signals):
        return signals

def made(**options):
    """A function that makes a filter."""
    return Closed()

class Moody:
    """Its attributes raise."""
    @property
    def apply(self):
        raise RuntimeError("not now")

@hookimpl
def register_filters(register):
    register("closed", "odd_plugin:Closed", summary="no signature")
    register("made", "odd_plugin:made", summary="a function")
    register("moody", "odd_plugin:Moody", summary="raises")
    register("numbers", "builtins:int", summary="another language")
'''


@pytest.fixture
def site(tmp_path: Path) -> Path:
    return make_distribution(tmp_path / "site", "odd-plugin", ODD)


@pytest.mark.parametrize("name", ["closed", "made", "moody", "numbers"])
def test_a_plugin_is_shown_or_named_in_an_error(site: Path, name: str) -> None:
    for command in (["plugins", name], ["plugins", "--check"], ["settings", name]):
        done = gesture(*command, path=site)
        assert "Traceback" not in done.stderr and done.returncode in (0, 1, 3), done.stderr
        if done.returncode == 1:
            assert f"'{name}' of odd-plugin" in done.stderr, done.stderr
