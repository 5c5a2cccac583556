"""Which candidates become events: the best first, and none over another.

Thresholds are asked last (non-maximum suppression): the better half of a movement of another class must not
be refused first and leave room for the worse half. A candidate that its threshold refuses keeps only worse
ones away. What is short comes behind what overlaps it, and is not refused for that: some people are fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from gesture_core.spot.candidates import Candidate


class Suppression:
    """Candidates that wait for what may be better, and those that were decided.

    Parameters
    ----------
    allowed : callable
        Whether a candidate is near enough to its class to be an event.
    overlap : float
        Share of the shorter of two candidates by which they may overlap.
    patience : callable
        Seconds after its end in which a candidate waits for a better one.
    """

    def __init__(
        self,
        allowed: Callable[[Candidate], bool],
        overlap: float,
        patience: Callable[[Candidate], float],
    ) -> None:
        self._allowed, self._overlap, self._patience = allowed, overlap, patience
        self._waiting: list[Candidate] = []
        self._decided: list[tuple[Candidate, bool]] = []

    def add(self, candidate: Candidate) -> None:
        """Let ``candidate`` wait, unless what was decided keeps it away."""
        for other, accepted in self._decided:
            better = accepted or other.order <= candidate.order
            if better and candidate.overlaps(other, self._overlap):
                return
        self._waiting.append(candidate)

    def settle(self, now: float) -> list[Candidate]:
        """Events that are certain at ``now``: their patience is over, and nothing better waits over them."""
        events: list[Candidate] = []
        while any(self._due(one) <= now for one in self._waiting):
            # Of equal ones that which ended first.
            order = sorted(self._waiting, key=lambda one: (one.order, one.end, one.code))
            due = None
            for place, one in enumerate(order):
                free = not any(one.overlaps(better, self._overlap) for better in order[:place])
                if self._due(one) <= now and free:
                    due = one
                    break
            if due is None:
                break
            accepted = self._allowed(due)
            self._decided.append((due, accepted))
            self._waiting = [
                one for one in self._waiting if one is not due and not one.overlaps(due, self._overlap)
            ]
            if accepted:
                events.append(due)
        return events

    def _due(self, candidate: Candidate) -> float:
        return candidate.end + self._patience(candidate)

    def forget(self, before: float) -> None:
        """Drop what was decided and ended before any candidate that is still to come can begin."""
        self._decided = [pair for pair in self._decided if pair[0].end >= before]


def merged(events: Sequence[Candidate], held: Sequence[bool], seconds: float) -> list[Candidate]:
    """``events`` in the order of their starts; neighbours of one held gesture are one event."""
    found: list[Candidate] = []
    for event in sorted(events, key=lambda one: (one.start, one.end)):
        last = found[-1] if found else None
        if last and held[event.code] and last.code == event.code and event.start - last.end <= seconds:
            better = min(last, event, key=lambda one: one.rank)
            found[-1] = replace(better, start=last.start, end=max(last.end, event.end))
        else:
            found.append(event)
    return found
