"""What workers do: a table of functions by name. All of them may run a third party's code.

Arguments and values are plain, fit for JSON; paths travel as their bytes in hexadecimal digits (`encoded`).
The same table is called in this process, in a process beside it, or elsewhere.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, GestureError, PluginError, PoseError
from gesture_core.plugin.abilities import ExplainsRefusal
from gesture_core.plugin.registry import calling, registry
from gesture_core.run.workers.worker import Worker

Answer = bool | tuple[str, str]
"""Whether a reader takes a file; or the code and the cause of its failure to say so."""


def encoded(path: str | os.PathLike[str]) -> str:
    """The exact bytes of a path, as text."""
    return os.fsencode(path).hex()


def decoded(text: str) -> Path:
    """The inverse of `encoded`."""
    return Path(os.fsdecode(bytes.fromhex(text)))


def try_model(worker: Worker) -> None:
    """Run the pose network twice on a picture of a figure; a GestureError says what is wrong with its answer.

    Whether it finds anybody does not count: that both answers are equal, and of the right form, does.
    """
    import numpy as np

    from gesture_core.skeletons import skeleton

    backend = worker.extractor.backend
    picture = np.full((240, 320, 3), 90, np.uint8)
    picture[:, 110:210] += np.arange(240, dtype=np.uint8)[:, None, None] // 4
    picture[30:70, 145:175] = (140, 170, 210)  # a head above a trunk, arms and legs
    picture[75:150, 135:185] = (60, 60, 180)
    picture[80:95, 80:240] = (140, 170, 210)
    picture[150:230, 137:157] = picture[150:230, 163:183] = (120, 80, 50)
    with calling(backend):
        answers = [backend.estimate([picture], worker.settings.pose.people) for _ in range(2)]
    width = len(skeleton(backend.skeleton).joints)
    for answer in answers:
        if len(answer) != 1:
            raise PoseError(f"answered with {len(answer)} pictures for one", code="E_MODEL_PROBE")
        for person in answer[0]:
            if np.shape(person.keypoints) != (width, 2) or np.shape(person.scores) != (width,):
                raise PoseError(
                    f"keypoints {np.shape(person.keypoints)} and scores {np.shape(person.scores)} "
                    f"for {width} joints",
                    code="E_MODEL_PROBE",
                )
            if np.isinf(person.keypoints).any() or not np.isfinite(person.scores).all():
                raise PoseError("infinite keypoints or scores", code="E_MODEL_PROBE")
    first, second = (np.array([p.keypoints for p in answer[0]]) for answer in answers)
    if first.shape != second.shape or not np.allclose(first, second, atol=0.01, equal_nan=True):
        raise PoseError("two answers to one picture differ", code="E_MODEL_PROBE")


def extract(worker: Worker, path: str, member: str, reader: str, address: str = "") -> dict[str, Any]:
    """Keypoints of one input into the store; the fields of `keypoints.Extracted`."""
    return asdict(worker.extractor(decoded(path), member, reader, address))


def lasts(worker: Worker, path: str) -> float | None:
    """Seconds of a video by what its container says, None where it does not."""
    from gesture_core.plugin.interfaces import VideoLimits
    from gesture_core.video import open_video

    chosen = worker.settings
    limits = VideoLimits(chosen.limits.pixels, chosen.limits.frames)
    with open_video(decoded(path), chosen.pose.reader, limits, chosen.options, chosen.video) as video:
        info = video.info
    return info.frames_declared / info.fps if info.frames_declared and info.fps else None


def accepts(worker: Worker, reader: str, paths: Sequence[str]) -> list[Answer]:
    """For each path whether the reader takes it, or what went wrong."""
    answers: list[Answer] = []
    for path in paths:
        try:
            with calling(registry().find("reader", reader), passing=(OSError,)):
                answers.append(bool(worker.extractor.reader(reader).accepts(decoded(path))))
        except GestureError as error:
            answers.append((error.code, error.cause))
        except OSError as error:
            title = registry().find("reader", reader)
            answers.append(("E_READ", f"{title} cannot read it: {error.strerror or error}"))
        worker.alive()
    return answers


def refusal(worker: Worker, reader: str, path: str) -> str:
    """Why a reader does not take a file; empty where it does not say."""
    with calling(registry().find("reader", reader), passing=(OSError,)):
        opened = worker.extractor.reader(reader)
        return str(opened.refusal(decoded(path))) if isinstance(opened, ExplainsRefusal) else ""


def members(worker: Worker, reader: str, path: str) -> list[str]:
    """Names of the sequences in a file or folder, one at least."""
    entry = registry().find("reader", reader)
    with calling(entry):
        found = list(worker.extractor.reader(reader).members(decoded(path)))
    if not found or not all(isinstance(member, str) for member in found):
        cause = f"{entry} says that its members are {str(found)[:80]}"
        raise PluginError(cause, code="E_PLUGIN_CONTRACT")
    return found


def open_classifier(worker: Worker) -> str:
    """Make the chain and the kernel that the settings name; the kernel's name."""
    worker.report({"slow": True})
    return worker.decider.kernel


def add_example(worker: Worker, name: str, label: str, stored: str) -> None:
    """Take an example from the keypoint store."""
    worker.report({"slow": True})
    worker.decider.add(name, label, _people(worker, stored, name))


def fit(worker: Worker, run: str, fingerprint: str) -> str:
    """Compare the examples, where the decision needs it, and leave what is fitted in the run folder.

    What is worth knowing of it, mostly empty.
    """
    worker.report({"slow": True})
    return worker.decider.fit(decoded(run), fingerprint, worker.alive)


def open_fitted(worker: Worker, run: str, fingerprint: str, names: Sequence[str]) -> bool:
    """Take what `fit` has left in the run folder; False where that is of other settings or examples."""
    worker.report({"slow": True})
    return worker.decider.open(decoded(run), fingerprint, names)


def keep_distances(worker: Worker, run: str) -> None:
    """Leave the distances of this run in its folder."""
    worker.decider.keep(decoded(run))


def decide(worker: Worker, inputs: Sequence[Mapping[str, Any]]) -> list[list[dict[str, Any]]]:
    """The predictions for everybody in each of some stored inputs (``name``, ``stored``, ``people``)."""
    people: list[list[Any]] = []
    for one in inputs:
        try:
            people.append(list(_people(worker, one["stored"], one["name"])))
        except GestureError as error:
            people.append([error] * one["people"])
    poses = [pose for some in people for pose in some if not isinstance(pose, GestureError)]
    predictions = iter(worker.decider.predict(poses))
    return [
        [
            {"status": "error", "code": pose.code, "message": pose.message}
            if isinstance(pose, GestureError)
            else asdict(next(predictions))
            for pose in some
        ]
        for some in people
    ]


def spot(worker: Worker, inputs: Sequence[Mapping[str, Any]]) -> list[list[dict[str, Any]]]:
    """The ``events`` of everybody in each of some stored inputs, or what a `Prediction` says of an error."""
    answers: list[list[dict[str, Any]]] = []
    for one in inputs:
        answers.append([])
        worker.report({"slow": True})
        for pose in _people(worker, one["stored"], one["name"]):
            try:
                events, note = worker.decider.spot(pose, worker.alive)
                answers[-1].append({"events": [asdict(event) for event in events], "note": note})
            except ConfigError:
                raise
            except GestureError as error:
                answers[-1].append({"status": "error", "code": error.code, "message": error.message})
    return answers


def draw_previews(
    worker: Worker, path: str, video: bool, stored: str, cuts: Sequence[tuple[str, int | None, float, float]]
) -> None:
    """Write previews of one input: of each cut its file, the person, start and end in seconds."""
    from gesture_core.run.workers.previews import Cut, draw_cuts, open_cuts

    worker.report({"slow": True})
    people = _people(worker, stored, "") if stored else ()
    frames = open_cuts(decoded(path), worker.settings) if video else None
    wanted = [Cut(decoded(file), person, start, end) for file, person, start, end in cuts]
    draw_cuts(wanted, people, frames, worker.alive)


def open_query(worker: Worker, stored: str, name: str, top: int) -> None:
    """Take the first person of a stored clip as what is looked for."""
    from gesture_core.spot.find import Query

    worker.report({"slow": True})
    worker.query = Query(_people(worker, stored, name)[0], worker.settings, top)


def find(worker: Worker, name: str, stored: str) -> dict[str, Any]:
    """The places in a stored input that are among the nearest of all that this worker has searched.

    A dict of ``hits``, ``notes``, ``frames``, ``warped`` and the ``code`` and ``message`` of an error.
    """
    assert worker.query is not None, "open_query comes first"
    query, before = worker.query, (worker.query.frames, worker.query.warped)
    found: dict[str, Any] = {"hits": [], "notes": [], "code": "", "message": ""}
    worker.report({"slow": True})
    for pose in _people(worker, stored, name):
        try:
            hits, note = query.search(pose, worker.alive)
        except ConfigError:
            raise
        except GestureError as error:
            found |= {"code": error.code, "message": error.message}
            continue
        found["hits"] += [asdict(hit) for hit in hits]
        found["notes"] += [note] if note else []
    found["frames"], found["warped"] = query.frames - before[0], query.warped - before[1]
    return found


def cut(
    worker: Worker, path: str, sha256: str, clips: Sequence[Mapping[str, Any]], sound: bool
) -> list[dict[str, Any]]:
    """Write parts of a video as clips (``path`` encoded, ``start``, ``end``, ``box``); what came of each."""
    from gesture_core.run.workers import clips as writing

    def report(frames: int) -> None:
        worker.report({"frames": frames})

    parts = [{**one, "path": decoded(one["path"])} for one in clips]
    return writing.cut(decoded(path), sha256, parts, worker.settings, sound=sound, report=report)


def _people(worker: Worker, stored: str, name: str) -> Sequence[Any]:
    from gesture_core.run.store import read_keypoints

    return read_keypoints(Path(worker.job.store) / stored, name).sequences


def suffix(worker: Worker, format: str) -> str:
    """What the names of the files that a result writer writes end in."""
    with calling(registry().find("writer", format)):
        return str(registry().make("writer", format).suffix)


def write_rows(worker: Worker, run: str, format: str, path: str) -> None:
    """Write the rows of a run to a file."""
    from gesture_core.run.export import write_rows

    write_rows(decoded(run), format, decoded(path), worker.alive)


FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        try_model, extract, lasts, accepts, refusal, members, open_classifier, add_example, fit, open_fitted,
        decide, keep_distances, spot, open_query, find, cut, draw_previews, suffix, write_rows,
    )
}  # fmt: skip
"""Every function that a task may name; each takes the `Worker` and the task's arguments."""
