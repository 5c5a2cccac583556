"""Stretches of a file between its packets that no packet covers, where something was passed over."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import BinaryIO

# Bytes between packets beyond those of block and cluster headers.
_HOLE = 30
# Shorter ones that are remembered: a longer list is how this file is written, no damage.
_MAX_SMALL = 10_000
# What begins a cluster of Matroska's blocks (RFC 9559, section 5.1.3).
_CLUSTER = bytes.fromhex("1f43b675")


@dataclass
class Holes:
    """Holes among the packets of all streams, in the order in which they were read.

    Attributes
    ----------
    large : int
        Stretches that are longer than any header.
    """

    large: int = 0
    _read_to: int | None = None
    _lengths: Counter[int] = field(default_factory=Counter)
    _small: list[tuple[int, int]] = field(default_factory=list)

    def passed(self, position: int | None, size: int) -> None:
        """A packet of ``size`` bytes at ``position``, where the container tells."""
        if position is None or position < 0:
            return
        start, self._read_to = self._read_to, position + size
        length = 0 if start is None else position - start
        if start is None or length < 0:
            return
        if length > _HOLE:
            self.large += 1
            return
        self._lengths[length] += 1
        if length > 2 * self._header and len(self._small) < _MAX_SMALL:
            self._small.append((start, length))

    @property
    def _header(self) -> int:
        """Bytes of a usual block's header."""
        return max(self._lengths, key=lambda length: self._lengths[length], default=0)

    def small(self, file: BinaryIO) -> int:
        """Short stretches of a Matroska file that have room for a block, and begin no cluster.

        A lost block leaves its own header, a byte at least, and the next block's header. The position
        of ``file`` is kept.
        """
        position = file.tell()
        found = 0
        for start, length in self._small:
            if length > 2 * self._header:
                file.seek(start)
                found += _CLUSTER not in file.read(length)
        file.seek(position)
        return found
