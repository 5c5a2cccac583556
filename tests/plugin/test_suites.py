"""Each check of a suite finds the fault that it is there for, and says what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gesture_core.errors import KeypointError, MediaError, PluginError, PoseError
from gesture_core.plugin.interfaces import Person, Video, VideoInfo, VideoLimits, VideoReport
from gesture_core.plugin.reading import ReadOptions
from gesture_core.run.workers.worker import Worker
from gesture_core.testing import checks_for, draw_pose
from gesture_core.types import Job, Outcome, PoseSequence, Task
from gesture_core.video import open_video


def faults(kind: str, plugin: object, *more: object) -> list[str]:
    """What the suite of ``kind`` says of a plugin."""
    found = []
    for check in checks_for(kind):
        try:
            check(plugin, *more)
        except AssertionError as error:
            found.append(str(error))
    return found


# ---------------------------------------------------------------------------------------------- writers


@dataclass
class Text:
    """A right writer; ``spoil`` makes it a wrong one."""

    spoil: Callable[[Iterator[dict[str, Any]], Path], Any] = lambda rows, path: rows
    suffix: str = ".txt"

    def write(self, rows: Iterator[dict[str, Any]], columns: Sequence[str], path: Path) -> None:
        path.write_text("".join(f"{row}\n" for row in self.spoil(rows, path)), "utf-8")


def _no_error(rows: Iterator[dict[str, Any]], path: Path) -> Iterator[dict[str, Any]]:
    try:
        yield from rows
    except OSError:
        return


def _labels(rows: Iterator[dict[str, Any]], path: Path) -> Iterator[str]:
    return (row["label"].upper() for row in rows)


@pytest.mark.parametrize(
    ("writer", "message"),
    [
        (Text(suffix="txt"), "suffix is 'txt'"),
        (Text(lambda rows, path: [row for row in rows if row["label"]]), "same file without row 2"),
        (Text(lambda rows, path: [row.pop("input") for row in rows]), "changes the rows"),
        (Text(lambda rows, path: ["row" for _ in rows]), "another label"),
        (Text(lambda rows, path: [path.with_name("x").write_text("x"), *rows]), "leaves"),
        (Text(lambda rows, path: range(len(rows))), "raises TypeError"),  # type: ignore[arg-type]
        (Text(_no_error), "goes on as if nothing were wrong"),
        (Text(_labels), "raises AttributeError"),
    ],
)
def test_a_wrong_writer(writer: Text, message: str) -> None:
    assert not faults("writer", Text())
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("writer", writer)))


# ---------------------------------------------------------------------------------------------- readers


@dataclass
class Rows:
    """A right reader of files that begin with ``rows``; ``spoil`` makes it a wrong one."""

    spoil: Callable[[list[PoseSequence]], Any] = lambda found: found
    options: ReadOptions = field(default_factory=ReadOptions)
    assumed: str = "fps=30"
    taken: bytes = b"rows"
    names: tuple[str, ...] = ("",)
    errors: tuple[type[Exception], ...] = (OSError, ValueError)

    def accepts(self, path: Path) -> bool:
        return path.is_file() and path.read_bytes().startswith(self.taken)

    def members(self, path: Path) -> list[str]:
        return list(self.names)

    def read(self, path: Path, member: str = "") -> Any:
        if member not in self.names:
            raise KeypointError("no such member")
        try:
            word, *numbers = path.read_text("utf-8").split()
            points = np.array(numbers, float).reshape(-1, 18, 2)
            if word != "rows":
                raise ValueError(word)
        except self.errors as error:
            raise KeypointError(str(error)) from error
        times, scores = np.arange(len(points)) / self.options.rate, np.ones(points.shape[:2])
        assumed = {"assumed": self.assumed}
        found = [PoseSequence(points, scores, times, source=str(path), provenance=assumed)]
        return self.spoil(found)


@pytest.fixture
def rows(tmp_path: Path) -> Path:
    """A file of three frames."""
    path = tmp_path / "clip.rows"
    numbers = draw_pose(frames=3).keypoints.reshape(-1)
    path.write_text(f"rows {' '.join(f'{n:.3f}' for n in numbers)}", "utf-8")
    return path


def _noisy(found: list[PoseSequence]) -> list[PoseSequence]:
    noise = np.random.default_rng().normal(size=(3, 18, 2))
    return [replace(one, keypoints=one.keypoints + noise) for one in found]


@pytest.mark.parametrize(
    ("reader", "message"),
    [
        (Rows(taken=b"other"), "accepts answers False for its own clip.rows"),
        (Rows(taken=b""), "accepts answers True for clip.mp4"),
        (Rows(names=()), "returns no name"),
        (Rows(names=("", "")), "names one sequence twice"),
        (Rows(names=("", "no sequence of this name")), "member that is not there"),
        (Rows(tuple), "returns tuple"),
        (Rows(lambda found: []), "finds nobody"),
        (Rows(lambda found: [replace(found[0], source="")]), "source is ''"),
        (Rows(lambda found: found * 2), "one number"),
        (Rows(_noisy), "other keypoints the second time"),
        (Rows(assumed=""), 'provenance\\["assumed"\\]'),
        (Rows(errors=(OSError,)), "of a file of which 0% is left raises ValueError"),
    ],
)
def test_a_wrong_reader(reader: Rows, message: str, rows: Path) -> None:
    assert not faults("reader", Rows(), rows)
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("reader", reader, rows)))


# ---------------------------------------------------------------------------------------- pose backends


@dataclass
class Bright:
    """A right backend, that takes the brightest pixel for a nose; ``spoil`` makes it a wrong one."""

    spoil: Callable[[Sequence[np.ndarray], list[list[Person]]], Any] = lambda frames, found: found
    skeleton: str = "coco18"
    batch_size: int = 2

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> Any:
        if people not in ("single", "multi"):
            raise PoseError(people)
        return self.spoil(frames, [[self.person(frame)] for frame in frames])

    def person(self, frame: np.ndarray) -> Person:
        points, scores = np.full((18, 2), np.nan), np.zeros(18)
        light = frame.sum(axis=2, dtype=int)
        points[0] = np.argwhere(light == light.max()).mean(axis=0)[::-1]
        scores[0] = 1
        return Person(points, scores)


def _each(change: Callable[[np.ndarray, Person], Person]) -> Any:
    return lambda frames, found: [
        [change(frame, person) for person in people] for frame, people in zip(frames, found, strict=True)
    ]


def _half(_: np.ndarray, person: Person) -> Person:
    return Person(np.where([[True, False]], person.keypoints, np.nan), person.scores)


def _paint(frames: Sequence[np.ndarray], found: list[list[Person]]) -> list[list[Person]]:
    for frame in frames:
        if frame.flags.writeable or frame.base is not None:
            frame.base.flags.writeable = True  # type: ignore[union-attr]
            frame.flags.writeable = True
            frame[:] = 0
    return found


@pytest.mark.parametrize(
    ("backend", "message"),
    [
        (Bright(skeleton="stick"), "skeleton is 'stick'"),
        (Bright(batch_size=0), "batch_size is 0"),
        (Bright(lambda frames, found: found[:2]), "answers with 2 frames for 3"),
        (Bright(lambda frames, found: [people * 2 for people in found]), "finds 2 people"),
        (Bright(lambda frames, found: [[] for _ in found]), "finds nobody in these pictures"),
        (Bright(lambda frames, found: [people[0] for people in found]), "gives Person for a frame"),
        (Bright(_each(lambda f, p: Person(p.keypoints[:17], p.scores))), r"keypoints \(17, 2\)"),
        (Bright(_each(lambda f, p: Person(p.keypoints, p.scores * 2))), "expected 0..1"),
        (Bright(_each(lambda f, p: Person(p.keypoints / f.shape[1], p.scores))), "pixels of the frame"),
        (Bright(_each(lambda f, p: Person(p.keypoints + 5000, p.scores))), "far outside"),
        (Bright(_each(_half)), "NaN in both"),
        (Bright(lambda frames, found: found[:1] * len(found)), "in the same frame alone"),
        (Bright(lambda frames, found: found if len(frames) < 3 else found[::-1]), "the same frame alone"),
        (Bright(lambda frames, found: found or 1 / 0), "raises ZeroDivisionError"),
        (
            Bright(_each(lambda f, p: p if f.flags.c_contiguous else Person(p.keypoints + 1, p.scores))),
            "window",
        ),
        (Bright(_each(lambda f, p: p if f.size > 3 else [][0])), "one pixel raises IndexError"),
        (Bright(_paint), "changes the frame"),
    ],
)
def test_a_wrong_backend(backend: Bright, message: str) -> None:
    assert not faults("pose", Bright())
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("pose", backend)))


def test_a_backend_that_knows_no_words_for_people() -> None:
    class Deaf(Bright):
        def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> Any:
            return super().estimate(frames)

    assert "must raise a GestureError" in "\n".join(faults("pose", Deaf()))


# ---------------------------------------------------------------------------------------------- engines


@dataclass
class Straight:
    """A right engine, in this process; ``spoil`` makes it a wrong one."""

    spoil: Callable[[list[Outcome]], Any] = lambda outcomes: outcomes
    reports: Callable[[Task, int], tuple[Any, int]] = lambda task, count: (task, count)
    once: bool = False
    runs: int = 0

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Any, int], None]
    ) -> Iterator[Outcome]:
        self.runs += 1
        assert not self.once or self.runs == 1, "it runs only once"
        outcomes = []
        for task in tasks:

            def report(message: dict[str, Any], task: Task = task) -> None:
                if "frames" in message:
                    on_frames(*self.reports(task, message["frames"]))

            outcomes.append(Worker(job, report).perform(task))
        yield from self.spoil(outcomes)


def _raise(outcomes: list[Outcome]) -> list[Outcome]:
    for outcome in outcomes:
        if outcome.error:
            raise outcome.error
    return outcomes


@pytest.mark.parametrize(
    ("engine", "message"),
    [
        (Straight(lambda outcomes: outcomes[:2]), r"tasks \[0, 1\], expected one of each of \[0, 1, 2\]"),
        (Straight(lambda outcomes: outcomes * 2), r"tasks \[0, 0, 1, 1, 2, 2\]"),
        (Straight(lambda outcomes: [replace(o, value=".csv") for o in outcomes]), "that of its own task"),
        (
            Straight(lambda outcomes: [replace(o, error=PluginError("no")) for o in outcomes]),
            "can be performed",
        ),
        (Straight(lambda outcomes: [replace(o, error=None) for o in outcomes]), "a task that fails"),
        (Straight(_raise), "raises PluginError"),
        (Straight(once=True), "raises AssertionError: it runs only once"),
        (Straight(reports=lambda task, count: (task.number, count)), "expected a task"),
        (Straight(reports=lambda task, count: (replace(task, number=0), count)), "for every task"),
    ],
)
def test_a_wrong_engine(engine: Straight, message: str) -> None:
    assert not faults("engine", Straight())
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("engine", engine)))


def test_an_engine_that_reports_no_progress() -> None:
    class Silent(Straight):
        def run(
            self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Any, int], None]
        ) -> Iterator[Outcome]:
            return super().run(job, tasks, lambda task, count: None)

    assert "does not call on_frames" in "\n".join(faults("engine", Silent()))


# ---------------------------------------------------------------------------------------- video readers


@dataclass
class Screen:
    """A right reader of what `draw_video` writes; ``frames`` and ``changes`` make it a wrong one."""

    frames: Callable[[list[tuple[float, np.ndarray]]], Any] = lambda items: items
    info: dict[str, Any] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
    limited: bool = True
    errors: type[Exception] = MediaError

    def open(self, path: Path, limits: VideoLimits) -> Video:
        if not path.is_file() or not path.read_bytes().startswith(b"RIFF"):
            raise self.errors("no AVI file")
        return Playing(self, path, limits if self.limited else VideoLimits())


class Playing:
    """One open video of a `Screen`."""

    def __init__(self, screen: Screen, path: Path, limits: VideoLimits) -> None:
        self.screen, self.video = screen, open_video(path, "opencv", limits)

    @property
    def info(self) -> VideoInfo:
        return replace(self.video.info, **self.screen.info)

    @property
    def report(self) -> VideoReport:
        return replace(self.video.report, **self.screen.report)

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        first = next(items := iter(self.video))
        yield from self.screen.frames([first])
        yield from self.screen.frames(list(items))

    def __enter__(self) -> Video:
        return self

    def __exit__(self, *error: object) -> None:
        self.video.__exit__(*error)


def _one_buffer(items: list[tuple[float, np.ndarray]], buffer: list[np.ndarray] = []) -> Any:  # noqa: B006
    buffer += [] if buffer else [items[0][1].copy()]
    for seconds, frame in items:
        buffer[0][:] = frame
        yield seconds, buffer[0]


@pytest.mark.parametrize(
    ("reader", "message"),
    [
        (Screen(info={"width": 63}), r"shape \(48, 64, 3\)"),
        (Screen(info={"rotation": 45}), "quarter turns"),
        (Screen(info={"fps": 0.0}), "fps is 0.0"),
        (Screen(info={"reader": "other"}), "expected its name"),
        (Screen(report={"frames_read": 3}), "frames_read is 3 after 12 frames"),
        (Screen(report={"damaged": 1}), "undamaged video is not complete"),
        (Screen(report={"complete": True}), "before the video was read to its end"),
        (Screen(report={"complete": True, "damaged": 0}), "counts as complete, with"),
        (Screen(lambda items: []), "gives no frame"),
        (Screen(lambda items: [(at, frame / 255) for at, frame in items]), "no uint8 array"),
        (Screen(lambda items: [(-at, frame) for at, frame in items]), "never decrease"),
        (Screen(lambda items: [(1000 * at, frame) for at, frame in items]), "they are seconds"),
        (Screen(_one_buffer), "written over"),
        (
            Screen(lambda items: [(at + np.random.default_rng().random() / 1e4, f) for at, f in items]),
            "times differ",
        ),
        (Screen(limited=False), "expected a MediaError"),
        (Screen(errors=KeyError), "raises KeyError"),
    ],
)
def test_a_wrong_video_reader(reader: Screen, message: str) -> None:
    assert not faults("video", Screen())
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("video", reader)))


@pytest.mark.parametrize("kind", ["normalizer", "filter", "selector", "writer", "pose", "engine", "video"])
def test_what_is_no_plugin_at_all_is_said_to_lack_its_methods(kind: str) -> None:
    with pytest.raises(AssertionError, match=r"has no method|lacks"):
        checks_for(kind)[0](object())
