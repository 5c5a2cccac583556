"""Draws keypoints over pictures, and writes a strip of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gesture_core import colours
from gesture_core.errors import MediaError
from gesture_core.files import replacing
from gesture_core.skeletons import Skeleton, is_fine, skeleton
from gesture_core.types import PoseSequence
from gesture_core.video.writer import room_around

Colour = tuple[int, int, int]
"""Blue, green and red."""
Tag = Callable[[float], str]
"""What to write above a person at a time in seconds."""


def _colour(text: str) -> Colour:
    return int(text[5:7], 16), int(text[3:5], 16), int(text[1:3], 16)


_SIDES = {"right": _colour(colours.RIGHT), "left": _colour(colours.LEFT), "middle": _colour(colours.MIDDLE)}
_PEOPLE = tuple(map(_colour, (colours.GREEN, colours.VERMILLION, colours.PURPLE, colours.BLUE, colours.GREY)))
"""One colour for each person, in turn."""
STRIP = 320
"""Pixels that a strip is high."""
_SAME = 0.0005
"""Seconds below which two times are one: less than half a frame at the fastest rate that is read."""


def draw_pose(frame: np.ndarray, keypoints: np.ndarray, bones: Skeleton) -> None:
    """Draw one person into ``frame``, (H, W, 3) uint8 in BGR: their right orange, their left blue.

    Parameters
    ----------
    frame : (H, W, 3) uint8 array
        Is drawn into.
    keypoints : (J, 2) array
        Pixels; NaN where missing.
    bones : Skeleton
        The layout of ``keypoints``.
    """
    import cv2

    seen = ~np.isnan(keypoints[:, 0])
    if not seen.any():
        return
    extent = float(np.ptp(keypoints[seen], axis=0).max())
    thick = int(np.clip(round(extent / 60), 1, 8))
    spots = np.rint(np.nan_to_num(keypoints)).astype(int)
    thin = max(1, thick // 2)
    for first, second in bones.limbs:
        a, b = bones.index(first), bones.index(second)
        if seen[a] and seen[b]:
            start, end = tuple(spots[a].tolist()), tuple(spots[b].tolist())
            if is_fine(second):  # as close together as the lines of a body are wide
                cv2.line(frame, start, end, side_colour(second), thin, cv2.LINE_AA)
                continue
            cv2.line(frame, start, end, (0, 0, 0), thick + 2, cv2.LINE_AA)
            cv2.line(frame, start, end, side_colour(second), thick, cv2.LINE_AA)
    for joint, spot, there in zip(bones.joints, spots.tolist(), seen, strict=True):
        if there and is_fine(joint):
            cv2.circle(frame, tuple(spot), thin, side_colour(joint), -1, cv2.LINE_AA)
        elif there:
            cv2.circle(frame, tuple(spot), thick + 1, (0, 0, 0), -1, cv2.LINE_AA)
            cv2.circle(frame, tuple(spot), thick, side_colour(joint), -1, cv2.LINE_AA)


def draw_tag(frame: np.ndarray, keypoints: np.ndarray, text: str, colour: Colour) -> None:
    """Draw a box around one person into ``frame``, and ``text`` above it; letters beyond ASCII become "?"."""
    import cv2

    high, wide = frame.shape[:2]
    seen = keypoints[~np.isnan(keypoints[:, 0])]
    if not len(seen):
        return
    size = max(high, wide) / 1000 + 0.15
    thick = 1 + round(size)
    edge = np.array((wide - 1, high - 1))
    left, top = np.clip(seen.min(axis=0) - 8 * thick, 0, edge).astype(int).tolist()
    right, bottom = np.clip(seen.max(axis=0) + 8 * thick, 0, edge).astype(int).tolist()
    cv2.rectangle(frame, (left, top), (right, bottom), colour, thick, cv2.LINE_AA)
    shown = text.encode("ascii", "replace").decode()
    (width, height), below = cv2.getTextSize(shown, cv2.FONT_HERSHEY_SIMPLEX, size, thick)
    if width > wide - 4:  # smaller, rather than cut off
        size *= (wide - 4) / width
        (width, height), below = cv2.getTextSize(shown, cv2.FONT_HERSHEY_SIMPLEX, size, thick)
    left = max(0, min(left, wide - width - 4))
    base = max(top - below, height + 2)
    cv2.rectangle(frame, (left, base - height - 2), (left + width + 4, base + below), colour, -1)
    place = (left + 2, base)
    cv2.putText(frame, shown, place, cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), thick, cv2.LINE_AA)


def side_colour(joint: str) -> Colour:
    """Blue, green and red of a joint, by the side of the body."""
    return _SIDES.get(joint.partition("_")[0], _SIDES["middle"])


def overlay(
    frames: Iterable[tuple[float, np.ndarray]], poses: Sequence[PoseSequence], tags: Sequence[Tag] = ()
) -> Iterator[tuple[float, np.ndarray]]:
    """The frames with everybody drawn who was found at that time.

    Parameters
    ----------
    frames : iterable of (seconds, frame)
        The video that ``poses`` were extracted from, once more.
    poses : sequence of PoseSequence
    tags : sequence of callable, optional
        What to write above each of them at a time, besides the time; each then has a box in a colour of
        their own.
    """
    places = [iter(zip(pose.times.tolist(), pose.flat.keypoints, strict=True)) for pose in poses]
    ahead = [next(place, None) for place in places]
    for time, frame in frames:
        picture = frame.copy()
        for i, pose in enumerate(poses):
            found = ahead[i]
            while found is not None and found[0] < time - _SAME:  # its frame did not come again
                found = next(places[i], None)
            # Frames may share a time stamp, so that each pose is used for one frame, in order.
            if found is not None and found[0] <= time + _SAME:
                draw_pose(picture, found[1], skeleton(pose.skeleton))
                if tags:
                    draw_tag(picture, found[1], f"{tags[i](time)}  {time:.1f} s", _PEOPLE[i % len(_PEOPLE)])
                found = next(places[i], None)
            ahead[i] = found
        yield time, picture


def cropped(
    frames: Iterable[tuple[float, np.ndarray]],
    poses: Sequence[PoseSequence],
    margin: float = 0.15,
    height: int | None = None,
) -> tuple[Iterator[tuple[float, np.ndarray]], list[PoseSequence]]:
    """The frames, cropped to where the people of ``poses`` are in all their time; and the poses in them.

    Parameters
    ----------
    frames : iterable of (seconds, frame)
    poses : sequence of PoseSequence
        In pixels of the frames.
    margin : float
        On each side, as a share of the longer side of that place.
    height : int, optional
        What they are scaled to, in pixels, so that what is written into them is as large as it is looked at.
    """
    import cv2

    place = room_around([pose.box for pose in poses if pose.box], margin)
    corner = np.array([place[1].start, place[0].start], np.float32)
    edge = np.array(poses[0].frame_size or (place[1].stop, place[0].stop))
    wide, high = (np.minimum((place[1].stop, place[0].stop), edge) - corner).tolist()
    scale = 1.0 if height is None else height / high
    size = max(1, round(scale * wide)), round(scale * high)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    moved = [replace(pose, keypoints=(pose.keypoints - corner) * scale, frame_size=None) for pose in poses]
    parts = ((time, frame[place]) for time, frame in frames)
    if height is None:
        return parts, moved
    return ((time, cv2.resize(part, size, interpolation=how)) for time, part in parts), moved


def write_strip(
    frames: Iterable[tuple[float, np.ndarray]],
    path: Path,
    *,
    pictures: int = 8,
    height: int = STRIP,
    moments: Sequence[float] = (),
) -> int:
    """Write about evenly spaced frames side by side as a PNG; the number of frames seen.

    The video may be of any length: once twice as many pictures are held as needed, every other
    one is dropped.

    Parameters
    ----------
    frames : iterable of (seconds, frame)
        (H, W, 3) uint8 in BGR.
    path : path
        ``.png``; it appears once it is complete.
    pictures : int
        How many at most.
    height : int
        Of each, in pixels.
    moments : sequence of float
        Seconds of which there is to be a picture, instead of even times: of the first frame from then on, or
        the last one.

    Raises
    ------
    MediaError
        ``E_MEDIA_WRITE`` where there is no frame, or OpenCV cannot write it.
    """
    import cv2

    kept: list[np.ndarray] = []
    step, count = 1, 0
    last: np.ndarray | None = None

    def keep(frame: np.ndarray) -> None:
        width = max(1, round(frame.shape[1] * height / frame.shape[0]))
        kept.append(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA))

    wanted = [*(sorted(moments)[place] for place in _evenly(len(moments), pictures)), np.inf]
    for time, frame in frames:
        if time >= wanted[0] if moments else count % step == 0:
            wanted = [moment for moment in wanted if moment > time]
            keep(frame)
            last = None
            if len(kept) == 2 * pictures:
                del kept[1::2]
                step *= 2
        else:
            last = frame
        count += 1
    if last is not None and len(wanted) > 1:  # moments behind the last frame that was looked at
        keep(last)
    if not kept:
        raise MediaError("no frame to draw", subject=str(path), code="E_MEDIA_WRITE")
    done, data = cv2.imencode(".png", np.hstack([kept[place] for place in _evenly(len(kept), pictures)]))
    if not done:
        raise MediaError("cannot be written as PNG", subject=str(path), code="E_MEDIA_WRITE")
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())
    return count


def _evenly(count: int, most: int) -> list[int]:
    """At most so many evenly spaced ones of ``count`` places."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int)).tolist() if count else []
