"""Every setting of a run: what each means (`schema`), and where its value comes from (`load`)."""

from gesture_core.settings.load import load_settings, presets, settings_from_dict
from gesture_core.settings.schema import (
    DEFAULT_PRESET,
    ClassifySettings,
    LimitSettings,
    PoseSettings,
    Settings,
    SignalSettings,
)

__all__ = [
    "DEFAULT_PRESET",
    "ClassifySettings",
    "LimitSettings",
    "PoseSettings",
    "Settings",
    "SignalSettings",
    "load_settings",
    "presets",
    "settings_from_dict",
]
