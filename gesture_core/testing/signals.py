"""The suites of normalizers, filters and dimension selectors: the steps from keypoints to signals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gesture_core.demo.figure import GESTURES, Style, joints, random_body
from gesture_core.errors import SignalError
from gesture_core.joints import group_of
from gesture_core.plugin.abilities import NeedsDepth, WholeBody
from gesture_core.plugin.interfaces import Filter, Normalizer, Selector
from gesture_core.signals.chain import CHANNELS, channels_of
from gesture_core.signals.mirror import mirrored
from gesture_core.skeletons import COCO18, HANDS42, skeleton
from gesture_core.testing.answers import ask, ask_or_refuse, check_memory
from gesture_core.types import PoseSequence, Signals

_SIZE = (640, 480)
_RATE = 20.0
_WHOLE = channels_of("coco18+hands+face")


def draw_pose(seed: int = 0, gesture: str = "wave", frames: int = 40) -> PoseSequence:
    """A drawn person of whom every joint is seen in every frame, at 20 frames a second."""
    rng = np.random.default_rng(seed)
    points = joints(random_body(rng, _SIZE), *GESTURES[gesture](Style(frames)), rng)
    return _pose(points)


def draw_signals(seed: int = 0, frames: int = 40, channels: Sequence[str] = CHANNELS) -> Signals:
    """Random walks of all joints in body units, every channel salient and present, times not quite even."""
    rng = np.random.default_rng(seed)
    walks = np.cumsum(rng.normal(scale=0.1, size=(frames, len(channels))), axis=0)
    times = (np.arange(frames) + rng.uniform(0, 0.2, frames)) / _RATE
    return Signals(walks + rng.normal(size=len(channels)), times, tuple(channels), source="drawn")


def _pose(points: np.ndarray, name: str = COCO18.name) -> PoseSequence:
    scores, times = np.ones(points.shape[:2]), np.arange(len(points)) / _RATE
    return PoseSequence(points, scores, times, name, frame_size=_SIZE, source="drawn")


def draw_whole(name: str, seed: int = 0, gesture: str = "wave", frames: int = 40) -> PoseSequence:
    """`draw_pose` in the skeleton ``name``: hands hang on the wrists, their fingers spread and closing."""
    body = draw_pose(seed, gesture, frames)
    if name == COCO18.name:
        return body
    pose, rng = body.onto(name), np.random.default_rng(seed)
    points, at = pose.keypoints.copy(), {joint: n for n, joint in enumerate(skeleton(name).joints)}
    closing = 1 - 0.4 * np.sin(np.arange(frames) / 6)[:, None] ** 2
    for joint, place in at.items():
        side = joint.partition("_")[0]
        if joint in HANDS42.joints:
            number = HANDS42.joints.index(joint) % 21
            finger, knuckle = divmod(number - 1, 4)
            way = np.array([finger - 2.0, -3.0 - knuckle]) * (rng.uniform(2, 3) if number else 0)
            turn = np.array([1 if side == "left" else -1, 1])
            points[:, place] = points[:, at[f"{side}_wrist"]] + way * turn * closing
        elif group_of(joint) == "face":
            eye = points[:, at[f"{side}_eye" if side in ("left", "right") else "nose"]]
            points[:, place] = eye + rng.uniform(-4, 4, 2) * closing
    return _pose(points, name)


def _skeleton_of(normalizer: Normalizer) -> str:
    return normalizer.skeleton if isinstance(normalizer, WholeBody) else COCO18.name


def _with_gaps(pose: PoseSequence) -> PoseSequence:
    """``pose`` with an ear never seen, a wrist lost for three frames, and one frame without anybody."""
    points = pose.keypoints.copy()
    points[:, COCO18.index("left_ear")] = np.nan
    points[3:6, COCO18.index("right_wrist")] = np.nan
    points[20] = np.nan
    return _pose(points, pose.skeleton)


def check_normalizer_shape(normalizer: Normalizer) -> None:
    """(T, 18, 2) real coordinates, or as many joints as it asks for, finite where the body is seen well."""
    name = type(normalizer).__name__
    assert isinstance(normalizer, Normalizer), f"{name} has no method normalize"
    points = _coordinates(normalizer, draw_whole(_skeleton_of(normalizer)))
    assert points.dtype.kind == "f", f"{name}.normalize returns an array of {points.dtype}, expected floats"
    assert np.isfinite(points).mean() > 0.5, f"{name}.normalize finds no place for joints that are all seen"


def check_normalizer_missing(normalizer: Normalizer) -> None:
    """NaN stays NaN, and what is not known is NaN, never infinite."""
    name, pose = type(normalizer).__name__, _with_gaps(draw_whole(_skeleton_of(normalizer)))
    points = _coordinates(normalizer, pose)
    assert not np.isinf(points).any(), f"{name}.normalize returns infinity; what is not known is NaN"
    assert np.isnan(points[~pose.seen]).all(), (
        f"{name}.normalize gives coordinates to a joint that was not seen; NaN stays NaN"
    )
    assert np.isfinite(points[pose.seen]).any(), f"{name}.normalize loses everything where a joint is lost"


def check_normalizer_units(normalizer: Normalizer) -> None:
    """Body units: where the person stands and how large they are in the picture changes nothing."""
    pose = draw_whole(_skeleton_of(normalizer))
    nearer = _pose(pose.keypoints * 1.7 + np.array([90, 30]), pose.skeleton)
    assert _near(_coordinates(normalizer, pose), _coordinates(normalizer, nearer)), (
        f"{type(normalizer).__name__}.normalize gives other coordinates where the same person stands nearer "
        "to the camera and to the side; they are in the body's units and seen from the body's origin"
    )


def check_normalizer_mirror(normalizer: Normalizer) -> None:
    """The origin is on the body's middle line, so that a mirrored person has mirrored coordinates."""
    pose = draw_whole(_skeleton_of(normalizer), 1, "swipe")
    order = list(skeleton(pose.skeleton).mirror)
    turned = _pose((pose.keypoints * (-1, 1) + (_SIZE[0], 0))[:, order], pose.skeleton)
    wanted = _coordinates(normalizer, pose)[:, order]
    wanted = wanted * (-1, 1, 1)[: wanted.shape[2]]
    assert _near(_coordinates(normalizer, turned), wanted), (
        f"{type(normalizer).__name__}.normalize of a mirrored person is not the mirrored answer; its origin "
        "must be on the body's middle line, and left and right must be treated alike"
    )


def check_normalizer_memory(normalizer: Normalizer) -> None:
    """The same person gives the same bits, whatever came in between; what is passed in stays as it is."""
    name = _skeleton_of(normalizer)
    drawn = draw_whole(name), draw_whole(name, 2, "flap", 25)
    one, other = (_lifted(normalizer, pose) for pose in drawn)
    check_memory(normalizer.normalize, one, other)


def check_normalizer_short(normalizer: Normalizer) -> None:
    """One frame, none, nobody, or a body without a size: coordinates or a GestureError, never infinity."""
    name, whole = type(normalizer).__name__, draw_whole(_skeleton_of(normalizer))
    points = whole.keypoints
    for what, odd in (
        ("one frame", points[:1]),
        ("no frame", points[:0]),
        ("nobody in any frame", np.full_like(points, np.nan)),
        ("all joints in one place", np.full_like(points, 100.0)),
    ):
        with np.errstate(all="ignore"):
            odd_pose = _lifted(normalizer, _pose(odd, whole.skeleton))
            found = ask_or_refuse(what, normalizer.normalize, odd_pose)
        if found is not None:
            assert np.shape(found) == odd_pose.keypoints.shape, (
                f"{name}.normalize of {what}: shape {np.shape(found)}"
            )
            assert not np.isinf(found).any(), f"{name}.normalize of {what} is infinite; NaN or a PoseError"


def _coordinates(normalizer: Normalizer, pose: PoseSequence) -> np.ndarray:
    """What ``normalizer`` makes of ``pose``, of the right shape."""
    pose = _lifted(normalizer, pose)
    name, wanted = (
        type(normalizer).__name__,
        (len(pose), len(skeleton(pose.skeleton).joints), pose.keypoints.shape[2]),
    )
    points = np.asarray(ask(normalizer.normalize, pose))
    assert points.shape == wanted, (
        f"{name}.normalize returns the shape {points.shape}, expected (T, J, {wanted[2]}): {wanted}"
    )
    return points


def _lifted(normalizer: Normalizer, pose: PoseSequence) -> PoseSequence:
    """``pose``, with a depth of zero for a normalizer that needs one."""
    if not isinstance(normalizer, NeedsDepth):
        return pose
    flat = np.zeros((*pose.keypoints.shape[:2], 1), np.float32)
    return replace(pose, keypoints=np.concatenate([pose.keypoints, flat], axis=2))


def _near(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether coordinates are the same but for the rounding of pixels to float32."""
    return np.allclose(one, other, atol=1e-3, equal_nan=True)


NORMALIZER_CHECKS: tuple[Callable[[Normalizer], None], ...] = (
    check_normalizer_shape,
    check_normalizer_missing,
    check_normalizer_units,
    check_normalizer_mirror,
    check_normalizer_memory,
    check_normalizer_short,
)
"""The suite of normalizers."""


def check_filter_answer(step: Filter) -> None:
    """Signals with channel names of their own, the source as it was, times within those of the input."""
    name, signals = type(step).__name__, draw_signals(channels=_WHOLE)
    assert isinstance(step, Filter), f"{name} has no method apply"
    found = _applied(step, signals)
    twice = {channel for channel in found.channels if found.channels.count(channel) > 1}
    assert not twice, f"{name}.apply gives several channels the name {sorted(twice)[0]!r}"
    assert found.source == signals.source, f"{name}.apply loses the source; use dataclasses.replace"
    assert signals.times[0] - 1e-6 <= found.times[0] <= found.times[-1] <= signals.times[-1] + 1e-6, (
        f"{name}.apply returns times outside those of its input"
    )


def check_filter_masks(step: Filter) -> None:
    """A channel is salient, or present, where what it is made of is."""
    name, signals = type(step).__name__, draw_signals(channels=_WHOLE)
    width = len(signals.channels)
    nothing, everything = np.zeros(width, bool), np.ones(width, bool)
    for given, field, wanted in (
        (replace(signals, mask=nothing), "mask", False),
        (replace(signals, present=nothing), "present", False),
        (replace(signals, mask=everything), "mask", True),
        (replace(signals, present=everything), "present", True),
    ):
        found = _applied(step, given)
        flags = np.asarray(found.mask if field == "mask" else found.present)
        assert (flags == wanted).all(), (
            f"{name}.apply: {field} of {found.channels[int((flags != wanted).argmax())]} is {not wanted} "
            f"where it is {wanted} for every channel of the input; a new channel takes both masks from what "
            "it is made of"
        )
    alternate = np.repeat(np.arange(width // 2) % 2 == 0, 2)  # x and y of a joint alike
    given = replace(signals, mask=alternate, present=np.roll(alternate, 2) | (np.arange(width) < width // 2))
    before, after = _flags(given), _flags(_applied(step, given))
    for channel in before.keys() & after.keys():
        assert after[channel] == before[channel], (
            f"{name}.apply: mask and present of {channel} are not those of the input; a channel that moves "
            "to another place takes both along"
        )


def _flags(signals: Signals) -> dict[str, tuple[bool, bool]]:
    """Whether each channel is salient, and whether it is present."""
    assert signals.mask is not None and signals.present is not None
    both = zip(signals.mask.tolist(), signals.present.tolist(), strict=True)
    return dict(zip(signals.channels, both, strict=True))


def check_filter_sides(step: Filter) -> None:
    """Names tell the side and the direction: the filtered mirror image is the mirrored result."""
    name, signals = type(step).__name__, draw_signals(3, channels=_WHOLE)
    try:
        wanted = mirrored(_applied(step, signals))
    except SignalError:  # one side alone has no mirror image, and is refused where one is wanted
        return
    got = _applied(step, mirrored(signals))
    assert got.channels == wanted.channels, f"{name}.apply names other channels for a mirrored input"
    wrong = ~np.isclose(got.values, wanted.values, rtol=1e-3, atol=1e-4).all(axis=0)
    assert not wrong.any(), (
        f"{name}.apply: {got.channels[int(wrong.argmax())]} of a mirrored input is not the mirror image; "
        "left_ and right_ in front change places, and what ends in _x (before a . or @) turns round"
    )


def check_filter_memory(step: Filter) -> None:
    """The same signals give the same bits, whatever came in between; what is passed in stays as it is."""
    check_memory(step.apply, draw_signals(channels=_WHOLE), draw_signals(4, 25, _WHOLE))


def check_filter_short(step: Filter) -> None:
    """One frame, equal times, no motion, or channels that it does not know: Signals or a GestureError."""
    name, signals = type(step).__name__, draw_signals(channels=_WHOLE)
    for what, given in (
        ("one frame", replace(signals, values=signals.values[:1], times=signals.times[:1])),
        ("two frames", replace(signals, values=signals.values[:2], times=signals.times[:2])),
        ("frames of one time", replace(signals, times=np.zeros(len(signals)))),
        ("signals that do not move", replace(signals, values=np.ones_like(signals.values))),
        ("other channels", Signals(signals.values[:, :2], signals.times, ("left_hand.open", "speed"))),
    ):
        found = ask_or_refuse(what, step.apply, given)
        assert found is None or isinstance(found, Signals), f"{name}.apply of {what} returns no Signals"


def _applied(step: Filter, signals: Signals) -> Signals:
    """What ``step`` makes of ``signals``, if these are signals."""
    found = ask(step.apply, signals)
    assert isinstance(found, Signals), (
        f"{type(step).__name__}.apply returns {type(found).__name__}, expected Signals"
    )
    return found


FILTER_CHECKS: tuple[Callable[[Filter], None], ...] = (
    check_filter_answer,
    check_filter_masks,
    check_filter_sides,
    check_filter_memory,
    check_filter_short,
)
"""The suite of filters."""


def check_selector_answer(selector: Selector) -> None:
    """(D,) bool, with something chosen where everything moves."""
    name = type(selector).__name__
    assert isinstance(selector, Selector), f"{name} has no method select"
    for frames in (40, 200):
        signals = draw_signals(frames=frames)
        mask = ask(selector.select, signals)
        assert isinstance(mask, np.ndarray) and mask.dtype == bool, (
            f"{name}.select returns no array of bool, but {getattr(mask, 'dtype', type(mask).__name__)}"
        )
        assert mask.shape == (len(signals.channels),), (
            f"{name}.select returns the shape {mask.shape}, expected (D,): ({len(signals.channels)},)"
        )
        assert mask.any(), f"{name}.select chooses nothing where every channel moves by body lengths"


def check_selector_memory(selector: Selector) -> None:
    """The same signals give the same bits, whatever came in between; what is passed in stays as it is."""
    check_memory(selector.select, draw_signals(), draw_signals(4, 25))


def check_selector_short(selector: Selector) -> None:
    """One frame, no motion, or nothing present: a mask or a GestureError."""
    name, signals = type(selector).__name__, draw_signals()
    nothing = np.zeros(len(signals.channels), bool)
    for what, given in (
        ("one frame", replace(signals, values=signals.values[:1], times=signals.times[:1])),
        ("frames of one time", replace(signals, times=np.zeros(len(signals)))),
        ("signals that do not move", replace(signals, values=np.ones_like(signals.values))),
        ("signals of which nothing is present", replace(signals, present=nothing)),
    ):
        mask = ask_or_refuse(what, selector.select, given)
        assert mask is None or np.shape(mask) == nothing.shape, (
            f"{name}.select of {what} returns the shape {np.shape(mask)}, expected {nothing.shape}"
        )


SELECTOR_CHECKS: tuple[Callable[[Selector], None], ...] = (
    check_selector_answer,
    check_selector_memory,
    check_selector_short,
)
"""The suite of dimension selectors."""
