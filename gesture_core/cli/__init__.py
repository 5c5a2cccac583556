"""The command line, one file for each command. Commands are imported when they are used."""

from gesture_core.cli.main import main

__all__ = ["main"]
