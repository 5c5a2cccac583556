"""What can be set: the sections with their defaults and bounds, and `Settings`, the frozen tree of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, cast

from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError
from gesture_core.plugin.reading import ReadOptions

DEFAULT_PRESET = "modern"
_INFINITE = float("inf")


class _Section:
    """Refuses a number outside its `BOUNDS`; None is always inside."""

    def __post_init__(self) -> None:
        for key, (low, high) in BOUNDS.items():
            section, _, name = key.partition(".")
            value = vars(self)[name] if SECTIONS[section] is type(self) else None
            if value is not None and not low <= value <= high:
                wanted = f"{low:g} to {high:g}" if high < _INFINITE else f"{low:g} or more"
                raise ConfigError(f"{key} = {value!r}", remedy=wanted, code="E_OPTION")


@dataclass(frozen=True)
class PoseSettings(_Section):
    """How people are found in pictures.

    Attributes
    ----------
    backend : str
        Name of a pose backend, or ``auto``: the first one that reads the network's file.
    model : str
        Name or file of a pose network, or ``auto``: ``blazepose`` where it is installed, otherwise
        ``compact``.
    provider : "auto", "cpu", "cuda", "tensorrt", "openvino", "coreml", "directml" or "openvino-bf16"
        What onnxruntime runs the network on; ``auto`` is the fastest that its installation has.
    target : "auto", "cpu", "cuda", "cuda-fp16", "opencl", "opencl-fp16" or "vulkan"
        What OpenCV runs the network on; ``auto`` is CUDA where it was built with it, otherwise the CPU.
    people : "single" or "multi"
        One person for each input, or one row for each track.
    height : int or None
        Height in pixels that a picture is scaled to, for networks that take any size; None leaves it
        to the network's contract.
    rate : None or float
        Frames of a video that are looked at in a second, at most, chosen by their time stamps; none or 0:
        every frame. All are decoded and counted.
    follow : bool or None
        Crop to the person and follow them; None lets the model decide.
    score : None or float
        Joints below this confidence are missing, of networks and of keypoint files that have
        scores; None leaves it to the network, and takes every joint of a keypoint file.
    reader : str
        Name of a video reader, or ``auto``: ``pyav`` where it is installed, otherwise ``opencv``.
    """

    backend: str = "auto"
    model: str = "auto"
    provider: Literal[
        "auto", "cpu", "cuda", "tensorrt", "openvino", "coreml", "directml", "openvino-bf16"
    ] = "auto"
    target: Literal["auto", "cpu", "cuda", "cuda-fp16", "opencl", "opencl-fp16", "vulkan"] = "auto"
    people: Literal["single", "multi"] = "single"
    height: int | None = None
    rate: float | None = 15.0
    follow: bool | None = None
    score: float | None = None
    reader: str = "auto"


@dataclass(frozen=True)
class VideoSettings(_Section):
    """How videos are read.

    Attributes
    ----------
    fps : None or float
        Frames per second of streams without times; None takes the rate that their codec says, or 25.
    retime : None or float
        Frames per second of every video, instead of the times in the file, for files whose times are wrong.
    pictures : bool
        Take each picture (JPEG, PNG) for an input of one frame, a posture; otherwise pictures are no inputs.
    """

    fps: float | None = None
    retime: float | None = None
    pictures: bool = False


@dataclass(frozen=True)
class SignalSettings(_Section):
    """The chain from keypoints to signals.

    Attributes
    ----------
    input : "keypoints" or "channels"
        What inputs and examples are: people, in videos and keypoint files; or the channels of sensors and
        other series, which have no joints, so that ``normalizer`` does nothing.
    repair : bool
        Take out joints that jump and come back, and exchange left and right where the frames before and
        after say that they are confused; of keypoints in two dimensions. Of channels: leave out readings that
        are far from all others, at most two in a row, as of a sensor that fails for a moment.
    max_gap : float
        Seconds of a missing joint that are interpolated; a joint with a longer gap inside keeps
        its nearest values only if it was seen in ``min_seen`` of the frames.
    min_seen : float
        Share of frames in which a joint must be seen to count as present.
    min_frames : int
        Frames with a pose, or samples of a sensor, that a sequence needs to be classified at all.
    normalizer : str
        Name of the plugin that puts coordinates into the body's own frame of reference.
    filters : tuple of str
        Names of the filter plugins, in order.
    selector : str
        Name of the plugin that chooses the channels that are compared.
    still : "refuse" or "posture"
        What a sequence is in which no channel is salient: refused (E_NO_SALIENT), or a posture
        that can only be matched by examples that are still too.
    """

    input: Literal["keypoints", "channels"] = "keypoints"
    repair: bool = False
    max_gap: float = 0.5
    min_seen: float = 0.5
    min_frames: int = 5
    normalizer: str = "shoulder"
    filters: tuple[str, ...] = ("gaussian", "center")
    selector: str = "variance"
    still: Literal["refuse", "posture"] = "refuse"


@dataclass(frozen=True)
class ClassifySettings(_Section):
    """The decision.

    Soft distances (`dtw.gamma`) may be negative, and take the classifier ``nearest`` alone, and none of
    `mirror`, `coverage` and `relative`.

    Attributes
    ----------
    kernel : str
        Name of a distance kernel, or ``auto``.
    classifier : str
        Name of a classifier. ``auto`` is ``nearest`` with `neighbors` of 1 or more, and ``blend`` with 0.
    neighbors : int
        Of ``nearest``: how many of the nearest examples vote. Of ``auto``: with 0, all examples decide, and
        the weight of each for each class is learned from the distances among them.
    sharpness : float
        Of ``weighed`` and ``blend``: a similarity is exp(-sharpness * d), where d is 1 for an example of
        another class at its usual distance.
    shrinkage : float
        Of ``weighed`` and ``blend``: penalty on the squared weights; more makes all examples more alike.
    landmarks : int
        Of any classifier but ``nearest``: of more examples than this, those that queries are compared with,
        spread evenly over each class. What they count for is learned from six times as many at most, spread
        in the same way. Neither depends on the order of the examples.
    reject : None or float
        Distances above this get no label.
    reject_sd : None or float
        Distances above the mean and this many standard deviations of those inside the class get no label;
        where ``reject`` is set too, the lower of the two counts.
    margin : None or float
        Labels with a smaller margin are rejected (E_UNSURE). The margin is the lead of the winner's
        distance with ``nearest``, otherwise of its score (0 to about 1).
    min_score : None or float
        Labels of a smaller score are rejected (E_REJECTED): what is like no example, or like several classes.
        About 0 for other classes and up to about 1 for the right one, less where examples are few
        (``gesture evaluate`` lists them); not of ``nearest``, whose scores are distances. Every row then has
        the score; 0 rejects next to none.
    confidence : None or float
        Labels that are right with a smaller probability than this are rejected (E_UNSURE), and every row has
        the probability; 0 rejects none. It is calibrated on the examples, each of which is decided by the
        others; some class needs two.
    representative : bool
        Keep only the medoid of each class as its example.
    min_pose : float
        Share of frames with a pose below which a sequence is rejected (E_POSE_SPARSE).
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
    balance : bool
        Divide what each group of channels costs by its variance over the examples, so that none counts more
        for its unit.
    weights : tuple of str
        What groups of channels count for, as ``acc=2`` or ``*.velocity=0.5``; 1 where none is given.
    """

    kernel: str = "auto"
    classifier: str = "auto"
    neighbors: int = 1
    sharpness: float = 3.0
    shrinkage: float = 0.1
    landmarks: int = 512
    reject: float | None = None
    reject_sd: float | None = None
    margin: float | None = None
    min_score: float | None = None
    confidence: float | None = None
    representative: bool = False
    min_pose: float = 0.25
    mirror: float | None = None
    coverage: bool = False
    separate: bool = False
    relative: float | None = None
    rest: float = 0.0
    balance: bool = False
    weights: tuple[str, ...] = ()

    @property
    def decides(self) -> str:
        """The classifier, where ``auto`` is none."""
        auto = "nearest" if self.neighbors else "blend"
        return auto if self.classifier == "auto" else self.classifier

    @property
    def votes(self) -> int:
        """How many neighbours vote; 0 where scores decide and not the nearest examples."""
        return max(1, self.neighbors) if self.decides == "nearest" else 0


@dataclass(frozen=True)
class SpotSettings(_Section):
    """How events are found in long recordings.

    Attributes
    ----------
    chain : tuple of str
        Filters instead of ``signals.filters``, where there are any: what tells a gesture from the next moment
        should depend on that moment alone.
    floor : float
        Added to the variances of example and event before they divide a cost, in the squared unit of
        the signals, so that a held gesture is not compared by its noise.
    tempos : tuple of float
        Lengths, as parts of its own, at which every example is looked for besides.
    threshold : None or float
        Distance up to which an event is reported; None takes one for each class from the examples.
    tolerance : float
        With ``threshold = none``: how far an event may be, as a share of the usual distance between examples
        of its class.
    overlap : float
        Share of the shorter of two events by which they may overlap.
    verify : bool
        Let the classifier decide about each event, too; where it says another label, there is none.
    patience : None or float
        Seconds after its end in which nothing better may come before an event is reported, besides what it
        lacks of the usual length of its gesture; None waits while one can come, live a quarter of a second.
    merge : float
        Seconds between two events of a held gesture that make them one.
    gap : float
        Seconds without the person after which a stream begins anew.
    live : bool
        Find in a recording what would have been found while it went on: nothing is known of later frames.
    """

    chain: tuple[str, ...] = ()
    floor: float = 0.01
    tempos: tuple[float, ...] = (0.6, 1.6)
    threshold: float | None = None
    tolerance: float = 0.9
    overlap: float = 0.3
    verify: bool = True
    patience: float | None = None
    merge: float = 1.0
    gap: float = 1.0
    live: bool = False


@dataclass(frozen=True)
class LimitSettings(_Section):
    """What one input may cost before it is given up.

    Attributes
    ----------
    pixels : int
        Most pixels of one frame.
    frames : int
        Most frames of one input.
    seconds : float
        Seconds without a sign of progress after which a worker process is ended.
    memory : int
        Most memory of one worker process, in MiB.
    cache : int
        Size of the keypoint store in MiB, beyond which a run deletes what was used longest ago; and of the
        previews that reports have made.
    """

    pixels: int = 64_000_000
    frames: int = 650_000
    seconds: float = 120.0
    memory: int = 4096
    cache: int = 10_240


_RANGES = {
    "pose.score signals.min_seen classify.confidence classify.min_pose classify.relative": (0, 1),
    "signals.max_gap classify.reject_sd classify.margin classify.rest": (0, _INFINITE),
    "classify.reject": (-_INFINITE, _INFINITE),
    "classify.mirror": (1, _INFINITE),
    "classify.neighbors limits.cache": (0, 1e9),
    "signals.min_frames classify.landmarks limits.frames": (1, 1e9),
    "classify.sharpness": (0.01, 100),
    "classify.shrinkage": (1e-6, 1e6),
    "video.fps video.retime": (0.001, 100_000),
    "pose.rate": (0, 100_000),
    "pose.height": (32, 4096),
    "spot.floor spot.threshold": (0, _INFINITE),
    "spot.overlap classify.min_score": (0, 1),
    "spot.tolerance": (0, 100),
    "spot.patience": (0, 3600),
    "spot.merge": (0, 60),
    "spot.gap": (0.05, 3600),
    "limits.pixels": (1, 1e12),
    "limits.memory": (64, 1e9),
    "limits.seconds": (0.1, _INFINITE),
}
BOUNDS = {name: bounds for names, bounds in _RANGES.items() for name in names.split()}
"""Least and greatest value of each number; `DtwSpec` and `ReadOptions` check those of their sections."""


@dataclass(frozen=True)
class Settings:
    """All settings of a run. Plugin options are in ``options[plugin][option]``.

    Examples
    --------
    >>> from gesture_core import load_settings
    >>> settings = load_settings("paper", ["neighbors=3"])
    >>> settings.classify.neighbors, settings.signals.filters
    (3, ('gaussian', 'center'))
    """

    preset: str = DEFAULT_PRESET
    video: VideoSettings = field(default_factory=VideoSettings)
    pose: PoseSettings = field(default_factory=PoseSettings)
    keypoints: ReadOptions = field(default_factory=ReadOptions)
    signals: SignalSettings = field(default_factory=SignalSettings)
    dtw: DtwSpec = field(default_factory=DtwSpec)
    classify: ClassifySettings = field(default_factory=ClassifySettings)
    spot: SpotSettings = field(default_factory=SpotSettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def plugins(self) -> list[tuple[str, str]]:
        """(kind, name) of every plugin that takes part between keypoints and label, in order.

        A name is that of the settings: ``gaussian:wide`` is a second ``gaussian``, whose options are those
        of ``[options."gaussian:wide"]``. The kernel is missing as long as it is ``auto``, or none is used.
        """
        chosen, kernel = self.signals, self.classify.kernel
        return [
            *([("normalizer", chosen.normalizer)] if chosen.input == "keypoints" else []),
            ("selector", chosen.selector),
            *(("filter", name) for name in dict.fromkeys([*chosen.filters, *self.spot.chain])),
            *([("kernel", kernel)] if kernel not in ("", "auto") else []),
            ("classifier", self.classify.decides),
        ]

    def as_dict(self) -> dict[str, Any]:
        """The tree as plain values, without the preset's name; a ConfigError for a band that is a mask."""
        if self.dtw.mask is not None:
            remedy = "dtw.window or dtw.shape; masks are for GestureClassifier and warping_distances"
            raise ConfigError("dtw.mask cannot be written down with a run", remedy=remedy, code="E_OPTION")
        tree: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        del tree["preset"]
        return tree

    def with_values(self, values: Iterable[tuple[str, Any]], origin: str = "--set") -> Settings:
        """The settings with pairs changed; a ConfigError names the key that is the nearest to an unknown one.

        Parameters
        ----------
        values : iterable of (str, object)
            A text is read by the type of its setting, or as a TOML value for the option of a plugin. A bare
            key such as ``window`` is accepted where only one section or plugin has it.
        origin : str
            Where the values were given, for errors.
        """
        from gesture_core.settings.load import changed  # which reads text; here is only what there is

        return changed(self, values, origin)


SECTIONS: Mapping[str, type] = {one.name: cast(type, one.default_factory) for one in fields(Settings)[1:-1]}
"""The class of each section: all between the preset and the options."""
