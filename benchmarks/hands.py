"""What hands add: stop against yes from RGB, and classes of OpenPose JSON that differ by the hands alone.

    python benchmarks/videos.py --model blazepose --hands --rate 15 --gestures stop yes --cache FOLDER
    python benchmarks/hands.py --cache FOLDER [--shared FOLDER]

The first part leaves out one of five people at a time. The second puts the hands that were found in those
videos on the bodies of ``openpose_json`` and writes both as OpenPose does; nothing is asked about a body or a
hand of which there is an example.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from datasets import Item, arguments, body_gesture
from videos import with_videos

from gesture_core import GestureClassifier, load_settings
from gesture_core.errors import GestureError
from gesture_core.plugin.registry import registry
from gesture_core.settings import Settings
from gesture_core.skeletons import HANDS42, skeleton
from gesture_core.types import PoseSequence

GESTURES = ("stop", "yes")
_NOISE, _LOST = 1.0, 0.1
"""Pixels of the hands' noise, and share of the frames in which one is lost."""
_SMALLEST = 60.0
"""Pixels of a forearm of which a hand is borrowed."""


def right(train: Sequence[Item], test: Sequence[Item], settings: Settings) -> int:
    """How many of ``test`` get their label from ``train``."""
    classifier = GestureClassifier(settings).fit([i.pose for i in train], [i.label for i in train])
    said = classifier.predict([item.pose for item in test])
    return sum(label == item.label for label, item in zip(said, test, strict=True))


def videos(items: Sequence[Item], preset: str, sets: Sequence[str]) -> str:
    """Right labels of stop and yes, each person by the four others."""
    settings, found = load_settings(preset, sets, environment={}), 0
    for person in sorted({item.subject for item in items}):
        test = [item for item in items if item.subject == person]
        found += right([item for item in items if item.subject != person], test, settings)
    return f"{preset} {' '.join(sets)}: {found} of {len(items)}"


def shapes(pose: PoseSequence) -> np.ndarray:
    """(N, 21) complex: a raised hand from its wrist, in lengths of the forearm, which points to 1."""
    at = {joint: n for n, joint in enumerate(skeleton(pose.skeleton).joints)}
    points = pose.keypoints.astype(np.float64).view(np.complex128)[..., 0]
    found = []
    for side in ("left", "right"):
        shoulder, elbow, wrist = (points[:, at[f"{side}_{j}"]] for j in ("shoulder", "elbow", "wrist"))
        hand = points[:, [at[j] for j in HANDS42.joints if j.startswith(side)]]
        length = np.nanmedian(np.fmax(np.abs(wrist - elbow), 0.9 * np.abs(elbow - shoulder)))
        raised = (wrist.imag < elbow.imag) & ~np.isnan(hand[:, 0]) & (length > _SMALLEST)
        turned = (hand - hand[:, :1]) / length / ((wrist - elbow) / np.abs(wrist - elbow))[:, None]
        found.append(turned[raised] if side == "right" else turned[raised].conj())
    return max(found, key=len)


def write_openpose(pose: PoseSequence, hand: np.ndarray, folder: Path, rng: np.random.Generator) -> None:
    """A folder of OpenPose JSON: the body of ``pose`` with ``hand`` at both wrists."""
    folder.mkdir(parents=True)
    body = skeleton(pose.skeleton)
    points = pose.keypoints.astype(np.float64).view(np.complex128)[..., 0]
    order = np.abs((np.arange(len(pose)) + rng.integers(len(hand))) % (2 * len(hand) - 1) - len(hand) + 1)
    lists = {"pose": np.concatenate([pose.keypoints, pose.scores[..., None]], axis=2)}
    for side in ("left", "right"):
        shoulder, elbow, wrist = (
            points[:, body.index(f"{side}_{j}")] for j in ("shoulder", "elbow", "wrist")
        )
        length = np.nanmedian(np.fmax(np.abs(wrist - elbow), 0.9 * np.abs(elbow - shoulder)))
        own = hand[order] if side == "right" else hand[order].conj()
        along = (wrist - elbow) / np.abs(wrist - elbow)
        placed = wrist[:, None] + length * along[:, None] * own
        placed += _NOISE * (rng.normal(size=placed.shape) + 1j * rng.normal(size=placed.shape))
        lost = np.isnan(placed).any(axis=1) | (rng.uniform(size=len(pose)) < _LOST)
        rows = np.stack([placed.real, placed.imag, np.full(placed.shape, 0.8)], axis=2)
        lists[f"hand_{side}"] = np.where(lost[:, None, None], 0, rows)
    for frame in range(len(pose)):
        person = {
            f"{name}_keypoints_2d": np.nan_to_num(values[frame]).round(3).reshape(-1).tolist()
            for name, values in lists.items()
        }
        (folder / f"a_{frame:012}_keypoints.json").write_text(json.dumps({"people": [person]}))


def borrowed(items: Sequence[Item], shared: Path, folder: Path) -> list[tuple[Item, Path]]:
    """Bodies of openpose_json with hands of ``items``; those that `modern` cannot compare are left out."""
    rng, made = np.random.default_rng(0), []
    reader = registry().make("reader", "openpose-json", {})
    bodies = sorted(path for path in (shared / "data" / "openpose_json").glob("*/*") if path.is_dir())
    lent: dict[str, dict[str, np.ndarray]] = {}
    for item in items:
        hand = shapes(item.pose)
        if len(hand) > len(lent.setdefault(item.subject, {}).get(item.label, ())):
            lent[item.subject][item.label] = hand
    people = sorted(person for person, hands in lent.items() if len(hands) == len(GESTURES))
    for number, path in enumerate(bodies):
        (pose,) = reader.read(path)
        wrists = [skeleton(pose.skeleton).index(f"{side}_wrist") for side in ("left", "right")]
        if pose.seen[:, wrists].any(axis=1).mean() < 0.5:
            print(f"left out: {path.parent.name}/{path.name}: its wrists are seen in less than half of it")
            continue
        try:
            GestureClassifier().signals([pose])
        except GestureError as error:
            print(f"left out: {path.parent.name}/{path.name}: {error.cause}")
            continue
        person = people[number % len(people)]
        for label in GESTURES:
            target = folder / label / f"{path.parent.name}_{path.name}"
            write_openpose(pose, lent[person][label], target, rng)
            made.append((Item(pose, label, person, target.name), target))
    return made


def main() -> int:
    """Print both parts."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--cache", type=Path, required=True, help="of videos.py --hands")
    parser.add_argument("--set", action="append", default=[], dest="sets")
    given = parser.parse_args()
    items = [item for item in with_videos(body_gesture(given.shared), given.cache) if item.label in GESTURES]
    print(f"RGB, {len(items)} clips")
    for preset in ("modern", "hands"):
        print(f"  {videos(items, preset, given.sets if preset == 'hands' else [])}")
    with tempfile.TemporaryDirectory() as name:
        made = borrowed(items, given.shared, Path(name))
        print(f"OpenPose JSON, {len(made)} folders, {len({one.subject for one, _ in made})} people's hands")
        for preset in ("modern", "hands"):
            settings = load_settings(preset, given.sets if preset == "hands" else [], environment={})
            reader = registry().make("reader", "openpose-json", {}, options=settings.keypoints)
            read = [replace(one, pose=reader.read(path)[0]) for one, path in made]
            found = 0
            for person in sorted({one.subject for one in read}):
                test = [one for one in read if one.subject == person]
                bodies = {one.name for one in test}
                train = [one for one in read if one.subject != person and one.name not in bodies]
                found += right(train, test, settings)
            print(f"  {preset}: {found} of {len(read)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
