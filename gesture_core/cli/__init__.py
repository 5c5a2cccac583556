"""The command line, one file for each command, which parses and prints. Commands are imported when used.

`main` finds the command and turns errors and signals into exit codes; `flags` become settings;
`progress` shows a run while it goes on, `output` what came of it.
"""

from gesture_core.cli.main import main

__all__ = ["main"]
