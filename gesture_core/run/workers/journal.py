"""What the pose network answers about a long video, kept as it comes: what is killed goes on from there.

Frames are decoded again, which is cheap and counts their damage again; the network is not asked again. It is
asked the same questions in the same order, so the keypoints are those of a run that nothing has stopped.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.files import TEMPORARY
from gesture_core.plugin.abilities import RegionFollowing
from gesture_core.run.store import storing
from gesture_core.types import Person

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import PoseBackend

_HASH, _LENGTH = 16, 4
_MOST = 64 << 20
"""Bytes of one answer."""
_FACTS = ("skeleton", "batch_size", "follow", "crop", "steady", "region", "provenance")
"""What a backend may say of itself besides what it answers."""


class Journal:
    """The answers about one video, in a file. Whatever is not whole at its end counts as not there."""

    def __init__(self, path: Path) -> None:
        self._folder, self._known = path.parent, True
        with storing(path.parent):
            self._file = path.open("r+b" if path.exists() else "w+b")

    def close(self) -> None:
        """Write nothing more."""
        self._file.close()

    def recall(self, pictures: int) -> list[list[Person]] | None:
        """The next answer, about so many pictures; None where it was not given, from then on."""
        if not self._known:
            return None
        place = self._file.tell()
        size = int.from_bytes(self._file.read(_LENGTH), "little")
        digest = self._file.read(_HASH)
        answer = None
        if 0 < size <= _MOST:
            payload = self._file.read(size)
            if len(payload) == size and hashlib.sha256(payload).digest()[:_HASH] == digest:
                answer = _unpacked(payload)
        if answer is None or len(answer) != pictures:
            self._known = False
            self._file.seek(place)
            self._file.truncate()
            return None
        return answer

    def keep(self, answer: Sequence[Sequence[Person]]) -> None:
        """Append an answer."""
        payload = _packed(answer)
        digest = hashlib.sha256(payload).digest()[:_HASH]
        with storing(self._folder):
            self._file.write(len(payload).to_bytes(_LENGTH, "little") + digest + payload)
            self._file.flush()


class Remembering:
    """A pose backend that asks another one only what the journal does not know."""

    skeleton: str
    batch_size: int

    def __init__(self, backend: PoseBackend, journal: Journal) -> None:
        self._backend, self._journal = backend, journal
        for name in _FACTS:
            if hasattr(backend, name):
                setattr(self, name, getattr(backend, name))
        if isinstance(backend, RegionFollowing):
            self.finder = lambda: Remembering(backend.finder(), journal)

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        """As `PoseBackend.estimate`."""
        known = self._journal.recall(len(frames))
        if known is not None:
            return known
        answer = self._backend.estimate(frames, people)
        self._journal.keep(answer)
        return answer


@contextmanager
def remembering(backend: PoseBackend, stored: Path) -> Iterator[PoseBackend]:
    """``backend`` with what it has answered about the video whose keypoints will be ``stored``.

    While another process works on the same video, it is the backend itself.
    """
    from filelock import FileLock, Timeout

    path = stored.with_name(f".{TEMPORARY}{stored.name}.journal")
    lock = FileLock(path.with_suffix(".lock"), blocking=False)
    with storing(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(Timeout):
            lock.acquire()
    if not lock.is_locked:
        yield backend
        return
    try:
        journal = Journal(path)
        try:
            yield Remembering(backend, journal)
        finally:
            journal.close()
        path.unlink()  # only where nothing was raised; what a killed run leaves goes with other leftovers
    finally:
        lock.release()
        path.with_suffix(".lock").unlink(missing_ok=True)


def _packed(answer: Sequence[Sequence[Person]]) -> bytes:
    out = io.BytesIO()
    np.save(out, np.array([len(people) for people in answer], np.int64), allow_pickle=False)
    for people in answer:
        for one in people:
            given = [one.peaks is not None, one.region is not None]
            facts = np.array([one.presence, one.others, *given], np.float64)
            for array in (one.keypoints, one.scores, facts, one.peaks, one.region):
                if array is not None:
                    np.save(out, np.asarray(array), allow_pickle=False)
    return out.getvalue()


def _unpacked(payload: bytes) -> list[list[Person]] | None:
    file = io.BytesIO(payload)

    def read() -> np.ndarray:
        return np.asarray(np.load(file, allow_pickle=False))

    def person() -> Person:
        keypoints, scores, facts = read(), read(), read()
        peaks = read() if facts[2] else None
        region = read() if facts[3] else None
        return Person(keypoints, scores, peaks, float(facts[0]), region, int(facts[1]))

    try:
        return [[person() for _ in range(count)] for count in read().tolist()]
    except (ValueError, EOFError, OSError, IndexError, MemoryError):
        return None
