"""The arrays that travel from stage to stage: frozen, validated on construction. Plain values: `records`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gesture_core.errors import GestureError, InputError, KeypointError, SignalError
from gesture_core.errors import Status as Status
from gesture_core.recordings import Recording as Recording
from gesture_core.records import COLUMNS as COLUMNS
from gesture_core.records import Event as Event
from gesture_core.records import Job as Job
from gesture_core.records import Outcome as Outcome
from gesture_core.records import Prediction as Prediction
from gesture_core.records import Row as Row
from gesture_core.records import Task as Task
from gesture_core.skeletons import COCO18, mapped, skeleton


def _single(array: np.ndarray) -> np.ndarray:
    """``array`` as float32; what does not fit becomes infinite, and is then refused as such."""
    with np.errstate(over="ignore"):
        return _filled(array).astype(np.float32, copy=False)


def _filled(array: np.ndarray) -> np.ndarray:
    """``array`` with NaN for what is masked: NumPy's conversions would show what lies below the mask."""
    if isinstance(array, np.ma.MaskedArray):
        return np.ma.filled(array.astype(np.float64), np.nan)
    return np.asarray(array)


def _frozen(array: np.ndarray, dtype: type) -> np.ndarray:
    """A read-only copy of ``array`` in ``dtype``, apart from the caller's own."""
    copy: np.ndarray = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


def _seconds(times: np.ndarray, kind: type[GestureError], source: str, code: str) -> np.ndarray:
    """``times`` as float64; an error where they are not finite, or decrease."""
    found = _filled(times).astype(np.float64)
    if not (np.isfinite(found).all() and (np.diff(found) >= 0).all()):
        raise kind("times are not finite and ascending", subject=source, code=code)
    return found


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
    depth : (J,) float array, optional
        As in `PoseSequence`.
    """

    keypoints: np.ndarray
    scores: np.ndarray
    peaks: np.ndarray | None = None
    presence: float = 1.0
    region: np.ndarray | None = None
    others: int = 0
    depth: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PoseSequence:
    """The keypoints of one person over time.

    Attributes
    ----------
    keypoints : (T, J, 2 or 3) float32
        x to the right, y down, in pixels of the upright picture (or in the unit of the keypoint file); z,
        where it is known, away from who looks. NaN in all coordinates where the joint is missing.
    scores : (T, J) float32
        Confidence in 0..1; zero where the joint is missing.
    times : (T,) float64
        Seconds from the container, never decreasing.
    skeleton : str
        A name that `gesture_core.skeletons.skeleton` knows.
    frame_size : (width, height) or None
        Pixels of the upright picture, None where the file does not say.
    person : int
        Track number inside the input, 0 for the first or only person.
    source : str
        The input, as the user named it.
    provenance : mapping
        What made the keypoints: backend, model hash, reader.
    depth : (T, J) float32, optional
        How far each joint is behind the middle of the hips, in the unit of the keypoints, where a network
        says so and the keypoints are in the plane; NaN where the joint is missing.
    """

    keypoints: np.ndarray
    scores: np.ndarray
    times: np.ndarray
    skeleton: str = COCO18.name
    frame_size: tuple[int, int] | None = None
    person: int = 0
    source: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)
    depth: np.ndarray | None = None

    def __post_init__(self) -> None:
        points = _single(self.keypoints)
        joints = len(skeleton(self.skeleton).joints)
        depth = None if self.depth is None else _single(self.depth)
        given = f"scores {np.shape(self.scores)} and times {np.shape(self.times)}"
        wrong = ""
        if points.ndim != 3 or points.shape[1:] not in ((joints, 2), (joints, 3)):
            wrong = f"keypoints have shape {points.shape}, {self.skeleton} needs (T, {joints}, 2 or 3)"
        elif np.shape(self.scores) != points.shape[:2] or np.shape(self.times) != points.shape[:1]:
            wrong = f"{given} do not fit {len(points)} frames of {joints} joints"
        elif depth is not None and (depth.shape != points.shape[:2] or points.shape[2] == 3):
            wrong = f"depth {depth.shape} does not fit keypoints of shape {points.shape}"
        if wrong:
            raise KeypointError(wrong, subject=self.source, code="E_KEYPOINTS_SHAPE")
        if np.isinf(points).any() or (depth is not None and np.isinf(depth).any()):
            raise KeypointError("a coordinate is infinite", subject=self.source, code="E_KEYPOINTS_VALUE")
        times = _seconds(self.times, KeypointError, self.source, "E_KEYPOINTS_TIMES")
        missing = np.isnan(points).any(axis=2)
        points = np.where(missing[..., None], np.float32(np.nan), points)
        scores = np.where(missing, 0, np.nan_to_num(_filled(self.scores), nan=0.0, posinf=1.0))
        object.__setattr__(self, "keypoints", _frozen(points, np.float32))
        object.__setattr__(self, "scores", _frozen(np.clip(scores, 0, 1), np.float32))
        object.__setattr__(self, "times", _frozen(times, np.float64))
        if depth is not None:
            object.__setattr__(self, "depth", _frozen(np.where(missing, np.nan, depth), np.float32))

    def __len__(self) -> int:
        return len(self.times)

    def part(self, frames: slice | np.ndarray) -> PoseSequence:
        """The same sequence, of these frames alone."""
        depth = None if self.depth is None else self.depth[frames]
        points, scores, times = self.keypoints[frames], self.scores[frames], self.times[frames]
        return replace(self, keypoints=points, scores=scores, times=times, depth=depth)

    def __repr__(self) -> str:
        span = self.times[-1] - self.times[0] if len(self) else 0.0
        return f"PoseSequence({self.source!r}, {len(self)} frames of {self.skeleton}, {span:.2f} s)"

    @property
    def seen(self) -> np.ndarray:
        """(T, J) bool: the joint was found in the frame."""
        return np.asarray(~np.isnan(self.keypoints[..., 0]))

    @property
    def frames_with_pose(self) -> int:
        """Number of frames in which any joint was found."""
        return int(self.seen.any(axis=1).sum())

    @property
    def box(self) -> tuple[float, ...]:
        """Left, top, right and bottom of all joints in all frames, inside the frame; empty without any joint.

        Rounded to a thousandth of the longer side, as a row shows it.
        """
        points = self.keypoints[self.seen][:, :2]
        if not len(points):
            return ()
        if self.frame_size:
            points = np.clip(points, 0, np.array(self.frame_size) - 1)
        edges = np.concatenate([points.min(axis=0), points.max(axis=0)]).astype(np.float64)
        digits = 3 - int(np.ceil(np.log10(max(float((edges[2:] - edges[:2]).max()), 1e-6))))
        return tuple(round(edge, max(digits, 0)) for edge in edges.tolist())

    @property
    def flat(self) -> PoseSequence:
        """The same sequence in the plane (itself where it already is)."""
        return self if self.keypoints.shape[2] == 2 else replace(self, keypoints=self.keypoints[..., :2])

    @property
    def solid(self) -> PoseSequence:
        """The same sequence with `depth` as its third coordinate (itself where it has no depth)."""
        if self.depth is None:
            return self
        points = np.concatenate([self.keypoints, self.depth[..., None]], axis=2)
        return replace(self, keypoints=points, depth=None)

    def onto(self, name: str) -> PoseSequence:
        """The same sequence in the skeleton called ``name`` (itself where it already is)."""
        if self.skeleton == name:
            return self
        own, target, depth = skeleton(self.skeleton), skeleton(name), self.depth
        points, scores = mapped(self.keypoints, self.scores, own, target)
        if depth is not None:
            depth = mapped(depth, self.scores, own, target)[0]
        made = {**self.provenance, "source_skeleton": self.skeleton}
        return replace(self, keypoints=points, scores=scores, skeleton=name, provenance=made, depth=depth)


@dataclass(frozen=True, eq=False)
class Signals:
    """The one-dimensional signals of one sequence, ready for warping.

    Attributes
    ----------
    values : (T, D) float32
        Finite everywhere; zero in channels that are not present.
    times : (T,) float64
        Seconds, never decreasing.
    channels : tuple of D str
        `right_wrist_x` and so on.
    mask : (D,) bool
        Channels that the selector found salient; all of them by default.
    present : (D,) bool
        Channels whose joint was seen. A pair is compared on
        ``(mask_query | mask_example) & present_query & present_example``.
    source : str
        The input, as the user named it.
    repaired : float
        Share of the frames in which a joint was wrong and repaired.
    apart : int
        Readings of channels that were left out, as far from all others.
    """

    values: np.ndarray
    times: np.ndarray
    channels: tuple[str, ...]
    mask: np.ndarray | None = None
    present: np.ndarray | None = None
    source: str = ""
    repaired: float = 0.0
    apart: int = 0

    def __post_init__(self) -> None:
        values, width = _single(self.values), len(self.channels)
        every = np.ones(width, bool)
        mask = every if self.mask is None else np.asarray(self.mask, bool)
        present = every if self.present is None else np.asarray(self.present, bool)
        wrong = ""
        if values.ndim != 2 or values.shape[1] != width or 0 in values.shape:
            wrong = f"signals have shape {values.shape}, expected (T, {width}) with T at least 1"
        elif np.shape(self.times) != (len(values),):
            wrong = f"{len(values)} frames but times of shape {np.shape(self.times)}"
        elif mask.shape != (width,) or present.shape != (width,):
            wrong = f"masks of shape {mask.shape} and {present.shape} for {width} channels"
        if wrong:
            raise SignalError(wrong, subject=self.source, code="E_SIGNAL_SHAPE")
        times = _seconds(self.times, SignalError, self.source, "E_SIGNAL_TIMES")
        values = np.where(present, values, 0)
        if not np.isfinite(values).all():
            bad = self.channels[int(np.argmin(np.isfinite(values).all(axis=0)))]
            raise SignalError(
                f"channel {bad} holds NaN or infinity",
                subject=self.source,
                remedy="a filter that fills gaps before this one",
                code="E_SIGNAL_VALUE",
            )
        object.__setattr__(self, "values", _frozen(values, np.float32))
        object.__setattr__(self, "times", _frozen(times, np.float64))
        object.__setattr__(self, "mask", _frozen(mask, bool))
        object.__setattr__(self, "present", _frozen(present, bool))

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        width, chosen = len(self.channels), len(self.selected)
        return f"Signals({self.source!r}, {len(self)} frames, {chosen} of {width} channels selected)"

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the salient channels."""
        assert self.mask is not None and self.present is not None
        return tuple(np.array(self.channels)[self.mask & self.present].tolist())


@dataclass(frozen=True, eq=False)
class SignalBatch:
    """Ragged series, padded to one array: what distance kernels take.

    Attributes
    ----------
    values : (B, T, D) float32 or float64
        Zero beyond each length; the dtype is the one that the kernel computes in.
    lengths : (B,) int64
        At least 1.
    masks : (B, D) bool
        Salient channels. A pair uses ``(masks_q | masks_e) & present_q & present_e``.
    present : (B, D) bool
        Channels that hold data.
    """

    values: np.ndarray
    lengths: np.ndarray
    masks: np.ndarray
    present: np.ndarray

    def __len__(self) -> int:
        return len(self.lengths)

    @classmethod
    def of(
        cls, series: Sequence[Signals | np.ndarray], dtype: type = np.float32, name: str = "series"
    ) -> SignalBatch:
        """Pad ``series`` to a batch.

        Parameters
        ----------
        series : sequence of Signals or (T,) or (T, D) arrays
            Every element with the same number of channels.
        dtype : numpy float type
        name : str
            What to call an element in an error message.

        Raises
        ------
        InputError
            Where there is no series, one is empty, the widths differ, or a value is masked, NaN or
            infinite; the message names the index.
        """
        if len(series) == 0:
            raise InputError(f"no {name}: at least one is needed", code="E_EMPTY")
        arrays = [_matrix(item, index, name) for index, item in enumerate(series)]
        width = arrays[0].shape[1]
        for index, array in enumerate(arrays):
            if array.shape[1] != width:
                raise InputError(
                    f"{name} {index} has {array.shape[1]} dimensions, {name} 0 has {width}",
                    code="E_DIMENSIONS",
                )
        lengths = np.array([*map(len, arrays)], np.int64)
        values: np.ndarray = np.zeros((len(arrays), int(lengths.max()), width), dtype)
        masks, present = np.ones((2, len(arrays), width), bool)
        for index, (item, array) in enumerate(zip(series, arrays, strict=True)):
            values[index, : len(array)] = array
            if isinstance(item, Signals):
                masks[index], present[index] = item.mask, item.present
        return cls(values, lengths, masks, present)


def _matrix(item: Signals | np.ndarray, index: int, name: str) -> np.ndarray:
    if np.ma.is_masked(item):
        raise InputError(
            f"{name} {index} has masked values", remedy="fill the gaps first", code="E_NOT_FINITE"
        )
    try:
        array = item.values if isinstance(item, Signals) else np.asarray(item)
    except (TypeError, ValueError, RuntimeError) as error:  # torch raises the last of these, JAX the first
        module = type(item).__module__.partition(".")[0]
        ways = {"torch": "tensor.detach().cpu().float()", "jax": "concrete arrays, outside of jit and grad"}
        remedy = ways.get(module)
        reason = f": {str(error).partition(chr(10))[0]}" if remedy else ""
        raise InputError(
            f"{name} {index} is no array of numbers{reason}",
            remedy=f"{remedy}, or soft_warping with its gradients" if remedy else "",
            code="E_DTYPE",
        ) from None
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or 0 in array.shape:
        found = f"has shape {array.shape}" if array.shape else f"is a {type(item).__name__}"
        raise InputError(
            f"{name} {index} {found}, expected (T,) or (T, D), not empty",
            code="E_EMPTY" if 0 in array.shape else "E_DIMENSIONS",
        )
    if not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise InputError(f"{name} {index} holds {array.dtype}, expected real numbers", code="E_DTYPE")
    if not np.isfinite(array).all():
        frame = int(np.argmin(np.isfinite(array).all(axis=1)))
        raise InputError(
            f"{name} {index} holds NaN or infinity at frame {frame}",
            remedy="fill the gaps first",
            code="E_NOT_FINITE",
        )
    return array


@dataclass(frozen=True, eq=False)
class Neighbors:
    """The nearest examples of each query, nearest first; ties go to the lower example index.

    Attributes
    ----------
    distances : (Q, k) float
    indices : (Q, k) int64
    """

    distances: np.ndarray
    indices: np.ndarray
