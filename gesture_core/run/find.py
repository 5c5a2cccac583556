"""Query by example over an archive or a run: `find`."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import Code, ConfigError, GestureError, InputError
from gesture_core.files import usable_cores
from gesture_core.records import Job, Task
from gesture_core.run.archive import Sources, as_strings, with_changes
from gesture_core.run.extract import Listener, extract_all, first_person
from gesture_core.run.found_again import find_inputs
from gesture_core.run.inputs import Input, discover
from gesture_core.run.results import DATABASE, open_results
from gesture_core.run.store import Extracted, keypoint_store
from gesture_core.run.workers.engines import ProcessEngine
from gesture_core.settings import Settings, settings_from_dict
from gesture_core.spot.find import Hit, Query
from gesture_core.spot.signals import stream_chain

if TYPE_CHECKING:
    from gesture_core.run.workers.worker import Worker

_BATCH = 64
"""Inputs that are searched while others wait."""


@dataclass(frozen=True)
class Findings:
    """What came of a search.

    Attributes
    ----------
    hits : list of Hit
        Nearest first.
    inputs : int
        Recordings that were searched, of one frame at least.
    failed : dict
        Why others were not, by their names: the code and the message.
    notes : dict
        What of a recording was not searched, by its name.
    frames, warped : int
        Frames of people, or samples of channels, that were searched, and those that no bound could rule out.
    of_channels : bool
    """

    hits: list[Hit] = field(default_factory=list)
    inputs: int = 0
    failed: dict[str, tuple[str, str]] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)
    frames: int = 0
    warped: int = 0
    of_channels: bool = False


def find(
    clip: str | os.PathLike[str],
    archive: Sources,
    settings: Settings | str | None = None,
    *,
    top: int = 50,
    workers: int = 0,
    listener: Listener | None = None,
    **changes: Any,
) -> Findings:
    """Where in an archive somebody does what a clip shows: `gesture find` as a function.

    Keypoints come from the keypoint store; those that are not there are extracted first. The first person of
    the clip is looked for, also faster and slower (``spot.tempos``), in every person of every recording.

    Parameters
    ----------
    clip : path
        A clip of one movement.
    archive : path or sequence of paths
        Recordings as in `classify_archive`, or a run folder: then its inputs, by its settings unless there
        are others.
    settings, workers, changes
        As in `load_poses`.
    top : int
        How many places.
    listener : Listener, optional
        Told about the work as it goes on.

    Raises
    ------
    InputError
        Where the clip is none, nobody is in it, or there is nothing to search.

    Examples
    --------
    >>> from gesture_core import find
    >>> found = find("examples/wave/1", "examples/", top=3)
    >>> found.hits[0].input, found.hits[0].distance < 1e-6
    ('examples/wave/1', True)
    """
    if top < 1:
        raise InputError(f"top is {top}", remedy="1 or more", code="E_OPTION")
    listener = listener or Listener()
    sources = as_strings(archive)
    ready = with_changes(settings, changes)
    items: list[Input] = []
    failed: dict[str, tuple[str, str]] = {}
    if len(sources) == 1 and (Path(sources[0]) / DATABASE).is_file():
        with open_results(sources[0]) as results:
            names = dict.fromkeys(row.input for row in results.rows() if row.code != Code.NOT_AN_INPUT)
            places = {name: results.place_of(name) for name in names}
            configuration = results.configuration
        if settings is None and not changes:
            ready = settings_from_dict(configuration["settings"])
        for name, known in find_inputs(places, ready).items():
            if isinstance(known, GestureError):
                failed[name] = known.code, known.message
            else:
                items.append(replace(known, name=name))
    else:
        items = discover(sources, settings=ready)
    failed |= {item.name: (item.code, item.fault) for item in items if item.kind == "broken"}
    if strangers := [item.name for item in items if item.kind == "other"]:
        shown = ", ".join(strangers[:5]) + (", …" if strangers[5:] else "")
        warnings.warn(f"left out, neither video nor keypoints: {shown}", stacklevel=2)
    readable = [item for item in items if item.readable]
    if not readable:
        why = next((f": {item.name}: {item.fault}" for item in items if item.fault), "")
        raise InputError(f"holds no recording{why}", subject=", ".join(sources), code="E_EMPTY")
    stream_chain(ready)  # refuses settings under which nothing can be found, before anything is extracted
    query = _query(clip, ready, listener)
    found = Findings(failed=failed, of_channels=ready.signals.input == "channels")
    with _Workers(query, ready, top, workers or usable_cores()) as search:
        waiting: list[tuple[Input, Extracted]] = []
        for item, extracted in extract_all(readable, ready, workers=workers, listener=listener):
            if extracted.code:
                failed[item.name] = extracted.code, extracted.message
            elif extracted.people:
                waiting.append((item, extracted))
            else:
                found.notes[item.name] = "nobody was found"
            if len(waiting) >= _BATCH:
                found = search.add(found, waiting)
                waiting = []
        found = search.add(found, waiting)
    return found


def _query(clip: str | os.PathLike[str], settings: Settings, listener: Listener) -> Extracted:
    """The keypoints of the clip, in the store."""
    items = discover([clip], settings=settings)
    if len(items) != 1 or not items[0].readable:
        cause = items[0].fault if len(items) == 1 and items[0].fault else f"holds {len(items)} inputs"
        raise InputError(cause, subject=os.fspath(clip), remedy="one clip", code="E_INPUT")
    (item,) = items
    return first_person(item, settings, listener=listener)[0]


class Searcher:
    """The search, as functions of the table."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._query: Query | None = None

    def open_query(self, stored: str, name: str, top: int) -> None:
        """Take the first person of a stored clip as what is looked for."""
        self._worker.slow()
        self._query = Query(self._worker.people(stored, name)[0], self._worker.settings, top)

    def find(self, name: str, stored: str) -> dict[str, Any]:
        """The places in a stored input that are among the nearest of all that this worker has searched.

        A dict of ``hits``, ``notes``, ``frames``, ``warped`` and the ``code`` and ``message`` of an error.
        """
        assert self._query is not None, "open_query comes first"
        query, before = self._query, (self._query.frames, self._query.warped)
        found: dict[str, Any] = {"hits": [], "notes": [], "code": "", "message": ""}
        self._worker.slow()
        for pose in self._worker.people(stored, name):
            try:
                hits, note = query.search(pose, self._worker.alive)
            except ConfigError:
                raise
            except GestureError as error:
                found |= {"code": error.code, "message": error.message}
                continue
            found["hits"] += [asdict(hit) for hit in hits]
            found["notes"] += [note] if note else []
        found["frames"], found["warped"] = query.frames - before[0], query.warped - before[1]
        return found


class _Workers:
    """Workers that know the query, as a context manager."""

    def __init__(self, query: Extracted, settings: Settings, top: int, workers: int) -> None:
        self._engine = ProcessEngine(workers, settings.limits)
        arguments = {"stored": query.stored, "name": "the clip", "top": top}
        self._engine.first.append(Task(0, "open_query", arguments))
        self._job = Job(settings.as_dict(), str(keypoint_store()))
        self._top = top

    def __enter__(self) -> _Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()

    def add(self, found: Findings, some: Sequence[tuple[Input, Extracted]]) -> Findings:
        """``found`` and what is in further inputs."""
        hits, inputs, frames, warped = list(found.hits), found.inputs, found.frames, found.warped
        tasks = [
            Task(number, "find", {"name": item.name, "stored": extracted.stored})
            for number, (item, extracted) in enumerate(some)
        ]
        for outcome in self._engine.run(self._job, tasks, lambda task, frames: None):
            (item, _), value = some[outcome.number], outcome.value
            if outcome.error:
                found.failed[item.name] = outcome.error.code, outcome.error.message
                continue
            hits += [Hit(**hit) for hit in value["hits"]]
            inputs += value["frames"] > 0
            frames, warped = frames + value["frames"], warped + value["warped"]
            if value["notes"]:
                found.notes[item.name] = "; ".join(value["notes"])
            if value["code"]:
                found.failed[item.name] = value["code"], value["message"]
        return replace(found, hits=sorted(hits)[: self._top], inputs=inputs, frames=frames, warped=warped)
