"""The kinds of plugin, and the Protocol that the classes of each kind fulfil.

A plugin's class is constructed with its options as keyword arguments, so that a frozen dataclass
is the natural form. Its options, with their defaults, are then visible to `gesture plugins`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

from gesture_core.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from gesture_core.dtw.spec import DtwSpec
    from gesture_core.types import Job, Outcome, PoseSequence, SignalBatch, Signals, Task


@dataclass(frozen=True)
class Kind:
    """A kind of plugin: its name in the registry, its hook, and its name in sentences.

    ``given`` are parameters that the program fills in, so that they are no options; ``offered`` are
    those that it fills in where a class takes them.
    """

    name: str
    hook: str
    title: str
    given: tuple[str, ...] = ()
    offered: tuple[str, ...] = ()

    @property
    def filled(self) -> tuple[str, ...]:
        """Parameters that are no options."""
        return self.given + self.offered


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("video", "register_video_readers", "video reader"),
        Kind("pose", "register_pose_backends", "pose backend", ("model",)),
        Kind("reader", "register_keypoint_readers", "keypoint reader", (), ("options", "people")),
        Kind("normalizer", "register_normalizers", "normalizer"),
        Kind("filter", "register_filters", "filter"),
        Kind("selector", "register_selectors", "dimension selector"),
        Kind("kernel", "register_distance_kernels", "distance kernel"),
        Kind("writer", "register_result_writers", "result writer"),
        Kind("engine", "register_engines", "execution engine", ("workers", "limits")),
    )
}

# ---- video readers


@dataclass(frozen=True)
class VideoLimits:
    """What one video may cost at most.

    Attributes
    ----------
    max_pixels : int
        Width times height of a frame; the default is that of the setting ``limits.pixels``.
    max_frames : int
        Frames that are decoded; the default is that of the setting ``limits.frames``.
    max_seconds : float
        Time stamp of the last frame, in seconds; the default is six hours.
    max_streams : int
        Streams that a container may announce.
    """

    max_pixels: int = 64_000_000
    max_frames: int = 200_000
    max_seconds: float = 6 * 3600.0
    max_streams: int = 64

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ConfigError(f"{name} is {value!r}, it must be above zero", code="E_OPTION")


@dataclass(frozen=True)
class VideoInfo:
    """What the container says of its video stream.

    Attributes
    ----------
    width, height : int
        Pixels of the upright picture.
    frames_declared : int or None
        Number of frames that the header claims, None where it claims none or nonsense. Never
        used to allocate anything.
    fps : float or None
        Average frames a second, None where the container does not say.
    rotation : int
        Degrees clockwise by which stored pictures are turned to stand upright: 0, 90, 180, 270.
    codec : str
        FFmpeg's name of the codec, or its four-character code.
    container : str
        FFmpeg's name of the container format.
    reader : str
        Name of the video reader.
    mirrored : bool
        The stored pictures are also flipped left to right, after the rotation.
    """

    width: int
    height: int
    frames_declared: int | None
    fps: float | None
    rotation: int
    codec: str
    container: str
    reader: str
    mirrored: bool = False


@dataclass(frozen=True)
class VideoReport:
    """What became of a video.

    Attributes
    ----------
    frames_declared : int or None
        As in `VideoInfo`.
    frames_read : int
        Frames that were decoded, whether anybody looked at them or not.
    damaged : int
        Corrupt packets and frames, decoding errors, and frames that are known to be lost.
    complete : bool
        The video was read to its end and nothing was found damaged or missing.
    notes : tuple of str
        What was found, one clause each.
    reader : str
        Name of the video reader.
    assumed : str
        What the file does not say and was assumed, such as the frame rate of a stream without times, with
        the setting that says otherwise.
    """

    frames_declared: int | None
    frames_read: int
    damaged: int
    complete: bool
    notes: tuple[str, ...] = ()
    reader: str = ""
    assumed: str = ""


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


# ---- pose backends


@dataclass(frozen=True, eq=False)
class Person:
    """One person in one picture, as a pose backend found them.

    Attributes
    ----------
    keypoints : (J, 2) float array
        Pixels of the frame that was passed in; NaN where missing.
    scores : (J,) float array
        Confidence in 0..1.
    peaks : (J, K, 3) float32 array, optional
        x, y and score of all places where each joint may be, the highest first; NaN, NaN, 0 beyond the
        last. The first need not be a keypoint: it may be too low to count by itself. With them the choice
        over time (`gesture_core.pose.temporal`) may take another place than the best of one frame.
    presence : float
        Probability in 0..1 that this is a person at all.
    region : (2, 2) float array, optional
        Of a network that sees regions (`RegionFollowing`): the middle of the body, and the point above the
        head of the circle around it that all of the body can reach.
    others : int
        How many more people the network saw in the picture, where only this one was asked for.
    """

    keypoints: np.ndarray
    scores: np.ndarray
    peaks: np.ndarray | None = None
    presence: float = 1.0
    region: np.ndarray | None = None
    others: int = 0


@runtime_checkable
class PoseBackend(Protocol):
    """Finds people in pictures.

    Constructed with ``model`` (a `gesture_core.pose.models.ModelFile`) and options as keywords. The
    parameters of the constructor are its options. Three of them come from the program where they are
    taken: ``threads`` (of the runtime, 0 for its own choice), and, where the user sets them in [pose],
    ``height`` (of the input, in pixels) and ``score`` (below which a joint is missing).

    More abilities are optional: `CropFollowing`, `RegionFollowing`, `DeviceChoice`, `TemporalChoice`,
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
class CropFollowing(Protocol):
    """A pose backend that says how a crop that follows the person suits it."""

    follow: bool
    """Whether it is given such a crop unless the user says otherwise."""
    crop: float
    """Side of the crop over the reach of the body, from a raised hand to the foot."""


@runtime_checkable
class RegionFollowing(PoseBackend, Protocol):
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
class TemporalChoice(Protocol):
    """A pose backend with an option ``steady``; without it, limbs are chosen over time by default."""

    steady: bool
    """Whether the limbs of a video are chosen for all frames together (`gesture_core.pose.temporal`)."""


@runtime_checkable
class Traceable(Protocol):
    """A pose backend that says what makes its keypoints; it is kept in ``PoseSequence.provenance``."""

    provenance: Mapping[str, str]
    """Backend, runtime, hash of the model, and whatever else decides the keypoints, as text."""


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
    Frames that cannot be read count as frames without people, and ``provenance["lost"]`` says how many they
    are and why: the row is degraded.
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
class ExplainsRefusal(Protocol):
    """A keypoint reader that says of a file with one of its suffixes why it does not take it."""

    def refusal(self, path: Path) -> str:
        """Why `KeypointReader.accepts` is false for ``path``, quoting what it begins with.

        Empty where the file is nothing like its own, so that another reader's reason is the better one.
        """
        ...


@runtime_checkable
class Normalizer(Protocol):
    """Brings keypoints into the body's own frame of reference."""

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) coordinates in body units from a COCO-18 ``pose``; NaN stays NaN."""
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
class StreamStep(Protocol):
    """A normalizer or filter that looks at a whole sequence, and has a form for long recordings.

    Any other step is taken as it is: what it makes of a frame should depend on the frames near it alone.
    """

    def on_stream(self, mean: float) -> Self:
        """The same step with nothing in it that needs the whole sequence.

        Where it subtracts a mean, that of ``mean`` seconds around each frame; none where that is zero.
        """
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
    returned. A kernel that can do more has the methods of `PairKernel`, `BoundedKernel`,
    `GradientKernel`, `LowerBoundKernel`, `SubsequenceKernel`, `ApproximateKernel` or `DeviceKernel` as well.
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
class SubsequenceKernel(DistanceKernel, Protocol):
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
    """

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Task, int], None]
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, in any order.

        ``on_frames(task, n)`` is called as frames are done, for progress. A task that fails, hangs
        or ends its process yields an outcome that says so; it never ends the others.
        """
        ...


@runtime_checkable
class Closeable(Protocol):
    """An engine that keeps something between two calls of `run`."""

    def close(self) -> None:
        """End what is kept."""
        ...


INTERFACES: Mapping[str, type] = {
    "video": VideoReader,
    "pose": PoseBackend,
    "reader": KeypointReader,
    "normalizer": Normalizer,
    "filter": Filter,
    "selector": Selector,
    "kernel": DistanceKernel,
    "writer": ResultWriter,
    "engine": ExecutionEngine,
}
"""The Protocol of each kind."""
