"""``gesture render``: what the network sees, over the video."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gesture_core.cli.flags import UNSAID, PoseFlags
from gesture_core.cli.output import check_file, counted
from gesture_core.errors import InputError, MediaError, PoseError
from gesture_core.files import printable

if TYPE_CHECKING:
    from gesture_core.settings import Settings
    from gesture_core.types import PoseSequence


def render(
    video: Path,
    /,
    *,
    out: Path | None = None,
    flags: PoseFlags | None = None,
    people: str | None = None,
    run: Annotated[Path | None, UNSAID] = None,
    overwrite: Annotated[bool, UNSAID] = False,
) -> int:
    """Draw the keypoints that the network sees over a video: right side orange, left side blue.

    Above each person stand their number, with --run label and distance, and the time.

    Parameters
    ----------
    video
        The video.
    out
        A name.mp4 for a video (needs PyAV), a name.png for a strip of pictures, cropped to the people;
        <video>-pose.mp4 by default.
    people
        single, or multi: who is lost for a while comes back as another person. As pose.people by default.
    run
        A run folder in which the video was classified: its labels, and its settings unless there are flags.
    overwrite
        Replace a file that is there.
    """
    from gesture_core.pose.overlay import cropped, overlay, write_strip
    from gesture_core.video import open_configured
    from gesture_core.video.writer import can_write_video, write_video

    labels, settings = _labels(video, run) if run else ({}, None)
    if settings is None or flags not in (None, PoseFlags()):
        settings = (flags or PoseFlags()).settings()
    if people is not None:
        settings = settings.with_values([("pose.people", people)], "--people")
    target = out or Path(f"{video.stem}-pose{'.mp4' if can_write_video() else '.png'}")
    same = video.exists() and target.exists() and target.samefile(video)
    check_file(target, (".mp4", ".png"), replace=overwrite and not same)
    if target.suffix.lower() == ".mp4" and not can_write_video():
        raise MediaError(
            "writing H.264 needs PyAV: pip install 'gesture-core[video]'",
            remedy="--out with a name that ends in .png",
            code="E_MISSING_DEPENDENCY",
        )
    looked_at, found = _people(video, settings)
    # The video is decoded twice, so that it never has to be held in memory.
    with open_configured(video, settings) as frames:
        tags = [f"{person.person} {labels.get(person.person, '')}".strip() for person in found]
        shown = tags if labels or len(found) > 1 else ()
        if target.suffix.lower() == ".mp4":
            count = write_video(overlay(frames, found, shown), target)
        else:  # cropped first, so that what is written above a person is inside
            count = write_strip(overlay(*cropped(frames, found), shown), target)
    longest = max(sequence.frames_with_pose for sequence in found)
    who = "1 person" if len(found) == 1 else f"{len(found)} tracks of people, the longest"
    of = "them" if looked_at == count else f"the {looked_at} that are looked at (pose.rate)"
    print(f"{printable(target)}: {counted(count, 'frame')}, {who} in {longest} of {of}")
    return 0


def _labels(video: Path, run: Path) -> tuple[dict[int, str], Settings]:
    """Label and distance of each person of a video in a run, or the code, and the settings of the run."""
    from gesture_core.files import content_sha256
    from gesture_core.run.results import open_results
    from gesture_core.settings import settings_from_dict

    with open_results(run) as results:
        rows, configuration = list(results.rows()), results.configuration
    sha256 = content_sha256(video)
    labels = {
        row.person: f"{row.label or row.code} {'' if row.distance is None else format(row.distance, '.2f')}"
        for row in rows
        if row.sha256 == sha256
    }
    if not labels:
        raise InputError(
            f"is not in the run {run}", subject=str(video), remedy="a video of that run", code="E_NOT_FOUND"
        )
    return {person: text.strip() for person, text in labels.items()}, settings_from_dict(
        configuration["settings"]
    )


def _people(video: Path, settings: Settings) -> tuple[int, list[PoseSequence]]:
    """Frames that are looked at, and everybody in them, from the store or extracted in a worker process."""
    from gesture_core.cli.progress import progress
    from gesture_core.run.extract import people_of
    from gesture_core.run.inputs import discover

    items = discover([video])
    if len(items) != 1 or items[0].kind != "video":
        raise InputError("is not one video", subject=str(video), remedy="a video file", code="E_OPTION")
    with progress([str(video)]) as listener:
        for _, found, people in people_of(items, settings, listener=listener):
            if found.code:
                raise MediaError(found.message, subject=str(video), code=found.code)
            if people:
                return found.frames_looked_at, people
    raise PoseError(
        "nobody was found",
        subject=str(video),
        remedy="another --model, see gesture models",
        code="E_NO_PERSON",
    )
