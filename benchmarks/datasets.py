"""The real data beside the repository as labelled sequences; nothing of it is ever copied here."""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

ROOT = Path(__file__).resolve().parents[1]
PAPER_EXAMPLES = ("a1_s1_t2", "a6_s1_t3", "a9_s1_t2", "a24_s1_t4", "a7_s1_t1", "a26_s1_t4")


@dataclass(frozen=True)
class Item:
    """A sequence, what it shows, who performs it, what it is called, and its numbers in float64."""

    pose: PoseSequence
    label: str
    subject: str
    name: str
    group: str = ""
    exact: np.ndarray | None = None


def arguments(text: str) -> argparse.ArgumentParser:
    """A parser with the one argument that all benchmarks share."""
    parser = argparse.ArgumentParser(description=text)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared", help="folder of the real data")
    return parser


def need(folder: Path) -> Path:
    """``folder``, or the end of the program with a reason."""
    if not folder.is_dir():
        sys.exit(f"{folder} is absent: the real data do not travel with the project (--shared names them)")
    return folder


def utd_openpose(shared: Path, *, with_a8: bool = False) -> list[Item]:
    """192 sequences of 6 actions by 8 subjects; the paper's authors published 3 of a8, subject 1."""
    root = need(shared / "data" / "utd_openpose")
    items = []
    for path in sorted([*(root / "subject1").glob("*.csv"), *(root / "queries").glob("*.csv")]):
        name = path.name.removesuffix("_color.avi.csv")
        action, subject, _ = name.split("_")
        if action == "a8" and not with_a8:
            continue
        points = np.loadtxt(path, delimiter=",").reshape(-1, 18, 2)
        item = Item(_pose(points, 30.0, name), action, subject, name, exact=points.reshape(-1, 36))
        items.append(item)
    return items


def utd_skeleton(shared: Path, *, depth: bool = False) -> list[Item]:
    """Kinect joints of 27 actions, subjects 1 to 4, projected to x and y unless ``depth``, as COCO-18."""
    import scipy.io

    # Kinect: head, shoulder centre, spine, hip centre, then arm and leg of each side (shoulder,
    # elbow, wrist, hand; hip, knee, ankle, foot), the left side first.
    arm, leg = (8, 9, 10), (16, 17, 18)
    joints = [0, 1, *arm, 4, 5, 6, *leg, 12, 13, 14]
    items = []
    for path in sorted(need(shared / "data" / "utd_skeleton").glob("*.mat")):
        name = path.name.removesuffix("_skeleton.mat")
        action, subject, _ = name.split("_")
        raw = scipy.io.loadmat(path)["d_skel"].transpose(2, 0, 1)
        points = np.full((len(raw), 18, 3), np.nan)
        # Metres, y up, x mirrored against what a camera sees (the left arm has the smaller x).
        points[:, :14] = raw[:, joints] * (-1, -1, 1)
        points = points if depth else points[..., :2]
        items.append(Item(_pose(points, 30.0, name), action, subject, name))
    return items


def body_gesture(shared: Path) -> list[Item]:
    """225 clips of 15 gestures by 5 subjects: MediaPipe landmarks at the frame rate of each video."""
    root = need(shared / "data" / "body_gesture")
    items = []
    with np.load(root / "landmarks_mediapipe33.npz", allow_pickle=False) as archive:
        for key in sorted(archive.files):
            subject, kind, clip = key.split("__")
            marks = archive[key]
            points = marks[:, :, :2].astype(np.float64) * (640, 480)
            fps = _avi_rate(root / subject / f"{clip}.avi")
            pose = PoseSequence(
                points, marks[:, :, 3], np.arange(len(points)) / fps, "blazepose33", (640, 480), source=key
            ).onto("coco18")
            items.append(Item(pose, clip.split("_")[0], subject, key, "static" if kind == "s" else "dynamic"))
    return items


def pose_trainer(shared: Path) -> list[Item]:
    """112 OpenPose sequences of 4 exercises in good and bad form, many joints missing."""
    items = []
    for path in sorted(need(shared / "data" / "pose_trainer").glob("*/*.npy")):
        raw = np.load(path, allow_pickle=False)
        points = np.where(raw[..., 2:] > 0, raw[..., :2], np.nan)
        pose = PoseSequence(points, raw[..., 2], np.arange(len(raw)) / 30.0, source=path.stem)
        items.append(Item(pose, path.parent.name, path.stem, path.stem))
    return items


def _pose(points: np.ndarray, fps: float, name: str) -> PoseSequence:
    scores = np.ones(points.shape[:2])
    return PoseSequence(points, scores, np.arange(len(points)) / fps, COCO18.name, source=name)


def _avi_rate(path: Path) -> float:
    """Frames per second of an AVI file: 10^6 over the microseconds a frame of its main header."""
    head = path.read_bytes()[:256]
    found = re.search(rb"avih....(....)", head, re.DOTALL)
    if not found:
        raise ValueError(f"{path} has no AVI header")
    return 1e6 / int.from_bytes(found.group(1), "little")
