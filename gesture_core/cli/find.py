"""``gesture find``: query by example."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from gesture_core.cli.flags import UNSAID, KernelFlags, Sources, Whole, Workers
from gesture_core.cli.output import counted, print_table, say, say_event, say_notes, warnings_as_lines


def find(
    clip: Path,
    /,
    *sources: Sources,
    top: Annotated[Whole, Parameter(validator=validators.Number(gte=1, lte=10_000))] = 50,
    flags: KernelFlags | None = None,
    workers: Workers = 0,
    quiet: Annotated[bool, UNSAID] = False,
) -> int:
    """Find where in recordings somebody does what a clip shows, the nearest first.

    Parameters
    ----------
    clip
        A clip of one movement: its first person is looked for, at several tempos (spot.tempos).
    sources
        Recordings as in gesture classify, or the folder of a run: then its inputs, by its settings unless
        there are flags. Keypoints are taken from the keypoint store, or extracted.
    top
        How many places.
    quiet
        No progress.
    """
    from gesture_core.cli.progress import progress
    from gesture_core.run.find import find as search

    settings = None if flags in (None, KernelFlags()) else flags.settings()
    with progress(sources, quiet=quiet) as listener, warnings_as_lines(events=True):
        found = search(clip, sources, settings, top=top, workers=workers, listener=listener)
    if sys.stdout.isatty():
        print_table(
            ["input", "start", "end", "distance"],
            [
                [
                    hit.input + (f" #{hit.person}" if hit.person else ""),
                    *(f"{value:.2f}" for value in (hit.start, hit.end)), f"{hit.distance:.3f}",
                ]
                for hit in found.hits
            ],
            right=["start", "end", "distance"],
        )  # fmt: skip
    else:
        for hit in found.hits:
            print(json.dumps(asdict(hit), ensure_ascii=False))
    if not quiet:
        notes = {text: list(found.notes.values()).count(text) for text in found.notes.values()}
        if sys.stderr.isatty():
            what = "sample" if found.of_channels else "frame"
            searched = f"{counted(found.inputs, 'recording')} of {counted(found.frames, what)}"
            say(f"{counted(len(found.hits), 'place')} in {searched}")
            say_notes(notes)
            for name, (code, message) in found.failed.items():
                say(f"not searched: {name}: {code} {message.removeprefix(f'{name}: ')}")
        else:
            say_event(
                "done", places=len(found.hits), recordings=found.inputs, frames=found.frames,
                warped=found.warped, failed=found.failed, notes=notes,
            )  # fmt: skip
    return 3 if found.failed else 0
