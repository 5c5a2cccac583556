"""Every setting of a run: what each means (`schema`), and where its value comes from (`load`)."""

from gesture_core.settings.load import load_settings, presets, settings_from_dict
from gesture_core.settings.schema import DEFAULT_PRESET, ClassifySettings, LimitSettings, Settings

__all__ = [
    "DEFAULT_PRESET",
    "ClassifySettings",
    "LimitSettings",
    "Settings",
    "load_settings",
    "presets",
    "settings_from_dict",
]
