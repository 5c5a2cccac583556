"""An example plugin for gesture-core."""
