"""Signals of a stream while it goes on: of the last seconds, a moment behind the newest frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gesture_core.errors import GestureError, PoseError
from gesture_core.plugin.abilities import NeedsDepth
from gesture_core.signals.chain import Chain
from gesture_core.skeletons import skeleton
from gesture_core.types import PoseSequence, Signals

WINDOW = 4.0
"""Seconds of keypoints that the signals of a frame are made from."""
LOOKAHEAD = 0.1
"""Seconds that a signal stays behind, so that smoothing sees what comes next."""
MEMORY = 30.0
"""Seconds of keypoints that are kept for the classifier."""
_WARM = 0.5
"""Seconds before the first signal of a stream, in which it is seen which joints there are."""


class LiveSignals:
    """Turns frames into signals, one frame at a time, so that blocks make no difference.

    Parameters
    ----------
    chain : Chain
        From `signals.stream_chain`.
    gap : float
        Seconds without the person after which the stream begins anew.

    Attributes
    ----------
    pose : PoseSequence
        The keypoints of the last `MEMORY` seconds.
    """

    pose: PoseSequence

    def __init__(self, chain: Chain, gap: float) -> None:
        self._chain, self._gap = chain, gap
        self.clear()

    def clear(self) -> None:
        """Begin a new stream."""
        name = self._chain.skeleton
        empty = np.empty((0, len(skeleton(name).joints), 2))
        self.pose = PoseSequence(empty, empty[..., 0], np.empty(0), name)
        self._done = -np.inf
        self._present: np.ndarray | None = None
        self._last: np.ndarray | None = None

    def push(self, pose: PoseSequence) -> Iterator[Signals | None]:
        """New signals after each frame of ``pose`` that brings any; None where the person was lost."""
        pose = pose.onto(self._chain.skeleton)
        flat = pose.keypoints.shape[2] == 2 and bool(pose.seen.any())
        if flat and isinstance(self._chain.normalizer, NeedsDepth):
            raise PoseError(
                "has no depth, and the settings compare in space",
                subject=pose.source,
                remedy="a network that knows depth, such as blazepose, or another --preset",
                code="E_POSE_SCALE",
            )
        for place in range(len(pose)):
            one = slice(place, place + 1)
            now, seen = float(pose.times[place]), bool(pose.seen[place].any())
            known = self.pose.times[self.pose.seen.any(axis=1)]
            if len(known) and now - known[-1] > self._gap:
                yield None  # whoever takes it may still need the keypoints, to judge the last candidates
                self.clear()
            if not seen and len(self.pose) == 0:
                continue
            if len(self.pose) == 0:
                self.pose = pose.part(slice(0))  # in the plane, or in space
            kept = slice(int(np.searchsorted(self.pose.times, now - MEMORY)), None)
            points = pose.keypoints[one]
            if not seen:  # a network says nothing then, of depth either
                points = np.full((1, *self.pose.keypoints.shape[1:]), np.nan, np.float32)
            self.pose = replace(
                pose,
                keypoints=np.concatenate([self.pose.keypoints[kept], points]),
                scores=np.concatenate([self.pose.scores[kept], pose.scores[one]]),
                times=np.concatenate([self.pose.times[kept], pose.times[one]]),
                depth=None,
            )
            if now - self.pose.times[0] < _WARM or not seen:
                continue
            signals = self._signals(now)
            if signals is not None:
                yield signals

    def _signals(self, now: float) -> Signals | None:
        """Signals of the times up to a moment ago that had none yet."""
        recent = slice(int(np.searchsorted(self.pose.times, now - WINDOW)), None)
        try:
            made = self._chain(self.pose.part(recent))
        except GestureError:  # too little is seen yet; a person who is lost for longer ends the stream
            return None
        new = (made.times > self._done) & (made.times <= now - LOOKAHEAD)
        if not new.any():
            return None
        assert made.present is not None
        if self._present is None:
            self._present = made.present
        # Channels that are gone for a while keep their last values, as a gap does.
        values = made.values[new].copy()
        lost = self._present & ~made.present
        if self._last is not None:
            values[:, lost] = self._last[lost]
        self._last, self._done = values[-1], float(made.times[new][-1])
        return replace(
            made,
            values=values,
            times=made.times[new],
            present=self._present,
            mask=np.ones(values.shape[1], bool),
        )
