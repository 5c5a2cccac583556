"""Where the package keeps what it may delete (cache) and what the user gave it (models)."""

from __future__ import annotations

import os
from pathlib import Path


def cache_dir() -> Path:
    """Folder of cached keypoints: ``$GESTURE_CACHE``, or the platform's user cache folder."""
    override = os.environ.get("GESTURE_CACHE")
    if override:
        return Path(override).expanduser()
    import platformdirs

    return Path(platformdirs.user_cache_dir("gesture-core", appauthor=False))


def models_dir() -> Path:
    """Folder of added model files: ``$GESTURE_MODELS``, or ``models`` in the user's data folder."""
    override = os.environ.get("GESTURE_MODELS")
    if override:
        return Path(override).expanduser()
    import platformdirs

    return Path(platformdirs.user_data_dir("gesture-core", appauthor=False)) / "models"


def offline() -> bool:
    """Whether ``$GESTURE_OFFLINE`` forbids downloads."""
    return os.environ.get("GESTURE_OFFLINE", "").lower() not in ("", "0", "false", "no")
