"""What all tests share: where the real data and models are, where this checkout has them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def _shared_folder(name: str) -> Path:
    """``<shared>/<name>``, or skip: the data may not travel with the project."""
    override = os.environ.get("GESTURE_SHARED")
    base = Path(override) if override else ROOT.parent / "shared"
    folder = base / name
    if not folder.is_dir():
        pytest.skip(f"the shared files are absent here ({folder}); GESTURE_SHARED names another place")
    return folder.resolve()


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real data beside the repository; skips with a reason where it is absent."""
    return _shared_folder("data")


@pytest.fixture(scope="session")
def shared_models() -> Path:
    """The folder of pose networks beside the repository; skips with a reason where it is absent."""
    return _shared_folder("models")
