"""``gesture demo``: the main job on an archive that the package draws itself."""

from __future__ import annotations

import csv
import shlex
import sys
import tempfile
from pathlib import Path
from typing import Annotated

from gesture_core.cli.classify import say_summary
from gesture_core.cli.flags import UNSAID, Flags
from gesture_core.cli.progress import progress
from gesture_core.cli.screen import result_table
from gesture_core.cli.targets import check_folder
from gesture_core.errors import ModelError
from gesture_core.run.plan import RunRequest


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
    from gesture_core.demo.archive import write_archive
    from gesture_core.run.pipeline import run_archive

    if out is not None:
        check_folder(out)
    folder = out or Path(tempfile.mkdtemp(prefix="gesture-demo-"))
    settings = (flags or Flags()).settings()
    print(f"drawing 36 clips of 6 gestures into {folder} ...", file=sys.stderr)
    archive = write_archive(folder)
    if not keypoints and not _has_model(settings.pose.model):
        print("no pose network is installed: classifying the keypoint files", file=sys.stderr)
        keypoints = True
    sources, examples = (
        (archive.video_keypoints, archive.example_keypoints)
        if keypoints
        else (archive.videos, archive.examples)
    )
    run = folder / "run"
    _say("", "classify", sources, "--examples", examples, "--out", run)
    request = RunRequest((str(sources),), run, settings, (str(examples),), overwrite=True)
    with progress() as listener:
        summary = run_archive(request, listener)
    rows = summary.rows()
    result_table(rows)
    say_summary(summary)
    with archive.truth.open(newline="", encoding="utf-8") as file:
        truth = {Path(row["path"]).stem: row["label"] for row in csv.DictReader(file)}
    right = sum(row.label == truth[_stem(row.input)] for row in rows)
    print(f"{right} of {len(rows)} labels are right")
    _say("why: ", "explain", run, rows[0].input.rsplit("/", 1)[-1])
    if not keypoints:
        _say("what the network sees: ", "render", archive.videos / "clip_01.mp4")
    return summary.exit_code


def _say(what: str, *arguments: str | Path) -> None:
    print(f"{what}gesture {shlex.join(map(str, arguments))}", file=sys.stderr)


def _stem(name: str) -> str:
    return Path(name.partition("::")[0]).stem


def _has_model(name: str) -> bool:
    from gesture_core.pose.models import find_model

    try:
        find_model(name)
    except ModelError as error:
        if error.code == "E_MODEL_MISSING":
            return False
        raise
    return True
