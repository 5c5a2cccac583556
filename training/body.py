"""Random people in random poses: `anny` bodies (code Apache-2.0, mesh CC0), posed by reaching.

Axes of the body: x to its left, y backwards, z up, metres. A hand is given a place to reach and the
elbow a side to swing to; two-bone inverse kinematics turns that into rotations. That covers the
space in which people gesture better than random joint angles do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .joints import COUNT, FROM_COCO17, HIPS, KNEES, NECK, SHOULDERS

SIDES = {"L": 1.0, "R": -1.0}


@dataclass
class People:
    """A batch of posed bodies.

    Attributes
    ----------
    vertices : (B, V, 3) posed, metres
    rest : (B, V, 3) the same body at rest: where clothes are cut out
    joints : (B, 18, 3) COCO-18 joints, posed
    shape : list of dict
        Age, gender and so on of each body.
    standing : list of bool
        Whether the legs hang straight enough for a skirt.
    """

    vertices: np.ndarray
    rest: np.ndarray
    joints: np.ndarray
    shape: list[dict[str, float]]
    standing: list[bool]


class Bodies:
    """Makes `People`; loading the model takes half a minute the first time."""

    def __init__(self) -> None:
        import anny
        import torch
        from anny.keypoints import KeypointsRegressor

        from gesture_core.skeletons import COCO17

        torch.set_num_threads(1)
        self._torch = torch
        self.model = anny.Anny()
        self._joints = KeypointsRegressor.coco(self.model, list(COCO17.joints))
        self.bones: list[str] = list(self.model.bone_labels)
        self.faces = self.model.faces.numpy().astype(np.int32)
        weights = self.model.vertex_bone_weights.numpy()
        indices = self.model.vertex_bone_indices.numpy()
        self.owner = indices[np.arange(len(indices)), weights.argmax(axis=1)]

    def sample(self, rng: np.random.Generator, count: int) -> People:
        """``count`` bodies of random shape and pose."""
        torch = self._torch
        pose = np.tile(np.eye(4, dtype=np.float32), (count, len(self.bones), 1, 1))
        for index in range(count):
            for bone, rotation in sample_pose(rng).items():
                pose[index, self.bones.index(bone), :3, :3] = rotation.as_matrix()
        shape = [sample_shape(rng) for _ in range(count)]
        kwargs = {key: torch.tensor([s[key] for s in shape]) for key in shape[0]}
        with torch.no_grad():
            out = self.model(pose_parameters=torch.from_numpy(pose), phenotype_kwargs=kwargs)
            coco = self._joints(out).numpy()
        joints = coco[:, np.maximum(FROM_COCO17, 0)]
        joints[:, NECK] = joints[:, list(SHOULDERS)].mean(axis=1)
        assert joints.shape[1] == COUNT
        high = joints[:, list(HIPS), 2].mean(axis=1) - joints[:, list(KNEES), 2].mean(axis=1)
        standing = [bool(h > 0.3) for h in high]
        return People(out["vertices"].numpy(), out["rest_vertices"].numpy(), joints, shape, standing)


def sample_shape(rng: np.random.Generator) -> dict[str, float]:
    """Adults and some older children."""
    return {
        "gender": float(rng.random() < 0.5) * 0.8 + 0.2 * rng.random(),
        "age": float(rng.uniform(0.5, 0.95)),
        "muscle": float(rng.uniform(0.2, 0.8)),
        "weight": float(rng.beta(2.5, 2.5)),
        "height": float(rng.uniform(0.2, 0.9)),
        "proportions": float(rng.uniform(0.2, 1)),
    }


def _turn(axis: str, degrees: float) -> Rotation:
    return Rotation.from_euler(axis, degrees, degrees=True)


def _between(start: np.ndarray, end: np.ndarray) -> Rotation:
    """The shortest rotation that takes direction ``start`` to ``end``."""
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    cross, dot = np.cross(a, b), float(a @ b)
    norm = float(np.linalg.norm(cross))
    if norm < 1e-8:
        return Rotation.identity() if dot > 0 else Rotation.from_rotvec(np.pi * np.array([0.0, 1.0, 0.0]))
    return Rotation.from_rotvec(cross / norm * np.arctan2(norm, dot))


# directions and lengths of the model's arm at rest, left side, metres
_UPPER = np.array([0.190, -0.007, -0.215])
_LOWER = np.array([0.132, -0.176, -0.134])
_SHOULDER = np.array([0.187, -0.009, 0.0])


def sample_reach(rng: np.random.Generator) -> np.ndarray:
    """Where a left hand goes, from its shoulder, metres."""
    kind = rng.choice(
        ["hang", "front", "up", "side", "hip", "face", "far", "fold", "over"],
        p=[0.2, 0.2, 0.12, 0.1, 0.05, 0.08, 0.07, 0.11, 0.07],
    )
    if kind == "hang":
        return np.array([rng.normal(0.06, 0.06), rng.normal(-0.03, 0.08), -0.52 + abs(rng.normal(0, 0.03))])
    if kind == "front":
        return np.array([rng.uniform(-0.4, 0.25), rng.uniform(-0.5, -0.2), rng.uniform(-0.45, 0.1)])
    if kind == "up":
        return np.array([rng.uniform(-0.2, 0.45), rng.uniform(-0.35, 0.05), rng.uniform(0.05, 0.52)])
    if kind == "side":
        return np.array([rng.uniform(0.3, 0.53), rng.uniform(-0.3, 0.1), rng.uniform(-0.3, 0.25)])
    if kind == "hip":
        return np.array([rng.uniform(-0.05, 0.08), rng.uniform(-0.15, 0.1), rng.uniform(-0.42, -0.36)])
    if kind == "face":
        return np.array([rng.uniform(-0.3, 0.05), rng.uniform(-0.3, -0.15), rng.uniform(0.0, 0.3)])
    if kind == "fold":  # the hand before the own shoulder: the forearm hides the upper arm
        return np.array([rng.normal(0.02, 0.1), rng.uniform(-0.32, -0.1), rng.uniform(-0.15, 0.1)])
    if kind == "over":  # above or behind the head
        return np.array([rng.uniform(-0.3, 0.1), rng.uniform(-0.15, 0.15), rng.uniform(0.2, 0.53)])
    return np.array([rng.uniform(-0.35, 0.35), rng.uniform(-0.55, -0.4), rng.uniform(-0.25, 0.25)])


def reach(target: np.ndarray, swing: float) -> tuple[Rotation, Rotation]:
    """Rotations of upper and lower arm (left) that bring the wrist to ``target``.

    Parameters
    ----------
    target : (3,) metres from the shoulder
    swing : float
        Degrees that the elbow is turned about the line from shoulder to wrist, from hanging down.
    """
    long, short = float(np.linalg.norm(_UPPER)), float(np.linalg.norm(_LOWER))
    # nothing goes through the trunk
    if target[0] < -0.02 and target[1] > -0.2 and target[2] < 0.05:
        target = np.array([target[0], -0.2, target[2]])
    distance = float(np.clip(np.linalg.norm(target), 0.17, (long + short) * 0.998))
    line = target / max(float(np.linalg.norm(target)), 1e-6)
    cosine = (long**2 + distance**2 - short**2) / (2 * long * distance)
    angle = float(np.arccos(np.clip(cosine, -1, 1)))
    down = np.array([0.35, 0.25, -1.0])
    side = down - (down @ line) * line
    side /= max(float(np.linalg.norm(side)), 1e-6)
    side = Rotation.from_rotvec(np.deg2rad(swing) * line).apply(side)
    elbow = long * (np.cos(angle) * line + np.sin(angle) * side)
    upper = _between(_UPPER, elbow)
    lower = _between(_LOWER, upper.inv().apply(line * distance - elbow))
    return upper, lower


def _arm(rng: np.random.Generator, target: np.ndarray, swing: float) -> dict[str, Rotation]:
    """Rotations of a left arm, wrist and fingers."""
    upper, lower = reach(target, swing)
    forearm = _LOWER / np.linalg.norm(_LOWER)
    twist = Rotation.from_rotvec(forearm * np.deg2rad(rng.normal(0, 35)))
    out = {
        "upperarm01": upper,
        "lowerarm01": lower,
        "lowerarm02": twist,
        "wrist": Rotation.from_rotvec(np.deg2rad(rng.normal(0, 18, 3))),
    }
    across = np.cross(forearm, [0.0, 0.0, 1.0])
    curl = rng.choice([0.0, rng.uniform(0, 75), 75.0])
    for finger in range(2, 6):
        bend = curl if rng.random() < 0.8 else rng.choice([0.0, 70.0])
        for part in range(1, 4):
            out[f"finger{finger}-{part}"] = Rotation.from_rotvec(-across * np.deg2rad(bend))
    return out


def _mirrored(rotation: Rotation) -> Rotation:
    """The same movement of the other side: reflected in the plane x = 0."""
    x, y, z = rotation.as_rotvec()
    return Rotation.from_rotvec([x, -y, -z])


def sample_pose(rng: np.random.Generator) -> dict[str, Rotation]:
    """Rotation of each bone that moves, by bone name."""
    pose: dict[str, Rotation] = {}
    left, right = sample_reach(rng), sample_reach(rng)
    swings = rng.normal(10, 25, 2)
    if rng.random() < 0.25:  # both hands do the same
        right, swings[1] = left + rng.normal(0, 0.03, 3), swings[0]
    for side, target, swing in (("L", left, swings[0]), ("R", right, swings[1])):
        for bone, rotation in _arm(rng, target, float(swing)).items():
            pose[f"{bone}.{side}"] = rotation if side == "L" else _mirrored(rotation)
        shrug = Rotation.from_rotvec([0, -np.deg2rad(max(0.0, rng.normal(0, 6))), 0])
        pose[f"clavicle.{side}"] = shrug if side == "L" else _mirrored(shrug)
    lean = Rotation.from_euler("xyz", rng.normal(0, (3.0, 1.5, 3.0)), degrees=True)
    for bone in ("spine04", "spine03", "spine02"):
        pose[bone] = lean
    head = Rotation.from_euler("zxy", rng.normal(0, (14.0, 6.0, 4.0)), degrees=True)
    for bone in ("neck01", "head"):
        pose[bone] = head
    pose.update(_legs(rng))
    kind = rng.random()
    yaw = rng.normal(0, 22) if kind < 0.75 else rng.uniform(-95, 95) if kind < 0.95 else rng.normal(180, 30)
    pose["root"] = _turn("z", float(yaw))
    return pose


def _legs(rng: np.random.Generator) -> dict[str, Rotation]:
    """Standing, walking or sitting legs; the left hip at rest points down and a little outwards."""
    kind = rng.random()
    out: dict[str, Rotation] = {}
    for side, sign in SIDES.items():
        if kind < 0.65:
            hip, knee = abs(rng.normal(0, 4)), abs(rng.normal(0, 6))
        elif kind < 0.85:
            hip, knee = rng.uniform(-20, 40), rng.uniform(5, 50)
        else:
            hip, knee = rng.normal(85, 8), rng.normal(85, 12)
        spread = rng.normal(-2, 5) * sign
        out[f"upperleg01.{side}"] = _turn("x", -hip) * _turn("y", -spread)
        out[f"lowerleg01.{side}"] = _turn("x", knee)
    return out
