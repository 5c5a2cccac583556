"""Videos: frames with their real time stamps, upright, and an account of what was lost.

A frame travels like this. `open_video` (`reader`) makes the video reader that a name stands for, a plugin.
Its class of `VideoDecoder` (`decoder`) opens the file if it is a regular file that begins as a video
(`containers`), and decodes stored pictures with the container's stamps. The base class makes seconds of the
stamps, turns pictures upright, keeps their size constant and holds the limits. What goes wrong on the way is
written to a `DamageLog`; at the end `Integrity` (`integrity`) compares what came with what the container
declares, by its counts and by its structure (`integrity.iso`, `integrity.matroska`). The report of the video
has all of it. `at_rate` (`reader`) takes the frames that are looked at.

Public for plugins of the kind ``video``, besides `gesture_core.errors` and `gesture_core.plugin.interfaces`:
the names below.
"""

from gesture_core.video.containers import CONTAINERS, UNTIMED
from gesture_core.video.decoder import LazyPicture, VideoDecoder
from gesture_core.video.integrity import DamageLog, Integrity
from gesture_core.video.reader import at_rate, open_configured, open_video, pictures, reader_name

__all__ = [
    "CONTAINERS",
    "UNTIMED",
    "DamageLog",
    "Integrity",
    "LazyPicture",
    "VideoDecoder",
    "at_rate",
    "open_configured",
    "open_video",
    "pictures",
    "reader_name",
]
