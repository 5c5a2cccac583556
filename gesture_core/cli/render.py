"""``gesture render``: what the network sees, over the video."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gesture_core.cli.flags import UNSAID, PoseFlags
from gesture_core.cli.output import check_file, counted
from gesture_core.errors import ConfigError, GestureError, InputError, MediaError, PoseError
from gesture_core.files import printable

if TYPE_CHECKING:
    from gesture_core.pose.overlay import Tag
    from gesture_core.records import Row
    from gesture_core.settings import Settings
    from gesture_core.types import PoseSequence


def render(
    video: Path,
    input: str | None = None,
    /,
    *,
    out: Path | None = None,
    flags: PoseFlags | None = None,
    people: str | None = None,
    overwrite: Annotated[bool, UNSAID] = False,
) -> int:
    """Draw the keypoints that the network sees over a video: right side orange, left side blue.

    gesture render RUN INPUT writes above each person what the run says of it: number, label, score or margin,
    and the time.

    Parameters
    ----------
    video
        The video, or a run folder.
    input
        The input of the run as its result names it, or a part of its name that no other one has. The run's
        settings count unless there are flags.
    out
        A name.mp4 for a video (needs PyAV), a name.png for a strip of pictures, cropped to the people: of the
        events of gesture spot, where there are some;
        <video>-pose.mp4 by default.
    people
        single, or multi: who is lost for a while comes back as another person. As pose.people by default.
    overwrite
        Replace a file that is there.
    """
    from gesture_core.pose.overlay import STRIP, cropped, overlay, write_strip
    from gesture_core.video import at_rate, open_configured, pictures
    from gesture_core.video.writer import can_write_video, write_video

    rows: list[Row] = []
    settings = None
    if input is not None and "=" in input and not video.is_dir():
        raise ConfigError(
            f"{input!r} is not understood here", remedy=f"--set KEY=VALUE --set {input}", code="E_USAGE"
        )
    if input is not None:
        video, rows, settings = _found_again(video, input)
    elif video.is_dir():
        raise InputError(
            "is a folder", subject=str(video), remedy="gesture render RUN INPUT, or a video", code="E_OPTION"
        )
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
    found = _people(video, settings)
    # The video is decoded twice, so that it never has to be held in memory; only frames that were looked at
    # are shown, as the others have no keypoints.
    with open_configured(video, settings) as opened:
        frames = at_rate(pictures(opened), settings.pose.rate)
        tags = [_tag(one.person, rows) for one in found] if rows or len(found) > 1 else ()
        if target.suffix.lower() == ".mp4":
            count = write_video(overlay(frames, found, tags), target)
        else:  # cropped first, so that what is written above a person is inside
            middles = [((row.start or 0) + (row.end or 0)) / 2 for row in rows if row.event]
            strip = overlay(*cropped(frames, found, height=STRIP), tags)
            count = write_strip(strip, target, moments=middles)
    longest = max(sequence.frames_with_pose for sequence in found)
    who = "1 person" if len(found) == 1 else f"{len(found)} tracks of people, the longest"
    rate = settings.pose.rate
    at = f", looked at {rate:g} times a second (pose.rate)" if rate else ""
    print(f"{printable(target)}: {counted(count, 'frame')}, {who} in {longest} of them{at}")
    return 0


def _found_again(run: Path, name: str) -> tuple[Path, list[Row], Settings]:
    """Where an input of a run is, its rows, and the settings of the run."""
    from gesture_core.files import content_sha256
    from gesture_core.run.found_again import find_inputs
    from gesture_core.run.results import open_results
    from gesture_core.run.rows import input_called
    from gesture_core.settings import settings_from_dict

    with open_results(run) as results, results.failures():
        keyed = list(results.keyed_rows())
        configuration = results.configuration
    name = input_called((row.input for _, row in keyed), name)
    rows = [row for _, row in keyed if row.input == name]
    place = next(os.fsdecode(key.partition(b"\0")[0]) for key, row in keyed if row.input == name)
    settings = settings_from_dict(configuration["settings"])
    item = find_inputs({name: place}, settings)[name]
    if isinstance(item, GestureError):
        raise item
    if item.kind != "video":
        raise InputError("is no video, which alone is drawn over", subject=name, code="E_OPTION")
    if content_sha256(item.path) != rows[0].sha256:
        raise InputError("has changed since the run", subject=name, remedy="run it again", code="E_CHANGED")
    return item.path, rows, settings


def _tag(person: int, rows: Sequence[Row]) -> Tag:
    """What is written above a person at a time: the label of all of the input, or of the event then."""
    own = [row for row in rows if row.person == person]

    def text(time: float) -> str:
        for row in own:
            if not row.event or (row.start or 0) <= time <= (row.end or 0):
                sure = [("confidence", row.confidence), ("score", row.score), ("margin", row.margin)]
                said = next((f"{name} {value:.2f}" for name, value in sure if value is not None), "")
                return "  ".join(filter(None, (f"{person}", row.label or row.code, said)))
        return f"{person}"

    return text


def _people(video: Path, settings: Settings) -> list[PoseSequence]:
    """Everybody in a video, from the store or extracted in a worker process."""
    from gesture_core.cli.progress import progress
    from gesture_core.run.extract import people_of
    from gesture_core.run.inputs import discover

    items = discover([video], settings=settings)
    if len(items) != 1 or items[0].kind != "video":
        remedy = "a video file, or --preset pose with a picture"
        raise InputError("is not one video", subject=str(video), remedy=remedy, code="E_OPTION")
    with progress([str(video)]) as listener:
        for _, found, people in people_of(items, settings, listener=listener):
            if found.code:
                raise MediaError(found.message, subject=str(video), code=found.code)
            if people:
                return people
    raise PoseError(
        "nobody was found",
        subject=str(video),
        remedy="another --model, see gesture models",
        code="E_NO_PERSON",
    )
