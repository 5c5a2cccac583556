"""The gates of the own network, teacher and student on the same frames.

Evaluation media (``utd_openpose``, ``body_gesture``) are read here and nowhere else in this folder.
The student sees the person's crop: the teacher's box, 1.25 times as large, jittered by a tenth as a
follower of the person would be; the whole picture is reported too. The teacher sees whole pictures.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .decode import decode
from .joints import COUNT, HIPS, MIRROR, NAMES, NECK, SHOULDERS, WRISTS, body_scale
from .label import Box, box_of
from .teachers import Teachers, apply, square

SIZE, STRIDE = 192, 4
FOUND = 0.25  # a joint is found where its peak is higher: see the model card for what other values cost
SURE = 0.3  # a joint of the teacher counts as visible from this peak on


class Student:
    """An exported network on onnxruntime."""

    def __init__(self, path: Path, threads: int = 2) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])

    def __call__(self, picture: np.ndarray, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """(18, 2) picture pixels and (18,) scores of the person in a square box."""
        crop, back = square(picture, box[0], box[1], SIZE)
        feed = np.ascontiguousarray(crop.transpose(2, 0, 1)[None], np.float32)
        maps = self._session.run(None, {"image": feed})[0]
        points, scores = decode(maps[:, :COUNT], STRIDE)
        return apply(back, points[0]), scores[0]


@dataclass(frozen=True)
class Agreement:
    """Student against reference over many frames, in shoulder widths of the reference.

    ``errors`` (F, 18) is NaN where either has no joint; ``aligned`` the same after a fit of
    translation and scale in each frame; ``visible`` and ``found`` (F, 18) bool; ``swapped`` (F,) bool.
    """

    errors: np.ndarray
    aligned: np.ndarray
    visible: np.ndarray
    found: np.ndarray
    swapped: np.ndarray

    def line(self, name: str) -> str:
        """One row of a Markdown table."""
        wrists = self.errors[:, list(WRISTS)]
        every = self.errors[self.visible]  # a joint that is visible and not found counts as a miss
        hits = np.nan_to_num(every, nan=9.0) < 0.5
        found = (self.found & self.visible).sum() / max(1, self.visible.sum())
        return (
            f"| {name} | {len(self.errors)} | {np.nanmean(self.aligned):.3f} | {np.nanmean(self.errors):.3f} "
            f"| {np.nanmedian(wrists):.3f} | {hits.mean():.3f} | {100 * found:.1f} % "
            f"| {100 * self.swapped.mean():.2f} % |"
        )


HEAD = (
    "| clips | frames | aligned mean | mean | wrist median | PCK@0.5 | visible joints found | swapped |\n"
    "|---|---|---|---|---|---|---|---|"
)


def compare(
    points: np.ndarray, scores: np.ndarray, reference: np.ndarray, sure: np.ndarray, found: float = FOUND
) -> Agreement:
    """Compare (F, 18, 2) keypoints with a reference; ``sure`` (F, 18) bool marks its visible joints."""
    count = len(points)
    errors = np.full((count, COUNT), np.nan)
    aligned, swapped = errors.copy(), np.zeros(count, bool)
    here = scores > found
    for frame in range(count):
        both = here[frame] & sure[frame]
        scale = body_scale(reference[frame], sure[frame])
        if scale <= 0 or both.sum() < 3:
            continue
        a, b = points[frame], reference[frame]
        errors[frame, both] = np.linalg.norm(a - b, axis=1)[both] / scale
        x, y = a[both] - a[both].mean(axis=0), b[both] - b[both].mean(axis=0)
        fit = float((x * y).sum() / max(float((x * x).sum()), 1e-9))
        aligned[frame, both] = np.linalg.norm(fit * x - y, axis=1) / scale
        swapped[frame] = _swapped(a, b, both, scale)
    return Agreement(errors, aligned, sure, here, swapped)


def _swapped(a: np.ndarray, b: np.ndarray, both: np.ndarray, scale: float) -> bool:
    """Whether shoulders and hips, taken together, fit the other side of the body better."""
    pairs = [j for j in (*SHOULDERS, *HIPS) if both[j] and both[MIRROR[j]]]
    if not pairs or np.linalg.norm(b[SHOULDERS[0]] - b[SHOULDERS[1]]) < 0.35 * scale:
        return False
    straight = sum(float(np.linalg.norm(a[j] - b[j])) for j in pairs)
    crossed = sum(float(np.linalg.norm(a[j] - b[MIRROR[j]])) for j in pairs)
    return crossed < straight


def video(path: Path, step: int = 1, first: int = 0) -> Iterator[np.ndarray]:
    """Every ``step``-th BGR frame of a video."""
    import av

    with av.open(str(path)) as container:
        for index, frame in enumerate(container.decode(video=0)):
            if index >= first and (index - first) % step == 0:
                yield frame.to_ndarray(format="bgr24")


def whole_pictures(teachers: Teachers, frames: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """hpe0001 on whole pictures, 368 high: (F, 18, 2) picture pixels and (F, 18) scores."""
    points, scores = np.zeros((len(frames), COUNT, 2)), np.zeros((len(frames), COUNT))
    for index, frame in enumerate(frames):
        height, width = frame.shape[:2]
        wide = 8 * round(width * 368 / height / 8)
        maps = teachers.heat(cv2.resize(frame, (wide, 368), interpolation=cv2.INTER_AREA)[None])
        places, peaks = decode(maps, 8)
        points[index] = (places[0] + 0.5) * (width / wide, height / 368) - 0.5
        scores[index] = peaks[0]
    return points, scores


def reference(teachers: Teachers, path: Path, step: int, cache: Path) -> tuple[np.ndarray, np.ndarray]:
    """`whole_pictures` of one clip, remembered in ``cache``."""
    kept = cache / f"{path.parent.name}_{path.stem}_{step}.npz"
    if kept.exists():
        table = np.load(kept, allow_pickle=False)
        return table["points"], table["scores"]
    points, scores = whole_pictures(teachers, list(video(path, step)))
    cache.mkdir(parents=True, exist_ok=True)
    np.savez(kept, points=points, scores=scores)
    return points, scores


def run_student(
    student: Student, frames: list[np.ndarray], points: np.ndarray, seen: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Student on jittered crops and on whole pictures: points and scores of each."""
    rng = np.random.default_rng(seed)
    count = len(frames)
    out = [
        np.zeros((count, COUNT, 2)),
        np.zeros((count, COUNT)),
        np.zeros((count, COUNT, 2)),
        np.zeros((count, COUNT)),
    ]
    for index, frame in enumerate(frames):
        box = box_of(points[index], seen[index])
        height, width = frame.shape[:2]
        whole = (np.array([width / 2, height / 2]), float(max(height, width)))
        if box is not None:
            jitter = rng.uniform(-0.1, 0.1, 2) * box[1]
            out[0][index], out[1][index] = student(
                frame, (box[0] + jitter, box[1] * 1.25 * float(rng.uniform(0.9, 1.1)))
            )
        out[2][index], out[3][index] = student(frame, whole)
    return out[0], out[1], out[2], out[3]


def normalised(points: np.ndarray) -> np.ndarray:
    """(F, 18, 2) with the neck at the origin and the shoulders a distance of 1 apart, as the authors' are."""
    across = np.linalg.norm(points[:, SHOULDERS[0]] - points[:, SHOULDERS[1]], axis=1)
    return (points - points[:, [NECK]]) / np.maximum(across, 1e-6)[:, None, None]


def authors(shared: Path) -> Iterator[tuple[Path, np.ndarray]]:
    """UTD clips with the authors' keypoints (T, 18, 2); their first frame is lost."""
    folder = shared / "data" / "utd_openpose" / "videos"
    for path in sorted(folder.glob("*.avi")):
        yield path, np.loadtxt(f"{path}.csv", delimiter=",").reshape(-1, COUNT, 2)


def evaluate(model: Path, shared: Path, work: Path, step: int = 40) -> str:
    """Gates A1 to A3 and the speed of the network alone, as Markdown."""
    student, teachers = Student(model), Teachers(shared / "models")
    cache = work / "reference"
    rows = [HEAD]
    gathered: list[tuple[np.ndarray, ...]] = []
    for path, keypoints in authors(shared):
        points, scores = reference(teachers, path, 1, cache)
        frames = list(video(path))
        got = run_student(student, frames, points, scores > SURE, 0)
        part = slice(1, 1 + len(keypoints))
        gathered.append((keypoints, got[0][part], got[1][part], points[part], scores[part]))
    keypoints, mine, mine_scores, theirs, their_scores = (
        np.concatenate(p) for p in zip(*gathered, strict=True)
    )
    every = np.ones(keypoints.shape[:2], bool)
    for name, points, scores in (("compact", mine, mine_scores), ("hpe0001 368", theirs, their_scores)):
        result = compare(normalised(points), scores, keypoints, every)
        rows.append(result.line(f"A1 UTD, authors' keypoints: {name}"))
    rows += _body_gesture(student, teachers, shared, cache, step)
    rows.append("")
    rows.append(speed(model, shared))
    return "\n".join(rows)


def _body_gesture(
    student: Student, teachers: Teachers, shared: Path, cache: Path, step: int
) -> Iterator[str]:
    crops: dict[str, list[tuple[np.ndarray, ...]]] = {}
    for path in sorted((shared / "data" / "body_gesture").glob("S*/*.avi")):
        points, scores = reference(teachers, path, step, cache)
        frames = list(video(path, step))[: len(points)]
        got = run_student(student, frames, points, scores > SURE, 1)
        distance = path.stem.split("_")[2]
        for key in (path.parent.name, distance, "all"):
            crops.setdefault(key, []).append((*got, points, scores))
    joined = {k: [np.concatenate(p) for p in zip(*v, strict=True)] for k, v in crops.items()}
    for key, (a, sa, b, sb, points, scores) in sorted(joined.items()):
        yield compare(a, sa, points, scores > SURE).line(f"A2 body_gesture {key}, crop")
        if key in ("all", "1m", "4m", "6m"):
            yield compare(b, sb, points, scores > SURE).line(f"A2 body_gesture {key}, whole picture")
    a, sa, _, _, points, scores = joined["all"]
    result = compare(a, sa, points, scores > SURE)
    yield ""
    yield "| joint | median error | visible found |\n|---|---|---|"
    for joint, name in enumerate(NAMES):
        seen = result.visible[:, joint]
        found = (result.found[:, joint] & seen).sum() / max(1, seen.sum())
        yield f"| {name} | {np.nanmedian(result.errors[:, joint]):.3f} | {100 * found:.1f} % |"


def speed(model: Path, shared: Path) -> str:
    """Median time of the network alone, beside mv2s at 256."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 2
    out = []
    for path, size in ((model, SIZE), (shared / "models" / "openpose_mv2s_256x256.onnx", 256)):
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        feed = {session.get_inputs()[0].name: np.zeros((1, 3, size, size), np.float32)}
        times = []
        for _ in range(60):
            start = time.perf_counter()
            session.run(None, feed)
            times.append(time.perf_counter() - start)
        out.append(f"{path.stem} {1e3 * float(np.median(times)):.2f} ms")
    return "network alone, onnxruntime, 2 threads: " + ", ".join(out)
