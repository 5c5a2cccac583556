"""The events of a run as clips, by label: `cut_events`."""

from __future__ import annotations

import hashlib
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from gesture_core.errors import ConfigError, GestureError, InputError, MissingDependencyError, RunFolderError
from gesture_core.files import printable
from gesture_core.records import Job, Row, Task, encoded
from gesture_core.run.extract import Listener, people_of
from gesture_core.run.found_again import find_inputs
from gesture_core.run.inputs import Input
from gesture_core.run.results import open_results
from gesture_core.run.store import write_keypoints
from gesture_core.run.workers.clips import SAME
from gesture_core.run.workers.engines import perform_all
from gesture_core.settings import Settings, settings_from_dict
from gesture_core.types import Recording

_ODD = re.compile(r"[^\w .=@+-]")
_LONGEST = 150
"""Bytes of a name, beside which the times have room in the 255 that file systems give."""


@dataclass(frozen=True)
class Clip:
    """One part of an input, and the file that it was cut to.

    Attributes
    ----------
    file : Path
        ``<out>/<label>/<input>_<start>-<end>.mp4``, or ``.parquet`` for keypoints and channels; the times
        are those of the clip in the recording, with the margin.
    label, input : str
    person, event : int
        As in the row.
    start, end : float
        Seconds of the event in the recording.
    status : "written", "there" or "error"
        ``there`` where the file had been written before.
    frames : int
        Of the clip, where it was written now.
    code, message : str
        Of the error.
    note : str
    """

    file: Path
    label: str
    input: str
    person: int
    event: int
    start: float
    end: float
    status: Literal["written", "there", "error"] = "there"
    frames: int = 0
    code: str = ""
    message: str = ""
    note: str = ""


def cut_events(
    run: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    label: str | None = None,
    margin: float = 0.0,
    sound: bool = False,
    workers: int = 1,
    listener: Listener | None = None,
) -> list[Clip]:
    """Write what a run has labelled as clips, in a folder for each label: `gesture cut` as a function.

    Videos are decoded again, by the run's settings, and re-encoded as H.264: a clip has every frame from
    the start of its event to the end. Of keypoints and channels, the clips are Parquet files. Each can be an
    example. No file is overwritten.

    Parameters
    ----------
    run : path
        A run of `gesture spot`, or of `gesture classify`: then a clip is the time in which the person was
        seen. Where an input has several people, a clip shows the surroundings of its own.
    out : path
        The folder.
    label : str, optional
        Only what has this label.
    margin : float
        Seconds before and after each event.
    sound : bool
        With the sound of the recording.
    workers : int
        Recordings that are decoded at a time.
    listener : Listener, optional
        Told about the work as it goes on.

    Returns
    -------
    list of Clip
        In the order of the rows. What could not be cut has the status ``error``, and costs nothing else.

    Raises
    ------
    ConfigError
        Where the margin is negative or no number.
    RunFolderError
        ``E_NO_RUN`` where the folder holds no run.
    InputError
        ``E_NOT_FOUND`` where no row has the label, or none has any.
    MissingDependencyError
        Where there are videos, and PyAV, which writes them, is not installed.
    """
    from gesture_core.video.writer import can_write_video

    listener = listener or Listener()
    if not 0 <= margin < float("inf"):
        raise ConfigError(f"a margin of {margin} s", remedy="0 or more seconds", code="E_OPTION")
    with open_results(run) as results:
        rows = list(results.rows())
        configuration = results.configuration
        places = {name: results.place_of(name) for name in dict.fromkeys(row.input for row in rows)}
    cuttable = [row for row in rows if row.label is not None and row.start is not None]
    wanted = [row for row in cuttable if label is None or row.label == label]
    if not wanted:
        raise _nothing(
            Path(run), label, {str(row.label) for row in cuttable}, "spot" in configuration["settings"]
        )
    settings = settings_from_dict(configuration["settings"])
    names = {row.input for row in wanted}
    inputs = find_inputs({name: places[name] for name in places if name in names}, settings)
    videos = any(isinstance(item, Input) and item.kind == "video" for item in inputs.values())
    if videos and not can_write_video():
        raise MissingDependencyError(
            "writing H.264 needs PyAV",
            remedy="pip install 'gesture-core[video]'",
            code="E_MISSING_DEPENDENCY",
        )
    clips = _named(rows, wanted, inputs, Path(out), margin)
    crowded = {row.input for row in rows if row.person}
    waiting: dict[str, list[int]] = defaultdict(list)
    for number, (clip, row) in enumerate(zip(clips, wanted, strict=True)):
        item = inputs[row.input]
        if isinstance(item, GestureError):
            clips[number] = _failed(clip, item)
        elif not clip.file.exists():
            waiting[row.input].append(number)
    work = _Work(settings, wanted, clips, crowded, margin, sound, listener)
    found = {name: item for name, item in inputs.items() if name in waiting and isinstance(item, Input)}
    for number, clip in work.keypoints({n: i for n, i in found.items() if i.kind == "keypoints"}, waiting):
        clips[number] = clip
    for number, clip in work.videos({n: i for n, i in found.items() if i.kind == "video"}, waiting, workers):
        clips[number] = clip
    return clips


@dataclass(frozen=True)
class _Work:
    settings: Settings
    rows: Sequence[Row]
    clips: Sequence[Clip]
    crowded: set[str]
    margin: float
    sound: bool
    listener: Listener

    def keypoints(
        self, items: Mapping[str, Input], waiting: Mapping[str, Sequence[int]]
    ) -> Iterator[tuple[int, Clip]]:
        """Cut inputs of keypoints; the clips by their numbers."""
        if not items:
            return
        names = {item.key: name for name, item in items.items()}
        for item, found, people in people_of(list(items.values()), self.settings, listener=self.listener):
            for number in waiting[names[item.key]]:
                clip, row = self.clips[number], self.rows[number]
                poses = [pose for pose in people if pose.person == row.person]
                if found.code:
                    yield number, replace(clip, status="error", code=found.code, message=found.message)
                elif found.sha256 != row.sha256 or not poses:
                    error = InputError("has changed since the run", remedy="the run again", code="E_CHANGED")
                    yield number, _failed(clip, error)
                else:
                    pose, begin, end = poses[0], clip.start - self.margin, clip.end + self.margin
                    own = pose.part((pose.times >= begin - SAME) & (pose.times <= end + SAME))
                    times = own.times - own.times[0]
                    own = replace(own, times=times)
                    own = own if isinstance(own, Recording) else replace(own, person=0)
                    frames = len(times)
                    facts: dict[str, Any] = {
                        "frames_declared": None, "frames_read": frames, "frames_looked_at": frames,
                        "complete": True, "notes": [], "seconds": float(times[-1]), "assumed": found.assumed,
                    }  # fmt: skip
                    yield number, _written(clip, own, facts)

    def videos(
        self, items: Mapping[str, Input], waiting: Mapping[str, Sequence[int]], workers: int
    ) -> Iterator[tuple[int, Clip]]:
        """Cut videos, in worker processes; the clips by their numbers."""
        if not items:
            return
        tasks, names = [], list(items)
        for place, (name, item) in enumerate(items.items()):
            parts = []
            for number in waiting[name]:
                clip, row = self.clips[number], self.rows[number]
                clip.file.parent.mkdir(parents=True, exist_ok=True)
                box = list(row.box) if name in self.crowded else []
                start, end = clip.start - self.margin, clip.end + self.margin
                parts.append({"path": encoded(clip.file), "start": start, "end": end, "box": box})
            sha256 = self.rows[waiting[name][0]].sha256
            arguments = {"path": encoded(item.path), "sha256": sha256, "clips": parts, "sound": self.sound}
            tasks.append(Task(place, "cut", arguments))
        job = Job(self.settings.as_dict(), "")
        self.listener.planned(len(tasks), len(tasks), 0, "")
        self.listener.stage("cutting")

        def report(task: Task, frames: int) -> None:
            self.listener.frames(names[task.number], frames)

        for outcome in perform_all(job, tasks, self.settings.limits, workers, report):
            name = names[outcome.number]
            self.listener.extracted(name, cached=False)
            for place, number in enumerate(waiting[name]):
                clip = self.clips[number]
                if outcome.error:
                    yield number, _failed(clip, outcome.error)
                    continue
                answer = outcome.value[place]
                status: Literal["written", "error"] = "error" if answer["code"] else "written"
                note = "; ".join(filter(None, [clip.note, answer.pop("note")]))
                yield number, replace(clip, status=status, note=note, **answer)


def _written(clip: Clip, pose: Any, facts: Mapping[str, Any]) -> Clip:
    try:
        write_keypoints(clip.file, [pose], facts)
    except OSError as error:
        cause = f"{clip.file} cannot be written: {error.strerror or error}"
        return _failed(clip, InputError(cause, remedy="free space there, or another --out", code="E_OUT"))
    return replace(clip, status="written", frames=len(pose))


def _failed(clip: Clip, error: GestureError) -> Clip:
    return replace(clip, status="error", code=error.code, message=error.reason)


def _nothing(run: Path, label: str | None, labels: set[str], spotted: bool) -> GestureError:
    if label is not None and labels:
        some = ", ".join(sorted(labels)[:10])
        return InputError(
            f"no row of the run has the label {label!r}", subject=str(run), remedy=some, code="E_NOT_FOUND"
        )
    return RunFolderError(
        "no row of the run has a label and a time",
        subject=str(run),
        remedy="a larger --set spot.tolerance=…"
        if spotted
        else "a run that gives labels: of gesture classify for clips, of gesture spot for long recordings",
        code="E_EMPTY",
    )


def _named(
    every: Sequence[Row],
    rows: Sequence[Row],
    inputs: Mapping[str, Input | GestureError],
    out: Path,
    margin: float,
) -> list[Clip]:
    """The clips with the names of their files; what the other rows of the run are decides them as well."""
    folders = _distinct(dict.fromkeys(str(row.label) for row in every if row.label is not None))
    stems = _distinct(dict.fromkeys(row.input for row in every), stem=True)
    clips = []
    for row in rows:
        assert row.start is not None and row.end is not None
        item = inputs[row.input]
        suffix = ".parquet" if isinstance(item, Input) and item.kind == "keypoints" else ".mp4"
        begin, end = max(0.0, row.start - margin), row.end + margin
        person = f"_person{row.person}" if row.person else ""
        name = f"{stems[row.input]}{person}_{begin:09.3f}-{end:09.3f}{suffix}"
        label = str(row.label)
        note = "" if folders[label] == label else f"the folder stands for the label {label}"
        file = out / folders[label] / name
        clips.append(Clip(file, label, row.input, row.person, row.event, row.start, row.end, note=note))
    return clips


def _distinct(texts: Iterable[str], *, stem: bool = False) -> dict[str, str]:
    """A file name for each text, none like another one, whatever characters the texts have."""
    plain = {text: _plain(text, stem) for text in texts}
    claims = Counter(name.casefold() for name in plain.values())
    return {
        text: name
        if claims[name.casefold()] == 1
        else f"{name}-{hashlib.sha256(text.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}"
        for text, name in plain.items()
    }


def _plain(text: str, stem: bool) -> str:
    path, _, member = text.partition("::")
    if stem:
        text = f"{Path(path).stem}-{member}" if member else Path(path).stem
    short = _ODD.sub("_", printable(text)).encode()[:_LONGEST].decode(errors="ignore")
    return short.strip(". ") or "_"
