"""``gesture demo``: the main job on an archive that the package draws itself."""

from __future__ import annotations

import csv
import shlex
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gesture_core.cli.flags import UNSAID, Flags
from gesture_core.cli.output import check_folder, row_table, say
from gesture_core.errors import Code, ModelError

if TYPE_CHECKING:
    from gesture_core.settings import Settings


def demo(
    *, out: Path | None = None, keypoints: Annotated[bool, UNSAID] = False, flags: Flags | None = None
) -> int:
    """Run the main job on an archive that the package draws itself.

    Draws short clips of people who perform six gestures, classifies them by two examples of each,
    and prints the table and the accuracy.

    Parameters
    ----------
    out
        Folder for the archive and the run; a temporary one by default.
    keypoints
        Classify the OpenPose JSON beside the clips instead of the clips.
    """
    from gesture_core.cli.classify import say_summary
    from gesture_core.cli.progress import progress
    from gesture_core.demo.archive import write_archive
    from gesture_core.run.archive import classify_archive

    if out is not None:
        check_folder(out)
    folder = out or Path(tempfile.mkdtemp(prefix="gesture-demo-"))
    settings = (flags or Flags()).settings()
    say(f"drawing 36 clips of 6 gestures into {folder} ...")
    archive = write_archive(folder)
    if not keypoints and not _has_model(settings):
        say("no pose network is installed: classifying the keypoint files")
        keypoints = True
    sources, examples = (
        (archive.video_keypoints, archive.example_keypoints)
        if keypoints
        else (archive.videos, archive.examples)
    )
    run = folder / "run"
    say(f"gesture classify {_quoted(sources)} --examples {_quoted(examples)} --out {_quoted(run)}")
    with progress([str(sources)], [str(examples)]) as listener:
        summary = classify_archive(sources, examples, run, settings, overwrite=True, listener=listener)
    rows = summary.rows()
    row_table(rows)
    say_summary(summary, rows)
    with archive.truth.open(newline="", encoding="utf-8") as file:
        truth = {Path(row["path"]).stem: row["label"] for row in csv.DictReader(file)}
    right = sum(row.label == truth[Path(row.input.partition("::")[0]).stem] for row in rows)
    print(f"{right} of {len(rows)} labels are right")
    say(f"why: gesture explain {_quoted(run)} {_quoted(rows[0].input.rsplit('/', 1)[-1])}")
    if not keypoints:
        say(f"what the network sees: gesture render {_quoted(archive.videos / 'clip_01.mp4')}")
    return summary.exit_code


def _quoted(argument: str | Path) -> str:
    return shlex.quote(str(argument))


def _has_model(settings: Settings) -> bool:
    from gesture_core.pose.models import choose_pose, find_model

    try:
        find_model(choose_pose(settings).pose.model)
    except ModelError as error:
        if error.code == Code.MODEL_MISSING:
            return False
        raise
    return True
