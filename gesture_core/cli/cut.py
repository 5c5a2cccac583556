"""``gesture cut``: the events of a run as clips."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from gesture_core.cli.flags import UNSAID, Workers
from gesture_core.cli.output import check_folder, counted, print_list, say
from gesture_core.errors import ConfigError


def cut(
    run: Path,
    /,
    *,
    out: Path,
    label: str | None = None,
    margin: Annotated[float, Parameter(validator=validators.Number(gte=0, lte=3600))] = 0.0,
    sound: Annotated[bool, UNSAID] = False,
    workers: Workers = 0,
    quiet: Annotated[bool, UNSAID] = False,
) -> int:
    """Write the events of a run as clips, in a folder for each label.

    Videos become H.264 (needs PyAV), keypoints and channels Parquet files. All can be examples. A clip that
    is there is left as it is.

    Parameters
    ----------
    run
        A run of gesture spot, or of gesture classify: then a clip is the time in which the person was seen.
    out
        The folder: <out>/<label>/<input>_<start>-<end>.mp4.
    label
        Only what has this label.
    margin
        Seconds more before and after each event; with 0, clips are cut as examples should be.
    sound
        With the sound of the recording.
    quiet
        No progress and no table.
    """
    from gesture_core.cli.progress import progress
    from gesture_core.files import usable_cores
    from gesture_core.run.cut import cut_events

    check_folder(out)
    if out.resolve() == run.resolve():
        raise ConfigError(f"--out {out} is the run folder", remedy="a folder of its own", code="E_OUT")
    with progress([str(run)], quiet=quiet) as listener:
        clips = cut_events(
            run,
            out,
            label=label,
            margin=margin,
            sound=sound,
            workers=workers or usable_cores(),
            listener=listener,
        )
    counts = Counter(clip.status for clip in clips)
    if not quiet:
        print_list(
            ["clip", "label", "input", "person", "start", "end", "status", "note"],
            [
                [
                    str(clip.file), clip.label, clip.input, str(clip.person), f"{clip.start:.3f}",
                    f"{clip.end:.3f}", f"{clip.status} {clip.code}".strip(), clip.message or clip.note,
                ]
                for clip in clips
            ],
        )  # fmt: skip
        parts = ", ".join(f"{number} {status}" for status, number in sorted(counts.items()))
        labels = counted(len({clip.label for clip in clips}), "label")
        say(f"{counted(len(clips), 'clip')} of {labels}: {parts}; {out}")
    return 3 if counts["error"] else 0
