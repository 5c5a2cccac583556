"""What a container declares against what came out of it, in one class, `Integrity`.

Decoders skip damage without an error. A packet whose own header is broken leaves nothing but a hole among
the bytes that were read and a gap in an otherwise constant frame rate; a broken link in a chain of boxes or
elements looks like the end of the video. So a reader counts what passes, and at the end has it compared with
what the container declares: a number of frames where it has a table of samples (mov, avi, gif), a duration
(Matroska, FLV), and a structure without contradictions (`iso`, `matroska`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np

from gesture_core.video.integrity.iso import (
    edit_list_fault,
    has_movie_header,
    mirrored_rotation,
    picture_tracks,
    read_fragments,
    track_kinds,
)

MAX_NOTES = 12
# Containers that count in milliseconds claim 1000 frames/s where they know of none.
MAX_FPS = 500.0
# Containers with a table of samples, so that a count of frames is one.
_COUNTED = frozenset({"mov", "avi", "gif"})
_MIN_BYTES_PER_FRAME = 8
# Containers without a count of frames, whose header is written last and holds the duration, and by how
# many frames the last packet may miss it: FLV does not say how long packets last.
_TIMED = {"matroska": 0.6, "flv": 2.5}
# A frame rate is constant if this share of its intervals differ from their median by less than _JITTER, which
# is what rounding to milliseconds makes. That of cameras and browsers that drop frames is not.
_CONSTANT = 0.9
_JITTER = 0.0016
_MIN_INTERVALS = 8
# Bytes between packets beyond those of block and cluster headers.
_HOLE = 30
# Bytes of a fragmented file's media data that may be padding.
_PADDING = 64
# Seconds by which sound commonly outlasts the picture.
_OVERHANG = 0.25


@dataclass
class DamageLog:
    """What was found damaged or lost so far.

    ``damaged`` counts events that prove damage; ``notes`` maps a clause to how often it was noted.
    """

    damaged: int = 0
    notes: dict[str, int] = field(default_factory=dict)

    def damage(self, clause: str, count: int = 1) -> None:
        """Record damage; ``count`` is the number of packets or frames that the clause is about."""
        self.damaged += count
        self.note(clause)

    def note(self, clause: str) -> None:
        """Record what is worth knowing and no damage; the number of different clauses is limited."""
        if clause not in self.notes and len(self.notes) >= MAX_NOTES:
            clause = "and more"
        self.notes[clause] = self.notes.get(clause, 0) + 1


@dataclass
class Integrity:
    """Counts of what passed through demuxer and decoder, and their comparison with what the file declares.

    A reader that sees packets counts everything and ends with `compare_packets`; one that sees nothing but
    frames counts ``frames`` and ``stamps`` and ends with `compare_frames`. The position of the file is kept.

    Attributes
    ----------
    file : binary file
    container : str
        FFmpeg's name.
    log : DamageLog
        Receives what is damaged or missing.
    packets, empty : int
        Packets of the picture stream with data, and without, which repeat the last picture.
    unshown, hidden, refused : int
        Of those with data, how many only refresh a reference picture, are kept from being shown by an edit
        list, and raised in the decoder.
    frames : int
        Frames that the decoder gave.
    stamps : list of float
        Their seconds, as the container gives them.
    trimmed : int
        Declared frames that an edit list leaves out of the index altogether.
    end, size : float, int
        Seconds at which the last packet of any stream ends, and bytes of the packets of all streams.
    places, holes : int
        Places of the file that gave packets (several sounds may lie in one block), and stretches between two
        packets that no packet covers.
    """

    file: BinaryIO
    container: str
    log: DamageLog
    packets: int = 0
    empty: int = 0
    unshown: int = 0
    hidden: int = 0
    refused: int = 0
    frames: int = 0
    stamps: list[float] = field(default_factory=list)
    trimmed: int = 0
    end: float = 0.0
    size: int = 0
    places: int = 0
    holes: int = 0
    _last: int | None = None
    _read_to: int | None = None

    def count_bytes(self, position: int | None, size: int, end: float) -> None:
        """A packet of any stream: where it lies in the file, in bytes, and when it ends, in seconds."""
        self.end = max(self.end, end)
        self.size += size
        if position is None or position < 0:
            return
        self.places += position != self._last
        self.holes += self._read_to is not None and position - self._read_to > _HOLE
        self._last, self._read_to = position, position + size

    def plausible_count(self, count: float, rate: float) -> int | None:
        """The frame count of a header, None where container, rate and file size make it implausible.

        For readers whose library gives duration times average rate where the header has no count.
        """
        position = self.file.tell()
        size = self.file.seek(0, 2)
        tabled = self.container in _COUNTED and (
            self.container != "mov" or any(picture_tracks(self.file).values())
        )
        self.file.seek(position)
        plausible = tabled and 0 < rate <= MAX_FPS and 0 < count * _MIN_BYTES_PER_FRAME <= size
        return int(count) if plausible else None

    def headless(self) -> bool:
        """Whether a file of boxes has no movie header."""
        return not has_movie_header(self.file)

    def mirrored_rotation(self) -> float | None:
        """As in `iso.mirrored_rotation`; the file stays where it is."""
        position = self.file.tell()
        found = mirrored_rotation(self.file)
        self.file.seek(position)
        return found

    def track_types(self) -> list[int]:
        """The types of the tracks of Matroska (1 pictures, 2 sound, 17 subtitles) and mov (1 pictures, 0)."""
        if self.container == "mov":
            return track_kinds(self.file)
        from gesture_core.video.integrity.matroska import track_types

        return track_types(self.file)

    def compare_packets(
        self,
        *,
        declared: int | None,
        duration: float | None = None,
        shown: float | None = None,
        track: int = 0,
        indexed: int = 0,
        picture_streams: int = 1,
    ) -> None:
        """Record what is missing, after the last packet.

        Parameters
        ----------
        declared : int or None
            Frames that the header declares.
        duration, shown : float, optional
            Seconds that it declares for all streams, and for the pictures.
        track, indexed : int
            In a mov file, number of the picture track and samples in its index, 0 where that is not known.
        picture_streams : int
            Streams of pictures.
        """
        damage = self.log.damage
        length = duration if self.container in _TIMED else None
        position = self.file.tell()
        if self.container == "mov":
            fragments = read_fragments(self.file)
            if fragments.fault:
                damage(f"broken chain of fragments: {fragments.fault}")
            unread = fragments.payload - self.size
            if unread > max(_PADDING, fragments.payload // 50):
                damage(f"{unread} bytes of media data belong to no packet")
            self.trimmed = max(0, declared - indexed) if declared and indexed else 0
            declared = (declared or 0) + fragments.samples.get(track, 0) or None
            if self.hidden or self.trimmed:
                length = shown
                fault = edit_list_fault(self.file, track)
                if fault:
                    damage(f"frames hidden by a header that contradicts itself: {fault}")
        elif self.container == "matroska":
            from gesture_core.video.integrity.matroska import read_blocks

            blocks = read_blocks(self.file)
            if blocks.fault:
                damage(f"broken chain of elements: {blocks.fault}")
            lost = blocks.count - self.places
            if lost > 0:
                damage(f"blocks that gave no packet: {lost}", lost)
            self.holes += blocks.voids
            if blocks.closed:
                # Sound may end before the declared end, which is no loss in a file that is whole.
                length = None
        elif self.container == "flv" and picture_streams > 1:
            damage("pictures of a second codec, for which FLV has no room")
        self.file.seek(position)
        self._compare_counts(declared, length)

    def _compare_counts(self, declared: int | None, duration: float | None) -> None:
        """Frames against those declared, packets against frames, stamps against frame rate and duration."""
        damage, stamps, cut = self.log.damage, self.stamps, self.hidden or self.trimmed
        absent = (declared or 0) - self.trimmed - self.packets - self.empty
        if absent > 0:
            damage(f"{absent} of {declared} declared frames are not in the file", absent)
        silent = self.packets - self.unshown - self.hidden - self.refused - self.frames
        if silent > 0:
            damage(f"packets that gave no frame: {silent}", silent)
        lost = gaps(stamps) if self.holes or cut else 0
        if lost:
            damage(f"gaps in a constant frame rate, as of {lost} lost frames", lost)
        intervals = np.diff(stamps)
        backwards = bool((intervals < 0).any())
        if self.holes and backwards:
            damage("unread bytes and time stamps out of order")
        if not stamps:
            return
        step = float(np.median(intervals)) if len(intervals) else 0.04
        end, slack = self.end, _TIMED.get(self.container, 0.6) * step
        if cut:
            # A trimmed file shows all of its edit. Where damaged tables moved a frame out of the edit,
            # the frames that are left do not fill it, or do not come in order.
            end, slack = max(stamps) + step, 0.6 * step
            if backwards:
                damage("hidden packets and time stamps out of order")
        if duration is not None and duration - end > max(slack, 0.002 * duration):
            damage(f"ends at {end:.2f} of {duration:.2f} declared seconds")

    def compare_frames(self, *, declared: int | None, duration: float | None) -> None:
        """Record what is missing, after the last frame, for a reader that sees no packets.

        ``declared`` frames come from `plausible_count`, ``duration`` in seconds from the header.
        """
        position = self.file.tell()
        if self.container == "mov":
            fragments = read_fragments(self.file)
            if fragments.fault:
                self.log.damage(f"broken chain of fragments: {fragments.fault}")
            tracks = picture_tracks(self.file)
            if fragments.samples and tracks:
                track, own = next(iter(tracks.items()))
                declared = own + fragments.samples.get(track, 0)
        if self.container == "matroska":
            from gesture_core.video.integrity.matroska import read_blocks

            if fault := read_blocks(self.file).fault:
                self.log.damage(f"broken chain of elements: {fault}")
        self.file.seek(position)
        if declared is not None:
            absent = declared - self.frames
            if absent > 0:
                clause = f"{absent} of {declared} declared frames did not come: lost, or cut by an edit list"
                self.log.damage(clause, absent)
        elif duration is not None and self.container in _TIMED and len(self.stamps) > 1:
            step = float(np.median(np.diff(self.stamps)))
            end = max(self.stamps) + step
            # Sound may run on after the picture.
            if duration - end > max(2 * step, 0.05 * duration, _OVERHANG):
                self.log.damage(f"ends at {end:.2f} of {duration:.2f} declared seconds")
        else:
            self.log.note(
                "the header has no plausible frame count or duration; this reader cannot detect lost frames"
            )


def gaps(stamps: Sequence[float] | np.ndarray) -> int:
    """Frames that are absent from a video of constant frame rate; 0 where the rate is not constant.

    ``stamps`` are the seconds of its frames, in order.
    """
    intervals = np.diff(np.asarray(stamps, np.float64))
    if len(intervals) < _MIN_INTERVALS:
        return 0
    step = float(np.median(intervals))
    if step <= 0 or float(np.mean(np.abs(intervals - step) <= _JITTER)) < _CONSTANT:
        return 0
    long = intervals[intervals > 1.5 * step]
    return int((np.rint(long / step) - 1).sum())
