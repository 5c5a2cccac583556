"""The command line, one file for each command. Commands are imported when they are used.

`main` finds the command and turns errors and signals into exit codes; `flags` become settings;
`progress` shows a run while it goes on, `screen` what came of it. Commands that look at people, not at
rows, take them from `keypoints`; `scores` is what `evaluate` prints.
"""

from gesture_core.cli.main import main

__all__ = ["main"]
