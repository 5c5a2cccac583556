"""``gesture merge``: one run of the runs of several shards."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.cli.flags import UNSAID
from gesture_core.cli.output import counted, named, say, say_event

_SHOWN = 10


def merge(
    *runs: Annotated[Path, Parameter(required=True)],
    out: Path,
    overwrite: Annotated[bool, UNSAID] = False,
    quiet: Annotated[bool, UNSAID] = False,
) -> int:
    """Make one run of the runs of several shards: what one run of all inputs would have written.

    Parameters
    ----------
    runs
        The run folders: run-*.
    out
        The run folder of all of them: it is written as a whole or not at all, and may be written again.
    overwrite
        Also where rows of other inputs are lost by that.
    quiet
        Say nothing of what is missing.
    """
    from gesture_core.run.shards import merge_runs

    merged = merge_runs(runs, out, overwrite=overwrite)
    if quiet:
        return merged.exit_code
    database = str(out / "run.db")
    if not sys.stderr.isatty():
        say_event(
            "done", rows=sum(merged.counts.values()), counts=dict(sorted(merged.counts.items())),
            missing=list(merged.missing), unfinished=merged.unfinished, archives=list(merged.archives),
            database=database, exit_code=merged.exit_code,
        )  # fmt: skip
        return merged.exit_code
    counts = ", ".join(f"{n} {status}" for status, n in sorted(merged.counts.items()))
    say(f"{counted(len(runs), 'run')}, {counted(sum(merged.counts.values()), 'row')}: {counts}; {database}")
    if merged.missing:
        say(f"missing: shard {named(merged.missing, _SHOWN)}")
    for run, (have, planned) in merged.unfinished.items():
        say(f"not finished: {run} has {have} of {counted(planned, 'input')}; its command again goes on")
    if merged.archives:
        said = named(merged.archives, _SHOWN)
        say(f"the runs have not found the same inputs: {said}; their commands again find the new ones")
    return merged.exit_code
