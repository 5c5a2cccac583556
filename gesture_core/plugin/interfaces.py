"""The kinds of plugin, and the Protocol that the classes of each kind fulfil.

A plugin's class is constructed with its options as keyword arguments, so that a frozen dataclass
is the natural form. Its options, with their defaults, are then visible to `gesture plugins`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from gesture_core.dtw.spec import DtwSpec
    from gesture_core.run.work import Job, Outcome, Task
    from gesture_core.types import PoseSequence, SignalBatch, Signals


@dataclass(frozen=True)
class Kind:
    """A kind of plugin: its name in the registry, its hook, and its name in sentences.

    ``given`` are parameters that the program fills in, so that they are no options.
    """

    name: str
    hook: str
    title: str
    given: tuple[str, ...] = ()


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("pose", "register_pose_backends", "pose backend", ("model",)),
        Kind("reader", "register_keypoint_readers", "keypoint reader"),
        Kind("normalizer", "register_normalizers", "normalizer"),
        Kind("filter", "register_filters", "filter"),
        Kind("selector", "register_selectors", "dimension selector"),
        Kind("kernel", "register_distance_kernels", "distance kernel"),
        Kind("writer", "register_result_writers", "result writer"),
        Kind("engine", "register_engines", "execution engine", ("workers", "limits")),
    )
}


@dataclass(frozen=True, eq=False)
class Person:
    """One person in one picture, as a pose backend found them.

    Attributes
    ----------
    keypoints : (J, 2) float array
        Pixels of the frame that was passed in; NaN where missing.
    scores : (J,) float array
        Confidence in 0..1.
    """

    keypoints: np.ndarray
    scores: np.ndarray


class PoseBackend(Protocol):
    """Finds people in pictures. Constructed with ``model`` (a `pose.models.ModelFile`) and options."""

    skeleton: str
    batch_size: int

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        """People in each of ``frames``, each (H, W, 3) uint8 in BGR, best person first.

        ``people`` is ``"single"`` (at most one for each frame) or ``"multi"``.
        """
        ...


class KeypointReader(Protocol):
    """Reads ready-made keypoint files.

    A reader whose options include ``fps`` or ``people`` is given those of the section [pose]. What a
    file does not say and the reader assumes, such as the frames a second, is named in
    ``PoseSequence.provenance["assumed"]``; the end of a run says for how many files.
    """

    def accepts(self, path: Path) -> bool:
        """Whether this reader takes ``path``, a file or a folder, judged cheaply by name and first bytes.

        A file at which this fails, and that no other reader takes, gets an error row.
        """
        ...

    def members(self, path: Path) -> list[str]:
        """Names of the sequences inside ``path``, in a stable order; ``[""]`` where it is one sequence."""
        ...

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """One sequence for each person in ``member`` of ``path``; a KeypointError says what is wrong."""
        ...


class Normalizer(Protocol):
    """Brings keypoints into the body's own frame of reference."""

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) coordinates in body units from a COCO-18 ``pose``; NaN stays NaN."""
        ...


class Filter(Protocol):
    """Changes signals: smoothing, centring, derivatives, resampling, leaving channels out.

    A filter that adds, drops or reorders channels does so with ``mask`` and ``present`` too: a
    channel is salient, or there, where what it is made of is. Names tell later stages what a channel is:
    ``left_`` and ``right_`` in front change places in a mirror, which turns what ends in ``_x`` (before
    a ``.`` or ``@``) round; channels whose names differ only in side and axis are one part of the body
    for ``classify.separate``. So ``left_wrist.speed`` is mirrored, ``speed_left_wrist`` is not.
    """

    def apply(self, signals: Signals) -> Signals:
        """The filtered signals; the input is read-only."""
        ...


class Selector(Protocol):
    """Chooses the salient dimensions of one sequence."""

    def select(self, signals: Signals) -> np.ndarray:
        """(D,) bool mask from the normalised, unfiltered ``signals``."""
        ...


@runtime_checkable
class DistanceKernel(Protocol):
    """Computes warping distances in batches: prepare once, compute many.

    Constructed without options or with them as keywords. The same pair must give the same bits in
    whatever batch it travels. ``state`` is the kernel's own: the caller hands back what `prepare`
    returned. A kernel that can do more has the methods of `PairKernel`, `BoundedKernel`,
    `GradientKernel`, `LowerBoundKernel`, `ApproximateKernel` or `DeviceKernel` as well.
    """

    def supports(self, spec: DtwSpec) -> bool:
        """Whether this kernel computes distances under ``spec``."""
        ...

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> Any:
        """Whatever is worth computing once for ``examples``."""
        ...

    def distances(self, state: Any, queries: SignalBatch) -> np.ndarray:
        """(Q, N) float array; infinity where a pair has no dimension in common, never NaN."""
        ...


@runtime_checkable
class PairKernel(DistanceKernel, Protocol):
    """A distance kernel that computes chosen pairs without the rest of their table."""

    def pairs(
        self, state: Any, queries: SignalBatch, query_index: np.ndarray, example_index: np.ndarray
    ) -> np.ndarray:
        """(K,) distances of pairs ``(query_index[k], example_index[k])``, with the bits of `distances`."""
        ...


@runtime_checkable
class BoundedKernel(DistanceKernel, Protocol):
    """A distance kernel that abandons pairs which are certain to exceed a limit."""

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


@runtime_checkable
class GradientKernel(DistanceKernel, Protocol):
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
class LowerBoundKernel(DistanceKernel, Protocol):
    """A distance kernel with a fast LB_Keogh (Keogh and Ratanamahatana 2005) for exact search."""

    def keogh(self, query: np.ndarray, lower: np.ndarray, upper: np.ndarray, squared: bool) -> np.ndarray:
        """(N, D) float64 sums over the frames of how far a query lies outside envelopes.

        ``query`` is (D, n), ``lower`` and ``upper`` are (N, D, n), all float64; with ``squared`` the
        squares are summed.
        """
        ...


@runtime_checkable
class ApproximateKernel(DistanceKernel, Protocol):
    """A distance kernel that is not held to the exact distances, and never chosen by ``auto``."""

    approximation: str
    """What it computes instead, for `gesture bench`: ``"FastDTW (Salvador and Chan 2007)"``."""


@runtime_checkable
class DeviceKernel(DistanceKernel, Protocol):
    """A distance kernel that may compute elsewhere than on the CPU."""

    @property
    def device(self) -> str:
        """Where it computes: ``"cpu"`` or the name of an accelerator, such as ``"cuda"``."""
        ...


class ResultWriter(Protocol):
    """Writes the rows of a run to a file."""

    suffix: str

    def write(self, rows: Iterator[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows``, dicts with the keys ``columns``, to ``path``."""
        ...


class ExecutionEngine(Protocol):
    """Runs one job over many tasks. Constructed with ``workers`` and ``limits``.

    `run` is called once for the examples and once for the queries of a run, with the same job. An
    engine that keeps something between the two has a method ``close``, which ends it.
    """

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Task, int], None]
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, in any order.

        ``on_frames(task, n)`` is called as frames are done, for progress. A task that fails, hangs
        or kills its process yields an outcome that says so; it never ends the others.
        """
        ...
