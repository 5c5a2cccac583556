"""Registers the built-in normalizers, filters and selectors."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_normalizers(register: Register) -> None:
    register(
        "shoulder",
        "gesture_signals.normalizers:ShoulderNormalizer",
        summary="neck at the origin, shoulder distance 1, frame by frame (the paper)",
    )
    register(
        "torso",
        "gesture_signals.normalizers:TorsoNormalizer",
        summary="neck at the origin, scale from the running median of the neck-to-hip distance",
    )
    register(
        "upright",
        "gesture_signals.normalizers:UprightNormalizer",
        summary="torso, after turning the body upright: a camera's roll does not matter",
    )
    register(
        "hands",
        "gesture_signals.hands:HandsNormalizer",
        summary="torso for the body; hands at their wrists by the palm, a face at its eyes",
    )
    register(
        "view",
        "gesture_signals.normalizers:ViewNormalizer",
        summary="torso in its own three axes: a turn of the body does not matter",
    )


@hookimpl
def register_filters(register: Register) -> None:
    register("center", "gesture_signals.filters:Center", summary="subtract each channel's mean")
    register(
        "channels",
        "gesture_signals.channels:Channels",
        summary="values, velocities and energies of the channels of sensors, scaled or not",
    )
    register("gaussian", "gesture_signals.filters:Gaussian", summary="Gaussian smoothing over frames")
    register(
        "parts",
        "gesture_signals.parts:Parts",
        summary="weighted vectors, directions, velocities and energies of joints and limbs",
    )
    register("resample", "gesture_signals.filters:Resample", summary="a common frame rate")
    register("median", "gesture_signals.filters:Median", summary="running median over frames")
    register(
        "shape",
        "gesture_signals.filters:Shape",
        summary="each frame with its neighbours (shapeDTW: Zhao and Itti 2018)",
    )


@hookimpl
def register_selectors(register: Register) -> None:
    register("all", "gesture_signals.selectors:AllChannels", summary="every channel")
    register(
        "moving",
        "gesture_signals.selectors:Moving",
        summary="every channel, unless the person stands still",
    )
    register(
        "variance",
        "gesture_signals.selectors:VarianceThreshold",
        summary="channels whose median-filtered variance exceeds t_var (the paper)",
    )
