"""The sections of the settings: what each setting means, and its default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError

_INFINITE = float("inf")


def _within(section: str, owner: object, bounds: dict[str, tuple[float, float]]) -> None:
    """A ConfigError for the first number of ``owner`` outside its bounds; None is always inside."""
    for name, (low, high) in bounds.items():
        value = getattr(owner, name)
        if value is not None and not low <= value <= high:
            wanted = f"{low:g} to {high:g}" if high < _INFINITE else f"{low:g} or more"
            raise ConfigError(f"{section}.{name} = {value!r}", remedy=wanted, code="E_OPTION")


@dataclass(frozen=True)
class PoseSettings:
    """How people are found in pictures.

    Attributes
    ----------
    backend : str
        Name of a pose backend.
    model : str
        Name or file of a pose network.
    people : "single" or "multi"
        One person for each input, or one row for each track.
    height : int or None
        Height in pixels that a picture is scaled to, for networks that take any size; None leaves it
        to the network's contract.
    follow : bool or None
        Crop to the person and follow them; None lets the model decide.
    score : None or float
        Joints below this confidence are missing, of networks and of keypoint files that have
        scores; None leaves it to the network, and takes every joint of a keypoint file.
    reader : str
        Video reader: ``auto``, ``pyav`` or ``opencv``.
    fps : float
        Frames per second of keypoint files that carry no times.
    """

    backend: str = "onnx"
    model: str = "compact"
    people: Literal["single", "multi"] = "single"
    height: int | None = None
    follow: bool | None = None
    score: float | None = None
    reader: str = "auto"
    fps: float = 30.0

    def __post_init__(self) -> None:
        _within("pose", self, {"height": (32, 4096), "score": (0, 1), "fps": (0.001, 100_000)})


@dataclass(frozen=True)
class SignalSettings:
    """The chain from keypoints to signals.

    Attributes
    ----------
    max_gap : float
        Seconds of a missing joint that are interpolated; a joint with a longer gap inside keeps
        its nearest values only if it was seen in ``min_seen`` of the frames.
    min_seen : float
        Share of frames in which a joint must be seen to count as present.
    min_frames : int
        Frames with a pose that a sequence needs to be classified at all.
    normalizer, selector : str
        Names of plugins.
    filters : tuple of str
        Names of filter plugins in order.
    still : "refuse" or "posture"
        What a sequence is in which no channel is salient: refused (E_NO_SALIENT), or a posture
        that can only be matched by examples that are still too.
    """

    max_gap: float = 0.5
    min_seen: float = 0.5
    min_frames: int = 5
    normalizer: str = "shoulder"
    filters: tuple[str, ...] = ("gaussian", "center")
    selector: str = "variance"
    still: Literal["refuse", "posture"] = "refuse"

    def __post_init__(self) -> None:
        _within("signals", self, {"max_gap": (0, _INFINITE), "min_seen": (0, 1), "min_frames": (1, 1e9)})


@dataclass(frozen=True)
class ClassifySettings:
    """The decision.

    Soft distances (`dtw.gamma`) may be negative, and take none of ``neighbors = 0``, `mirror`, `coverage`
    and `relative`.

    Attributes
    ----------
    kernel : str
        Name of a distance kernel, or ``auto``.
    neighbors : int
        k of the k-nearest-neighbour vote. 0: all examples decide, and how much each of them counts for
        each class is learned from the distances among them (`gesture_core.classify.learning`).
    sharpness : float
        With ``neighbors = 0``: a similarity is exp(-sharpness * d), where d is 1 for an example of
        another class at its usual distance.
    shrinkage : float
        With ``neighbors = 0``: penalty on the squared weights; more makes all examples more alike.
    reject : None or float
        Distances above this get no label.
    reject_sd : None or float
        As well: threshold of each class = mean + this many standard deviations of the distances
        inside the class. The lower of the two counts.
    margin : None or float
        Labels with a smaller margin are rejected (E_UNSURE). The margin is the lead of the winner's
        score where all examples decide (0 to about 1), otherwise of its distance.
    representative : bool
        Keep only the medoid of each class as its example.
    min_pose : float
        Share of frames with a pose below which a sequence is an error (E_POSE_SPARSE).
    mirror : None or float
        Every example also stands for the same movement made with the other hand; the distance to
        that reading is multiplied by this factor, 1 or more.
    coverage : bool
        Divide a distance by the share of channels that both sequences have; with `relative`, by the
        share of their sizes that lies in these channels.
    separate : bool
        One warping for each body part instead of one for all channels, in dependent mode; the
        distance is their sum, so that legs need not keep the hands' time.
    relative : None or float
        Power, 0 to 1, to which the sizes of the two sequences (their geometric mean) divide a
        distance; at 1 a large movement is no farther from everything than a small one.
    rest : float
        With `relative`: size that every frame has even where nothing moves.
    """

    kernel: str = "auto"
    neighbors: int = 1
    sharpness: float = 3.0
    shrinkage: float = 0.1
    reject: float | None = None
    reject_sd: float | None = None
    margin: float | None = None
    representative: bool = False
    min_pose: float = 0.25
    mirror: float | None = None
    coverage: bool = False
    separate: bool = False
    relative: float | None = None
    rest: float = 0.0

    def __post_init__(self) -> None:
        bounds = {"neighbors": (0, 1e9), "sharpness": (0.01, 100), "shrinkage": (1e-6, 1e6)}
        bounds |= {"reject": (-_INFINITE, _INFINITE), "reject_sd": (0, _INFINITE), "margin": (0, _INFINITE)}
        bounds |= {"min_pose": (0, 1), "mirror": (1, _INFINITE), "relative": (0, 1), "rest": (0, _INFINITE)}
        _within("classify", self, bounds)


@dataclass(frozen=True)
class LimitSettings:
    """What one input may cost before it is given up.

    Attributes
    ----------
    pixels : int
        Of one frame.
    frames : int
        Of one input.
    seconds : float
        Without a sign of progress from the worker, before it is ended.
    memory : int
        MiB of one worker process.
    cache : int
        MiB of the keypoint store, beyond which a run deletes what was used longest ago.
    """

    pixels: int = 64_000_000
    frames: int = 200_000
    seconds: float = 120.0
    memory: int = 4096
    cache: int = 10_240

    def __post_init__(self) -> None:
        bounds = {"pixels": (1, 1e12), "frames": (1, 1e9), "seconds": (0.1, _INFINITE)}
        _within("limits", self, {**bounds, "memory": (64, 1e9), "cache": (0, 1e9)})


SECTIONS: dict[str, type] = {
    "pose": PoseSettings,
    "signals": SignalSettings,
    "dtw": DtwSpec,
    "classify": ClassifySettings,
    "limits": LimitSettings,
}
