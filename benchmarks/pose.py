"""Gates of the pose stage: a student network beside the teacher hpe0001 and the rival mv2s 256.

    python benchmarks/pose.py [--student NAME|FILE] [--only A,B,C,D,G] [--every N] [--shared FOLDER]

A   UTD clips against the published keypoints; 225 videos of gestures against the teacher
B   accuracy of the same classifier with the keypoints of the student and of the teacher
C   frames a second, end to end and beside the bare runtime
D   somebody where somebody is, nobody where nobody is
G   the student as it is used, with pose.rate: gestures told apart beside landmark files, UTD without a fit

What is wanted of blazepose: --student blazepose --only C,D,G --threads 1

Keypoints are kept under --cache by the hashes of network and video, so that a second run is quick.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from datasets import arguments, body_gesture, need
from nobody import SOMEBODY, SOMETIMES, beside, held_out, nobody
from pose_measures import Comparison, compare, to_authors
from unseen import unseen

from gesture_core.errors import GestureError
from gesture_core.files import cache_dir
from gesture_core.plugin import registry
from gesture_core.pose.extract import REVISION, extract_poses
from gesture_core.pose.models import backend_name, find_model
from gesture_core.pose.network import Letterbox, NetworkBackend, input_size, to_batch
from gesture_core.types import PoseSequence
from gesture_core.video import at_rate, open_video, pictures

SPARSE = 8
"""A2 and A3 look at every eighth frame: neighbours say the same."""
TEACHER, RIVAL = "hpe0001_f32_dynamic.onnx", "openpose_mv2s_256x256.onnx"


@dataclass(frozen=True)
class Gate:
    """One line of the table."""

    name: str
    what: str
    value: float
    must: float
    aim: float
    unit: str = ""
    least: bool = False

    def line(self) -> str:
        good = (lambda bound: self.value >= bound) if self.least else (lambda bound: self.value <= bound)
        verdict = "aim" if good(self.aim) else "met" if good(self.must) else "MISSED"
        sign = ">=" if self.least else "<="
        value = "n/a" if np.isnan(self.value) else f"{self.value:.3f}{self.unit}"
        return f"{self.name:4} {self.what:62} {value:>9}  {sign} {self.must:g} ({self.aim:g})  {verdict}"


class Extractor:
    """Keypoints of videos by one network, remembered in a folder."""

    def __init__(self, model: str | Path, cache: Path, threads: int = 0, follow: bool | None = None) -> None:
        found = find_model(model)
        self.backend: NetworkBackend = registry().make(
            "pose", backend_name(found), {"threads": threads}, model=found
        )
        self.name = found.name
        self.follow = follow
        # What a network that follows sees depends on all that is around it.
        sources = sorted(Path(sys.modules["gesture_core.pose.extract"].__file__ or "").parent.glob("*.py"))
        text = b"".join(source.read_bytes() for source in sources) + repr(found.contract).encode()
        code = hashlib.sha256(text).hexdigest()[:8] if self.following else "still"
        self.folder = cache / f"{found.name}-{found.sha256[:12]}-{code}-{REVISION}"

    @property
    def following(self) -> bool:
        return self.backend.contract.follow if self.follow is None else self.follow

    def at_rate(self, video: Path, rate: float) -> PoseSequence:
        """A video with ``pose.rate``; from the folder if it is there."""
        name = f"rate{rate:g}"
        if (kept := self._kept(video, name)) is None:
            with open_video(video) as frames:
                kept = extract_poses(at_rate(pictures(frames), rate), self.backend, follow=self.follow)[0]
            self._keep(kept, video, name)
        return kept

    def frames(self, video: Path, step: int = 1) -> PoseSequence:
        """Every ``step``-th frame of a video; from the folder if it is there.

        A network that follows sees every frame all the same, because each depends on the last.
        """
        for stride in range(1, step + 1):
            if step % stride == 0 and (kept := self._kept(video, f"{stride}")) is not None:
                return thinned(kept, step // stride)
        stride = 1 if self.following else step
        with open_video(video) as frames:
            # The reference is what its network says of each frame, sparse as they are.
            (pose,) = extract_poses(
                islice(frames, 0, None, stride),
                self.backend,
                follow=self.follow,
                steady=self.following and self.backend.steady,
            )
        self._keep(pose, video, f"{stride}")
        return thinned(pose, step // stride)

    def _path(self, video: Path, which: str) -> Path:
        return self.folder / f"{hashlib.sha256(video.read_bytes()).hexdigest()[:24]}.{which}.npz"

    def _keep(self, pose: PoseSequence, video: Path, which: str) -> None:
        path = self._path(video, which)
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, keypoints=pose.keypoints, scores=pose.scores, times=pose.times)

    def _kept(self, video: Path, which: str) -> PoseSequence | None:
        path = self._path(video, which)
        if not path.is_file():
            return None
        with np.load(path, allow_pickle=False) as kept:
            return PoseSequence(kept["keypoints"], kept["scores"], kept["times"], self.backend.skeleton)


def thinned(pose: PoseSequence, step: int) -> PoseSequence:
    """Every ``step``-th frame."""
    return PoseSequence(pose.keypoints[::step], pose.scores[::step], pose.times[::step], pose.skeleton)


def utd(shared: Path, networks: list[Extractor]) -> list[Gate]:
    """A1, and the figure of the reader's own reference: hpe0001 at 368."""
    videos = sorted(need(shared / "data" / "utd_openpose" / "videos").glob("*.avi"))
    gates = []
    for network in networks:
        found = []
        total = 0
        for video in videos:
            table = np.loadtxt(f"{video}.csv", delimiter=",").reshape(-1, 18, 2)
            total += len(table)
            found.append(to_authors(network.frames(video), table))
        plain, fitted = (np.concatenate(part) for part in zip(*found, strict=True))
        print(
            f"UTD   {network.name:20} mean {plain.mean():.3f}  median {np.median(plain):.3f}  "
            f"aligned mean {fitted.mean():.3f}  all 18 joints in {len(plain) / total:.1%} of {total} frames"
        )
        if network is networks[0]:
            gates.append(Gate("A1", "UTD, student to the authors, aligned mean", fitted.mean(), 0.17, 0.12))
        elif network.name == "hpe0001":
            gates.append(Gate("A0", "UTD, hpe0001 at 368 to the authors, mean", plain.mean(), 0.17, 0.17))
    return gates


def gestures(shared: Path, student: Extractor, teacher: Extractor, every: int) -> list[Gate]:
    """A2 and A3 at every eighth frame, by distance and together."""
    by_distance: dict[str, list[Comparison]] = {}
    landmarks = {f"{item.subject}/{item.name.split('__')[2]}": item.pose for item in body_gesture(shared)}
    confirmed: list[Comparison] = []
    for video in gesture_videos(shared)[::every]:
        distance = video.stem.split("_")[2]
        mine, theirs = student.frames(video, SPARSE), teacher.frames(video, SPARSE)
        by_distance.setdefault(distance, []).append(compare(mine, theirs))
        witness = landmarks[f"{video.parent.name}/{video.stem}"].keypoints[::SPARSE][: len(mine)]
        confirmed.append(compare(mine, theirs, witness))
    every_part = [part for parts in by_distance.values() for part in parts]
    for distance, parts in [*sorted(by_distance.items()), ("all", every_part)]:
        it = Comparison.join(parts)
        print(
            f"BODY  {student.name:20} {distance:4} {len(parts):3} videos  wrists {it.wrist_median:.3f}  "
            f"PCK@0.5 {it.pck:.3f}  joints found {it.joints_found:.3f}  "
            f"frames with all found {it.frames_found:.3f}  swaps {it.swaps:.4f}"
        )
    it = Comparison.join(every_part)
    return [
        Gate("A2", "gestures, wrist median to hpe0001", it.wrist_median, 0.30, 0.20),
        Gate("A2", "gestures, PCK@0.5", it.pck, 0.93, 0.97, least=True),
        Gate("A2", "gestures, visible joints found", it.joints_found, 0.95, 0.98, least=True),
        Gate("A3", "gestures, left and right swapped", it.swaps, 0.01, 0.003),
        Gate("A3m", "the same, sides confirmed by MediaPipe", Comparison.join(confirmed).swaps, 0.01, 0.003),
    ]


def gesture_videos(shared: Path) -> list[Path]:
    """The 225 videos."""
    return sorted(need(shared / "data" / "body_gesture").glob("S*/*.avi"))


def classification(
    shared: Path, student: Extractor, teacher: Extractor, preset: str, step: int
) -> list[Gate]:
    """B1: leave one subject out, the same classifier on the keypoints of both."""
    videos = gesture_videos(shared)
    accuracy = []
    for network in (student, teacher):
        poses = [network.frames(video, step).onto("coco18") for video in videos]
        accuracy.append(told_apart(videos, poses, preset))
        print(f"B1    {network.name:20} preset {preset}, every {step}. frame: {accuracy[-1]:.1f} %")
    return [Gate("B1", "gestures, points of accuracy lost to hpe0001", accuracy[1] - accuracy[0], 8, 3)]


def told_apart(videos: list[Path], poses: list[PoseSequence], preset: str) -> float:
    """Per cent of gestures of each subject that the others' tell apart."""
    from gesture_core.classify.estimator import GestureClassifier

    labels = np.array([video.stem.split("_")[0] for video in videos])
    subjects = np.array([video.parent.name for video in videos])
    right = 0
    for subject in np.unique(subjects):
        inside, outside = np.flatnonzero(subjects != subject), np.flatnonzero(subjects == subject)
        model = GestureClassifier(preset).fit([poses[i] for i in inside], labels[inside])
        right += int((model.predict([poses[i] for i in outside]) == labels[outside]).sum())
    return 100 * right / len(videos)


def as_used(shared: Path, student: Extractor, preset: str, rate: float) -> list[Gate]:
    """G: the student with ``pose.rate`` beside the landmark files, and UTD as it is."""
    by_clip = {f"{item.subject}/{item.name.split('__')[2]}": item.pose for item in body_gesture(shared)}
    videos = gesture_videos(shared)
    mine = told_apart(videos, [student.at_rate(video, rate).onto("coco18") for video in videos], preset)
    theirs = told_apart(videos, [by_clip[f"{video.parent.name}/{video.stem}"] for video in videos], preset)
    print(
        f"G1    {student.name:20} preset {preset}, pose.rate {rate:g}: {mine:.1f} %, landmarks {theirs:.1f} %"
    )
    clips = sorted(need(shared / "data" / "utd_openpose" / "videos").glob("*.avi"))
    tables = [np.loadtxt(f"{clip}.csv", delimiter=",").reshape(-1, 18, 2) for clip in clips]
    away = [to_authors(student.frames(clip), table)[0] for clip, table in zip(clips, tables, strict=True)]
    return [
        Gate("G1", f"gestures told apart, pose.rate {rate:g}, per cent", mine, 70, 72, least=True),
        Gate("G2", "the same, points behind the landmark files", theirs - mine, 3, 0),
        Gate("G3", "UTD, student to the authors, mean", np.concatenate(away).mean(), 0.15, 0.12),
    ]


def presence(shared: Path, student: Extractor, every: int, drawn: int) -> list[Gate]:
    """D: frames with a person that lose them, and frames of nobody that get one."""
    lost = total = 0
    for video in gesture_videos(shared)[::every]:
        pose = student.frames(video, SPARSE)
        lost, total = lost + len(pose) - pose.frames_with_pose, total + len(pose)
    found, frames = 0, 0
    sets = {
        "drawn": nobody(drawn),
        "of other kinds": held_out(drawn, 2),
        "of kinds kept for this": unseen(drawn),
        "beside a person": beside(shared, 60, 2),
    }
    for what, shown in sets.items():
        poses = [extract_poses([(0.0, one)], student.backend, follow=student.follow)[0] for one in shown]
        there = sum(pose.frames_with_pose for pose in poses)
        print(f"D     {student.name:20} {there} of {len(shown)} pictures of nobody, {what}, have somebody")
        found, frames = found + there, frames + len(shown)
    drawn_gate = Gate("D3", f"the same of {frames} pictures alone", found / frames, 0.01, 0.0)
    for file in sorted(need(shared / "data" / "nasty_media").glob("*.*")):
        try:
            with open_video(file) as video:
                poses = extract_poses(islice(video, 60), student.backend, follow=student.follow)
        except GestureError:
            continue
        there, seen = poses[0].frames_with_pose, len(poses[0])
        print(f"D     {student.name:20} {file.name:32} somebody in {there} of {seen} frames")
        if file.name in SOMEBODY:
            lost, total = lost + seen - there, total + seen
        elif file.name not in SOMETIMES:
            found, frames = found + there, frames + seen
    return [
        Gate("D1", f"share of {total} frames with a person that lose them", lost / total, 0.01, 0.0),
        Gate("D2", f"share of {frames} frames of nobody that get somebody", found / frames, 0.01, 0.0),
        drawn_gate,
    ]


def speed(shared: Path, networks: list[Extractor], rounds: int) -> list[Gate]:
    """C1, and extraction beside the bare runtime; the best of several interleaved rounds."""
    videos = sorted(need(shared / "data" / "utd_openpose" / "videos").glob("*.avi"))[:1]
    frames = []
    for video in videos:
        with open_video(video) as reader:
            frames += list(reader)
            half = (reader.info.fps or 30) / 2  # what pose.rate = 15 makes of a video of 30 a second
    measures = ("bare", "memory", "end to end", "half")
    times = {(network.name, what): [] for network in networks for what in measures}
    for _ in range(rounds):
        for network in networks:
            bare = _bare(network.backend, [frame for _, frame in frames])
            times[network.name, "bare"].append(_seconds(bare))
            times[network.name, "memory"].append(
                _seconds(lambda n=network: extract_poses(_ordered(frames), n.backend, follow=False))
            )
            times[network.name, "end to end"].append(_seconds(lambda n=network: _end_to_end(n, videos)))
            times[network.name, "half"].append(_seconds(lambda n=network: _end_to_end(n, videos, half)))
    rate = {key: len(frames) / min(seconds) for key, seconds in times.items()}
    for network in networks:
        bare_, memory, whole = (rate[network.name, what] for what in ("bare", "memory", "end to end"))
        print(
            f"C1    {network.name:20} runtime alone {bare_:6.1f} frames/s  extraction {memory:6.1f} "
            f"({memory / bare_:.2f})  with decoding{' and following' if network.following else ''} "
            f"{whole:6.1f} ({whole / bare_:.2f})"
        )
    student, rival = networks[0].name, networks[-1].name
    return [
        Gate("C0", f"extraction over the bare runtime, {student}",
             rate[student, "memory"] / rate[student, "bare"], 0.8, 0.9, least=True),
        Gate("C1", f"frames/s end to end over {rival}",
             rate[student, "end to end"] / rate[rival, "end to end"], 1.5, 3.0, " x", least=True),
        Gate("C2", f"video frames/s where every second frame is looked at, {student}",
             rate[student, "half"], 600, 600, least=True),
        Gate("C3", f"end to end over the bare runtime, {student}",
             rate[student, "end to end"] / rate[student, "bare"], 0.85, 0.9, least=True),
        Gate("C4", f"seconds of video a second where 15 frames of each are looked at, {student}",
             rate[student, "half"] / 30, 1, 2, " x", least=True),  # the header of the clip says 15
    ]  # fmt: skip


def _ordered(frames: list[tuple[float, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    return [(float(i), frame) for i, (_, frame) in enumerate(frames)]


def _bare(backend: NetworkBackend, frames: list[np.ndarray]) -> Callable[[], None]:
    """A run of the network over ready-made batches of the frames: no decoding, scaling or peaks."""
    size = input_size(backend.contract, (frames[0].shape[1], frames[0].shape[0]), backend.height)
    box = Letterbox.fit((frames[0].shape[1], frames[0].shape[0]), size)
    step = backend.batch_size
    batches = [to_batch(frames[i : i + step], box, backend.contract) for i in range(0, len(frames), step)]

    def run() -> None:
        for batch in batches:
            backend.run(batch)

    return run


def _end_to_end(network: Extractor, videos: list[Path], rate: float = 0) -> None:
    for video in videos:
        with open_video(video) as reader:
            extract_poses(at_rate(pictures(reader), rate), network.backend, follow=network.follow)


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main() -> int:
    """Print the measures, then the gates; the exit code says whether every must is met."""
    parser = arguments(__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--student", default="compact", help="name or file of the network to judge")
    parser.add_argument("--only", default="A,B,C,D,G", help="gates to run")
    parser.add_argument("--drawn", type=int, default=300, help="drawn pictures of nobody for D, of each set")
    parser.add_argument("--rate", type=float, default=15, help="pose.rate of G")
    parser.add_argument("--every", type=int, default=1, help="every n-th gesture video for A2 and A3")
    parser.add_argument("--preset", default="modern", help="preset of B1")
    parser.add_argument("--step", type=int, default=1, help="every n-th frame for B1")
    parser.add_argument("--rounds", type=int, default=8, help="of each timing, interleaved; the best counts")
    parser.add_argument("--threads", type=int, default=0, help="of onnxruntime; 0: its own choice")
    parser.add_argument("--cache", type=Path, default=cache_dir() / "benchmark-pose")
    chosen = parser.parse_args()
    models = need(chosen.shared / "models")
    wanted = chosen.only.split(",")
    print(f"python benchmarks/pose.py {' '.join(sys.argv[1:])}")
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    print(f"{machine}, {time.strftime('%F')}")
    try:
        student = Extractor(chosen.student, chosen.cache, chosen.threads)
    except GestureError as error:
        sys.exit(str(error))
    # The reference looks at whole pictures: what it says depends on no crop.
    teacher = Extractor(models / TEACHER, chosen.cache, chosen.threads, follow=False)
    rival = Extractor(models / RIVAL, chosen.cache, chosen.threads)
    gates: list[Gate] = []
    if "A" in wanted:
        gates += utd(chosen.shared, [student, teacher, rival])
        gates += gestures(chosen.shared, student, teacher, chosen.every)
    if "B" in wanted:
        gates += classification(chosen.shared, student, teacher, chosen.preset, chosen.step)
    if "C" in wanted:
        gates += speed(chosen.shared, [student, rival], chosen.rounds)
    if "D" in wanted:
        gates += presence(chosen.shared, student, chosen.every, chosen.drawn)
    if "G" in wanted:
        gates += as_used(chosen.shared, student, chosen.preset, chosen.rate)
    print("\ngate what" + " " * 60 + "value  must (aim)")
    for gate in gates:
        print(gate.line())
    return 0 if all("MISSED" not in gate.line() for gate in gates) else 3


if __name__ == "__main__":
    sys.exit(main())
