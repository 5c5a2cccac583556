"""``gesture report``: a run as a page to look at."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from gesture_core.cli.flags import UNSAID, Workers
from gesture_core.cli.output import check_folder, counted, say
from gesture_core.files import printable


def report(
    run: Path,
    /,
    *,
    out: Path | None = None,
    labels: Annotated[str, UNSAID] = "",
    label_columns: Annotated[str, UNSAID] = "",
    no_previews: Annotated[bool, UNSAID] = False,
    workers: Workers = 0,
) -> None:
    """Write a page about a run that opens from disk in any browser, without a network.

    Every row has a small looping video with the skeleton, beside the nearest example and the runner-up,
    which move with it. Filters, certainty, what a threshold would cost, and how each row was aligned.

    Parameters
    ----------
    run
        The run folder.
    out
        The folder of the page; report in the run folder by default. An earlier page there is replaced.
    labels
        What the inputs really are, where that is known, as for gesture evaluate: folder:-1, a table or a
        regular expression. The page then says what is right, and what a threshold would do for it.
    label_columns
        With a table: the headings of path and label.
    no_previews
        No videos: done at once.
    """
    from gesture_core.cli.progress import progress
    from gesture_core.report.run_page import NO_ROWS, write_report

    if out is not None:
        check_folder(out)
    with progress([str(run)]) as listener:
        done = write_report(
            run, out, labels=labels, label_columns=label_columns, previews=not no_previews, workers=workers,
            listener=listener,
        )  # fmt: skip
    if not done.rows:
        say(NO_ROWS)
    for note in done.notes:
        say(note)
    for reason, rows in sorted(done.missing.items(), key=lambda pair: -pair[1]):
        say(f"no preview of {counted(rows, 'row')}: {reason}")
    print(printable(done.page))
    if sys.stdout.isatty():
        say(f"{counted(done.rows, 'row')}, {counted(done.previews, 'preview')}; open it in a browser")
