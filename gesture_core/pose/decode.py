"""Keypoints from the raw outputs of a network, for each layout that networks come in.

Every decoder gives points in pixels of the network's input, counted from the centre of the first
pixel, for a whole batch at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.pose.contracts import ModelContract
from gesture_core.pose.fields import LIMBS, AssemblyRules, assemble
from gesture_core.pose.heatmaps import top_peaks
from gesture_core.pose.layouts import split_openpose
from gesture_core.skeletons import skeleton

PEAKS = 3
"""Of a heat map that are handed on: the third is the joint in 1 % of frames, further ones hardly ever."""


class Found(NamedTuple):
    """One person in pixels of the input.

    Attributes
    ----------
    points : (J, 2) array
        NaN where missing.
    scores : (J,) array
    peaks : (J, K, 3) array or None
        x, y and score of all places where each joint may be, the best first, NaN beyond the last; None
        where the network says only one.
    """

    points: np.ndarray
    scores: np.ndarray
    peaks: np.ndarray | None = None


def decode(
    outputs: Sequence[np.ndarray],
    contract: ModelContract,
    input_size: tuple[int, int],
    people: str,
    rules: AssemblyRules,
) -> list[list[Found]]:
    """The people in each picture of a batch, best first.

    Parameters
    ----------
    outputs : sequence of arrays
        As the network gave them.
    contract : ModelContract
    input_size : (height, width)
        Of the input that was fed.
    people : "single" or "multi"
        The best peak of every joint as one person, or everybody that the network tells apart.
    rules : AssemblyRules

    Raises
    ------
    PoseError
        ``E_POSE_PEOPLE`` where the network cannot tell people apart.
    """
    decoder = _DECODERS[contract.layout]
    return decoder([np.asarray(out, np.float32) for out in outputs], contract, input_size, people, rules)


def _openpose(
    outputs: list[np.ndarray],
    contract: ModelContract,
    input_size: tuple[int, int],
    people: str,
    rules: AssemblyRules,
) -> list[list[Found]]:
    at, apart = split_openpose([out.shape for out in outputs], contract.skeleton)
    joints = len(skeleton(contract.skeleton).joints)
    maps = outputs[at][:, :joints]
    # A cell covers `step` input pixels; cell and pixel coordinates both count from a centre.
    step = np.array([input_size[1] / maps.shape[3], input_size[0] / maps.shape[2]], np.float32)
    if people == "single":
        # Half as high as a joint must be: such a peak counts where time and body speak for it.
        peaks = top_peaks(maps, PEAKS, 0.5 * rules.peak)
        peaks[..., :2] = (peaks[..., :2] + 0.5) * step - 0.5
        return [[Found(one[:, 0, :2], one[:, 0, 2], one)] for one in peaks]
    wide = 2 * len(LIMBS[contract.skeleton])
    fields = outputs[apart] if apart is not None else outputs[at][:, joints + 1 :]
    if fields.shape[1] != wide:
        raise _cannot_tell_apart("it has no part-affinity fields")
    return [
        [Found((points + 0.5) * step - 0.5, scores) for points, scores in picture]
        for picture in assemble(maps, fields, contract.skeleton, rules)
    ]


def _movenet(
    outputs: list[np.ndarray],
    contract: ModelContract,
    input_size: tuple[int, int],
    people: str,
    rules: AssemblyRules,
) -> list[list[Found]]:
    """(N, 1, 17, 3): y, x as fractions of the input, and the score (MoveNet, Google 2021)."""
    if people != "single":
        raise _cannot_tell_apart("MoveNet SinglePose finds one person")
    rows = outputs[0][:, 0]
    size = np.array(input_size[::-1], np.float32)
    points = rows[..., 1::-1] * size - 0.5
    return [[Found(*one)] for one in zip(points, np.clip(rows[..., 2], 0, 1), strict=True)]


def _simcc(
    outputs: list[np.ndarray],
    contract: ModelContract,
    input_size: tuple[int, int],
    people: str,
    rules: AssemblyRules,
) -> list[list[Found]]:
    """Two (N, J, bins) classifications of x and of y (Li et al. 2022, SimCC; Jiang et al. 2023, RTMPose)."""
    if people != "single":
        raise _cannot_tell_apart("a SimCC network finds one person in its crop")
    high, wide = input_size
    # The two outputs have the same form; the bins of x are as many times the width as those of y
    # are of the height.
    one, two = outputs
    x, y = (one, two) if one.shape[2] * high == two.shape[2] * wide else (two, one)
    if x.shape[2] * high != y.shape[2] * wide:
        x, y = one, two
    points = np.stack([x.argmax(2) * (wide / x.shape[2]), y.argmax(2) * (high / y.shape[2])], axis=-1)
    scores = np.clip(np.minimum(x.max(2), y.max(2)), 0, 1)
    return [[Found(*one)] for one in zip(points.astype(np.float32), scores, strict=True)]


def _yolo_pose(
    outputs: list[np.ndarray],
    contract: ModelContract,
    input_size: tuple[int, int],
    people: str,
    rules: AssemblyRules,
) -> list[list[Found]]:
    """(N, 56, M): M boxes of centre, size, score and 17 times x, y, score (Maji et al. 2022, YOLO-Pose)."""
    rows = outputs[0] if outputs[0].shape[1] == 56 else outputs[0].transpose(0, 2, 1)
    return [_boxes(picture.T, people, rules) for picture in rows]


def _boxes(rows: np.ndarray, people: str, rules: AssemblyRules) -> list[Found]:
    rows = rows[rows[:, 4] >= rules.mean_score]
    rows = rows[np.argsort(-rows[:, 4], kind="stable")]
    kept: list[np.ndarray] = []
    for row in rows:
        if all(_overlap(row, other) < 0.65 for other in kept):
            kept.append(row)
        if people == "single" and kept:
            break
    found = []
    for row in kept:
        joints = row[5:].reshape(17, 3)
        found.append(Found(joints[:, :2] - 0.5, np.clip(joints[:, 2], 0, 1)))
    return found


def _overlap(one: np.ndarray, two: np.ndarray) -> float:
    """Intersection over union of two boxes given by centre and size."""
    low = np.maximum(one[:2] - one[2:4] / 2, two[:2] - two[2:4] / 2)
    high = np.minimum(one[:2] + one[2:4] / 2, two[:2] + two[2:4] / 2)
    both = float(np.prod(np.maximum(high - low, 0)))
    return both / max(float(np.prod(one[2:4]) + np.prod(two[2:4])) - both, 1e-9)


def _cannot_tell_apart(cause: str) -> PoseError:
    return PoseError(
        f"this network cannot tell people apart: {cause}",
        remedy="pose.people = 'single', or --model with a network that can, such as hpe0001 or YOLO-pose: "
        "'gesture models' says where they are",
        code="E_POSE_PEOPLE",
    )


_Decoder = Callable[[list[np.ndarray], ModelContract, tuple[int, int], str, AssemblyRules], list[list[Found]]]
_DECODERS: dict[str, _Decoder] = {
    "openpose": _openpose,
    "movenet": _movenet,
    "simcc": _simcc,
    "yolo-pose": _yolo_pose,
}
