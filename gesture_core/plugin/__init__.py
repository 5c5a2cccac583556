"""Plugins: what can be replaced (kinds), how it is registered (hooks), and how it is found (loader)."""

from gesture_core.plugin.loader import registry
from gesture_core.plugin.specs import hookimpl

__all__ = ["hookimpl", "registry"]
