"""``gesture render``: what the network sees, over the video."""

from __future__ import annotations

from pathlib import Path

from gesture_core.cli.flags import Flags
from gesture_core.errors import InputError, MediaError, PoseError


def render(
    video: Path,
    *,
    out: Path | None = None,
    flags: Flags | None = None,
    people: str | None = None,
    overwrite: bool = False,
) -> int:
    """Draw the keypoints that the network sees over a video: right side orange, left side blue.

    Parameters
    ----------
    video
        The video.
    out
        An .mp4 for a video (needs PyAV), a .png for a strip of pictures. By default the video's
        name with -pose.mp4, or -pose.png without PyAV, in this folder.
    people
        single, or multi for everybody that the network tells apart.
    overwrite
        Replace a file that is there.
    """
    from gesture_core.media.limits import Limits
    from gesture_core.media.reader import open_video
    from gesture_core.pose.extract import extract_poses, open_backend
    from gesture_core.report.overlay import can_write_video, overlay, write_strip, write_video

    settings = (flags or Flags()).settings()
    target = out or Path(f"{video.stem}-pose{'.mp4' if can_write_video() else '.png'}")
    _check(video, target, overwrite=overwrite, can_write_video=can_write_video())
    pose = settings.pose
    limits = Limits(max_pixels=settings.limits.pixels, max_frames=settings.limits.frames)
    with open_video(video, pose.reader, limits) as frames:
        found = extract_poses(
            frames, open_backend(settings), people or pose.people, follow=pose.follow, source=str(video)
        )
    if not any(sequence.frames_with_pose for sequence in found):
        raise PoseError("nobody was found", subject=str(video), code="E_POSE_NONE")
    # The video is decoded twice, so that it never has to be held in memory.
    with open_video(video, pose.reader, limits) as frames:
        write = write_video if target.suffix.lower() == ".mp4" else write_strip
        count = write(overlay(frames, found), target)
    seen = max(sequence.frames_with_pose for sequence in found)
    print(f"{target}: {count} frames, {len(found)} person(s), at most {seen} frames with a pose")
    return 0


def _check(video: Path, target: Path, *, overwrite: bool, can_write_video: bool) -> None:
    suffix = target.suffix.lower()
    if suffix not in (".mp4", ".png"):
        raise InputError(f"--out {target}", remedy="a name that ends in .mp4 or .png", code="E_OPTION")
    if suffix == ".mp4" and not can_write_video:
        raise MediaError(
            "writing H.264 needs PyAV: pip install 'gesture-core[video]'",
            remedy="--out with a name that ends in .png",
            code="E_MISSING_DEPENDENCY",
        )
    if target.exists() and (not overwrite or target.samefile(video)):
        raise InputError(
            "there is a file of this name",
            subject=str(target),
            kept="that one",
            remedy="--overwrite, or another --out",
            code="E_EXISTS",
        )
