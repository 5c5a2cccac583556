"""Every setting of a run: sections with their defaults, the frozen tree, presets and how values are read.

`sections` says what each setting means; `load` reads presets (`shipped` has the package's own), the
environment and flags into a `tree`, and `values` reads text by the type of a setting.
"""

from gesture_core.settings.load import load_settings
from gesture_core.settings.sections import ClassifySettings, LimitSettings, PoseSettings, SignalSettings
from gesture_core.settings.shipped import presets
from gesture_core.settings.tree import DEFAULT_PRESET, Settings, settings_from_dict

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
