"""What an odd plugin raises, whoever asks it what, is an error that names it and never a raw exception."""

from __future__ import annotations

import json
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

class Following:
    """Follows, and does not say whether limbs are chosen for all frames."""
    skeleton, batch_size, follow, crop = "coco18", 1, True, 1.2
    def __init__(self, model):
        pass
    def estimate(self, frames, people="single"):
        return [[] for _ in frames]

@hookimpl
def register_pose_backends(register):
    register("following", "odd_plugin:Following", summary="a part of an ability")

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


def test_a_part_of_an_ability_is_found_by_the_check(site: Path) -> None:
    done = gesture("plugins", "--check", path=site)
    (line,) = (json.loads(line) for line in done.stdout.splitlines() if '"following"' in line)
    assert line["status"] == "broken: it has follow and crop but no steady: CropFollowing takes them all"
