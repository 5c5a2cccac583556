"""What the tests of networks share: BlazePose, fetched as a user would."""

from __future__ import annotations

from pathlib import Path

import pytest

from gesture_core.errors import ModelError
from gesture_core.pose.downloads import get_model
from gesture_core.pose.models import ModelFile


@pytest.fixture(scope="session")
def blazepose(tmp_path_factory: pytest.TempPathFactory) -> ModelFile:
    """BlazePose from the package index that pip asks here; skips with a reason where that has none."""
    folder: Path = tmp_path_factory.mktemp("fetched")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GESTURE_MODELS", str(folder))
        patch.delenv("GESTURE_OFFLINE", raising=False)
        try:
            return get_model("blazepose")[0]
        except ModelError as error:
            pytest.skip(f"the wheel of BlazePose cannot be fetched here: {error.cause}")
