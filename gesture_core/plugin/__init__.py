"""Plugins: what can be replaced (kinds), how it is registered (hooks), and how it is found (loader)."""

from gesture_core.plugin.hooks import hookimpl
from gesture_core.plugin.loader import registry

__all__ = ["hookimpl", "registry"]
