"""The Protocol that the classes of each kind of plugin fulfil; what they may do besides: `abilities`.

A plugin's class is constructed with its options as keyword arguments, so that a frozen dataclass
is the natural form. Its options, with their defaults, are then visible to `gesture plugins`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from gesture_core.records import VideoInfo as VideoInfo
from gesture_core.records import VideoLimits as VideoLimits
from gesture_core.records import VideoReport as VideoReport
from gesture_core.types import Person as Person

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from gesture_core.dtw.spec import DtwSpec
    from gesture_core.types import Job, Outcome, PoseSequence, SignalBatch, Signals, Task


class Video(Protocol):
    """One open video: a context manager that is iterated once.

    Iterating yields ``(seconds, frame)``: seconds from the start of the stream, finite, never
    decreasing, and (H, W, 3) uint8 in BGR, upright. Every frame has the size that ``info`` states.
    """

    @property
    def info(self) -> VideoInfo:
        """Known as soon as the video is open."""
        ...

    @property
    def report(self) -> VideoReport:
        """What was read so far; after the last frame, whether that was all."""
        ...

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]: ...

    def __enter__(self) -> Video: ...

    def __exit__(self, *error: object) -> None: ...


@runtime_checkable
class VideoReader(Protocol):
    """Opens videos. Where what it needs is absent or too old, its construction raises a
    MissingDependencyError; ``pose.reader = auto`` then takes the next reader.

    `gesture_core.video.VideoDecoder` is a base for what `open` returns: it opens the file safely and
    does what all readers share.
    """

    def open(self, path: Path, limits: VideoLimits) -> Video:
        """The video in the file ``path``, its first frame decoded; a MediaError says what is wrong.

        Memory is allocated for nothing that exceeds ``limits``.
        """
        ...


@runtime_checkable
class PoseBackend(Protocol):
    """Finds people in pictures.

    Constructed with ``model`` (a `gesture_core.pose.models.ModelFile`) and options as keywords. The
    parameters of the constructor are its options. Three of them come from the program where they are
    taken: ``threads`` (of the runtime, 0 for its own choice), and, where the user sets them in [pose],
    ``height`` (of the input, in pixels) and ``score`` (below which a joint is missing).

    More abilities are optional: `CropFollowing`, `PresenceLimit`, `RegionFollowing`, `DeviceChoice`,
    `Traceable`, and `Person.peaks`.
    `gesture_core.pose.network.NetworkBackend` is a base class that has them all.
    """

    skeleton: str
    """A key of `gesture_core.skeletons.SKELETONS`."""
    batch_size: int
    """Frames that `estimate` is best given at once."""

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        """People in each of ``frames``, each (H, W, 3) uint8 in BGR, best person first.

        ``people`` is ``"single"`` (at most one for each frame) or ``"multi"``.
        """
        ...


@runtime_checkable
class KeypointReader(Protocol):
    """Reads ready-made keypoint files.

    A reader whose constructor takes ``options`` (a `gesture_core.plugin.reading.ReadOptions`) is given what
    the user says of files that leave it open: axes, unit, frame size, order of the joints, rate. One that
    takes ``people`` is given ``pose.people``. A reader of files that say everything themselves needs neither.

    What is assumed of a file that leaves it open is named in ``PoseSequence.provenance["assumed"]``, which
    `ReadOptions.assumed` writes; what of a file is not used, or was put right, in ``provenance["notes"]``,
    clauses separated by ``"; "``. Both stand in the row, and the end of a run says of how many files.
    ``provenance["unit"]`` is ``metres`` where coordinates are no pixels.
    Frames that cannot be read stay as frames without people, ``provenance["lost"]`` says how many they are
    and why, and ``provenance["lost_frames"]`` is their number: the row is degraded, and does not count them.
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


@runtime_checkable
class Normalizer(Protocol):
    """Brings keypoints into the body's own frame of reference."""

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) coordinates in body units from a COCO-18 ``pose``; NaN stays NaN.

        Of a pose in three dimensions (T, 18, 3); `NeedsDepth` says that there must be three.
        """
        ...


@runtime_checkable
class Filter(Protocol):
    """Changes signals: smoothing, centring, derivatives, resampling, leaving channels out.

    A filter that adds, drops or reorders channels does so with ``mask`` and ``present`` too; a new
    channel is salient, or present, where the channels that it is made from are.

    Later stages go by the names of channels. A mirror exchanges ``left_`` and ``right_`` at the start of
    a name, and reverses the sign of a channel whose name ends in ``_x`` (before a ``.`` or ``@``).
    Channels whose names differ only in side and axis are one part of the body for
    ``classify.separate``. So ``left_wrist.speed`` is mirrored, ``speed_left_wrist`` is not.
    """

    def apply(self, signals: Signals) -> Signals:
        """The filtered signals; the input is read-only."""
        ...


@runtime_checkable
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
    returned. A kernel that can do more has the methods of `PairKernel`, `SearchKernel`,
    `GradientKernel`, `SubsequenceKernel`, `ApproximateKernel` or `DeviceKernel` as well.
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
class Classifier(Protocol):
    """Decides which class a query is of: by its distances to the examples, or by the signals themselves.

    Constructed with its options as keywords; parameters called ``neighbors``, ``sharpness``, ``shrinkage``
    or ``mirror`` are those of [classify]. What it learns is arrays, which stay with the run: nothing is
    pickled, and the same object may be asked about several libraries. It may also have `OrdersClasses`,
    `LeavesOut`, `Contributes` or `HasMembers`.

    Series are `Signals`, or bare (T, D) float64 arrays where a Python caller gave such. The same query must
    get the same scores in whatever batch it travels.
    """

    least: int
    """Examples that every class must have; with fewer nothing is fitted, and the user is told."""
    compares: bool
    """Whether `fit` needs the distances among the examples, the costly part of a fit."""

    def fit(
        self,
        examples: Sequence[Signals | np.ndarray],
        codes: np.ndarray,
        classes: int,
        distances: np.ndarray | None,
        marks: np.ndarray,
    ) -> Mapping[str, np.ndarray]:
        """Learn from N examples.

        Parameters
        ----------
        examples : sequence of N Signals or (T, D) arrays
        codes : (N,) int64
            Class of each, 0 to ``classes - 1``; a class may have none.
        classes : int
        distances : (N, M) float64, or None where nothing asked for them
            To the examples at ``marks``; infinite where a pair cannot be compared; those to itself mean
            nothing.
        marks : (M,) int64
            The examples that queries are compared with: mostly all.

        Returns
        -------
        mapping of str to array
            Numbers and texts; all that `scores` needs.
        """
        ...

    def scores(
        self, state: Mapping[str, np.ndarray], queries: Sequence[Signals | np.ndarray], distances: np.ndarray
    ) -> np.ndarray:
        """(Q, C) finite scores: about 1 for the right class and 0 for another one, the highest one wins.

        ``distances`` are (Q, M) float64, infinite where a pair cannot be compared. Scores of a class none of
        whose examples can be compared with the query do not count.
        """
        ...


class Subsequences(Protocol):
    """Examples that are looked for in one stream, and how far into them it is now."""

    def push(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Take the next (B, D) ``frames`` of the stream.

        Returns
        -------
        distances : (B, N) float64
            Of the best subsequence that ends in each frame to each example, as
            `gesture_core.dtw.subsequence` defines it; infinite where none can end there yet.
        lengths : (B, N) int32
            Frames of that subsequence; 0 where there is none.
        """
        ...


@runtime_checkable
class ResultWriter(Protocol):
    """Writes the rows of a run to a file."""

    suffix: str

    def write(self, rows: Iterator[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        """Write ``rows``, dicts with the keys ``columns``, to ``path``."""
        ...


@runtime_checkable
class ExecutionEngine(Protocol):
    """Performs tasks, calls of worker functions by name. Constructed with ``workers`` and ``limits``.

    `run` is called several times in a run of the program, with the same job. Wherever a task is
    performed, it is ``gesture_core.run.workers.worker.Worker(job, report).perform(task)`` that does it.
    An error travels as plain values by ``as_tree`` and ``from_tree`` of that module; what the function
    ``extract`` has left in the store of another machine (``value["stored"]``) is brought to ``job.store``.
    """

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Task, int], None]
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, in any order.

        ``on_frames(task, n)`` is called as frames are done, for progress. A task that fails, hangs
        or ends its process yields an outcome that says so; it never ends the others.
        """
        ...


INTERFACES: Mapping[str, type] = {
    "video": VideoReader,
    "pose": PoseBackend,
    "reader": KeypointReader,
    "normalizer": Normalizer,
    "filter": Filter,
    "selector": Selector,
    "kernel": DistanceKernel,
    "classifier": Classifier,
    "writer": ResultWriter,
    "engine": ExecutionEngine,
}
"""The Protocol of each kind."""
