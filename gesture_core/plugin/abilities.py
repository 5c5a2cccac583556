"""What a plugin may do besides what every one of its kind does: each ability a Protocol, found by its names.

A class has an ability that has its methods and attributes; deriving from the Protocol says so to readers.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from gesture_core.plugin.interfaces import PoseBackend, Subsequences
    from gesture_core.types import SignalBatch, Signals


@runtime_checkable
class LazyFrames(Protocol):
    """Frames that are converted when they are asked for: what a `Video` may offer besides its iteration.

    Where only some frames are looked at (``pose.rate``), the others are decoded and counted all the same,
    and cost nothing more.
    """

    def pictures(self) -> Iterator[tuple[float, Callable[[], np.ndarray | None]]]:
        """Yield ``(seconds, convert)`` instead of iterating: ``convert()`` is the frame that iteration gives.

        It is None where the frame cannot be converted, which the report counts as damage. To be called
        before the next frame is asked for.
        """
        ...


@runtime_checkable
class CropFollowing(Protocol):
    """A pose backend that says how a person is best followed through a video.

    One that does not is given whole pictures, and limbs are chosen over time. One that has only some of
    these is an error.
    """

    follow: bool
    """Whether it is given a crop that follows the person unless the user says otherwise."""
    crop: float
    """Side of that crop over the reach of the body, from a raised hand to the foot."""
    steady: bool
    """Whether the limbs of a video are chosen for all frames together (`gesture_core.pose.temporal`)."""


@runtime_checkable
class PresenceLimit(Protocol):
    """A pose backend that gives nobody whose presence is less than its limit; 0.5 is taken of others."""

    presence: float


@runtime_checkable
class RegionFollowing(Protocol):
    """A pose backend whose network was made for one person, upright in a square of their own.

    It is given such squares where people are followed (`gesture_core.pose.region`).
    """

    @property
    def region(self) -> int:
        """Pixels of a side of the square; 0 where the network is none of these."""
        ...

    def finder(self) -> PoseBackend:
        """What finds the person where nobody has been followed so far; asked for once."""
        ...


@runtime_checkable
class DeviceChoice(Protocol):
    """A pose backend that runs on several devices, one of which its option ``device`` takes."""

    @classmethod
    def devices(cls) -> Mapping[str, Sequence[str]]:
        """The setting in [pose] that chooses, ``provider`` or ``target``, and what there is on this machine.

        The first one is what ``auto`` stands for.
        """
        ...


@runtime_checkable
class Traceable(Protocol):
    """A pose backend that says what makes its keypoints; it is kept in ``PoseSequence.provenance``."""

    provenance: Mapping[str, str]
    """Backend, runtime, hash of the model, and whatever else decides the keypoints, as text."""


@runtime_checkable
class ExplainsRefusal(Protocol):
    """A keypoint reader that says of a file with one of its suffixes why it does not take it."""

    def refusal(self, path: Path) -> str:
        """Why `KeypointReader.accepts` is false for ``path``, quoting what it begins with.

        Empty where the file is nothing like its own, so that another reader's reason is the better one.
        """
        ...


@runtime_checkable
class StreamStep(Protocol):
    """A normalizer or filter that looks at a whole sequence, and has a form for long recordings.

    Any other step is taken as it is: what it makes of a frame should depend on the frames near it alone.
    """

    def on_stream(self) -> Self:
        """The same step with nothing in it that needs the whole sequence."""
        ...


@runtime_checkable
class NeedsDepth(Protocol):
    """A normalizer of keypoints in three dimensions alone."""

    needs_depth: bool
    """True."""


@runtime_checkable
class PairKernel(Protocol):
    """A distance kernel that computes chosen pairs without the rest of their table."""

    def pairs(
        self, state: Any, queries: SignalBatch, query_index: np.ndarray, example_index: np.ndarray
    ) -> np.ndarray:
        """(K,) distances of pairs ``(query_index[k], example_index[k])``, with the bits of `distances`."""
        ...


@runtime_checkable
class SearchKernel(Protocol):
    """A distance kernel that helps an exact search: it abandons pairs, and bounds them from below."""

    def within(
        self,
        state: Any,
        queries: SignalBatch,
        query_index: np.ndarray,
        example_index: np.ndarray,
        limits: np.ndarray,
    ) -> np.ndarray:
        """(K,) distances of chosen pairs under a hard specification, as far as they matter.

        Bitwise those of `distances`, or infinity for a pair that exceeds ``limits[query_index[k]]``,
        of which there is one (float64) for each query.
        """
        ...

    def keogh(self, query: np.ndarray, lower: np.ndarray, upper: np.ndarray, squared: bool) -> np.ndarray:
        """(N, D) float64 sums over the frames of how far a query lies outside envelopes: LB_Keogh (Keogh
        and Ratanamahatana 2005).

        ``query`` is (D, n), ``lower`` and ``upper`` are (N, D, n), all float64; with ``squared`` the
        squares are summed.
        """
        ...


@runtime_checkable
class GradientKernel(Protocol):
    """A distance kernel that differentiates soft distances."""

    def gradients(
        self, state: Any, queries: SignalBatch, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Soft distances, and the gradients of their sum weighted by ``weights`` (Q, N).

        Returns
        -------
        (Q, N), (Q, T, D), (N, T, D)
            In the dtype of the batches; gradients are zero beyond each length and in dimensions that
            no pair of the series is compared on.
        """
        ...


@runtime_checkable
class SubsequenceKernel(Protocol):
    """A distance kernel that finds examples inside a stream (SPRING: Sakurai, Faloutsos, Yamamuro 2007).

    The same frames give the same bits, in whatever blocks they come.
    `gesture_core.dtw.subsequence.SubsequenceState` is a base for what `subsequences` returns.
    """

    def subsequences(self, examples: Sequence[np.ndarray], floor: float) -> Subsequences:
        """A stream that begins now, and in which ``examples``, (m, D) arrays, are looked for.

        ``floor`` is added to the variances that divide a cost, so that what stands still is not
        compared by its noise.
        """
        ...


@runtime_checkable
class ApproximateKernel(Protocol):
    """A distance kernel that is not held to the exact distances, and never chosen by ``auto``."""

    approximation: str
    """What it computes instead, for `gesture bench`: ``"FastDTW (Salvador and Chan 2007)"``."""


@runtime_checkable
class DeviceKernel(Protocol):
    """A distance kernel that may compute elsewhere than on the CPU."""

    @property
    def device(self) -> str:
        """Where it computes: ``"cpu"`` or the name of an accelerator, such as ``"cuda"``."""
        ...


@runtime_checkable
class WholeBody(Protocol):
    """A normalizer that is given, and returns, more than the 18 joints of the body."""

    @property
    def skeleton(self) -> str:
        """The skeleton of both, as `gesture_core.skeletons.skeleton` names it: ``coco18+hands``."""
        ...


@runtime_checkable
class OrdersClasses(Protocol):
    """A classifier whose scores are too coarse, or too small, to order the classes by."""

    def ordered(
        self, state: Mapping[str, np.ndarray], queries: Sequence[Signals | np.ndarray], distances: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The (Q, C) scores, and (Q, C) numbers by which the classes are ordered, highest first.

        Where those are equal, the class with the nearer example comes first.
        """
        ...


@runtime_checkable
class LeavesOut(Protocol):
    """A classifier that knows, without learning again, what it would say of examples it had not seen."""

    def left_out(
        self, examples: Sequence[Signals | np.ndarray], codes: np.ndarray, classes: int, distances: np.ndarray
    ) -> np.ndarray:
        """(N, C) score of each example by what all others teach; ``distances`` are (N, N)."""
        ...


@runtime_checkable
class Contributes(Protocol):
    """A classifier that says what each example adds, for `gesture explain`."""

    def contributions(self, state: Mapping[str, np.ndarray], distances: np.ndarray) -> np.ndarray:
        """(Q, M, C) what each example that queries are compared with adds to the score of each class."""
        ...


@runtime_checkable
class HasMembers(Protocol):
    """A classifier that asks several others, for `gesture explain`."""

    def members(
        self, state: Mapping[str, np.ndarray], queries: Sequence[Signals | np.ndarray], distances: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """(Q, C) what each adds to the scores, by its name; they add up to them."""
        ...


@runtime_checkable
class Closeable(Protocol):
    """An engine that keeps something between two calls of `run`."""

    def close(self) -> None:
        """End what is kept."""
        ...


_OF_SEVERAL_PARTS: Mapping[str, tuple[type, ...]] = {
    "pose": (CropFollowing, RegionFollowing),
    "kernel": (SearchKernel,),
}
"""The abilities that a plugin may have in part by mistake, by its kind."""


def lacking(kind: str, plugin: object) -> str:
    """What a plugin lacks of an ability of which it has a part, which counts for nothing; mostly empty."""
    absent = object()
    for ability in _OF_SEVERAL_PARTS.get(kind, ()):
        names = [name for name in {**vars(ability), **ability.__annotations__} if not name.startswith("_")]
        has = [name for name in names if inspect.getattr_static(plugin, name, absent) is not absent]
        no = [name for name in names if name not in has]
        if has and no:
            return (
                f"it has {' and '.join(has)} but no {' and no '.join(no)}: {ability.__name__} takes them all"
            )
    return ""
