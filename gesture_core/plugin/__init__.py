"""Plugins: what can be replaced (interfaces), how it is announced (hooks), how it is found (registry)."""

from gesture_core.plugin.hooks import hookimpl
from gesture_core.plugin.registry import registry

__all__ = ["hookimpl", "registry"]
