"""The rows of a run as a page shows them: with truth, previews, and the alignments to two examples."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gesture_core import __version__
from gesture_core.classify.explanation import Explanation, explain
from gesture_core.classify.recognizer import Recognizer
from gesture_core.errors import GestureError
from gesture_core.files import printable
from gesture_core.report.alignments import alignment_record
from gesture_core.report.channel_names import ChannelNames
from gesture_core.report.row_previews import Preview, RowPreviews
from gesture_core.run.annotations import event_of
from gesture_core.run.extract import Listener, people_of
from gesture_core.run.fingerprint import differences
from gesture_core.run.found_again import GONE, look_again
from gesture_core.run.inputs import Input
from gesture_core.run.labels import label_inputs
from gesture_core.run.results import open_results
from gesture_core.run.store import Extracted
from gesture_core.run.workers.decision import open_fitted
from gesture_core.settings import Settings, load_settings, presets, settings_from_dict
from gesture_core.signals.chain import Chain
from gesture_core.spot.explanation import EventExplainer
from gesture_core.types import PoseSequence, Recording, Row, Signals

COLUMNS = (
    "input", "person", "event", "label", "status", "code", "message", "note", "distance", "margin",
    "confidence", "score", "start", "end", "length", "near", "far", "clip", "seconds", "missing", "truth",
)  # fmt: skip
"""Of a row of the page; ``near`` and ``far`` are positions among the examples."""
UNALIGNED = (
    "no row is aligned: the fitted examples of the run are gone, or of another version; "
    "gesture explain fits them again for one input, a new run for all"
)
_BATCH = 64


@dataclass
class PageRows:
    """What a page shows.

    Attributes
    ----------
    facts : dict
        About the run, and the examples.
    rows : list of lists
        Values of `COLUMNS`.
    details : list of (dict or None)
        From `alignments.alignment_record`, beside the rows.
    keys : list of (bytes, int, int)
        Key of the input, person and event of each row.
    previews : int
    missing : mapping
        Why a row has no preview, and of how many.
    """

    facts: dict[str, Any]
    rows: list[list[Any]]
    details: list[dict[str, Any] | None]
    keys: list[tuple[bytes, int, int]]
    previews: int = 0
    missing: Mapping[str, int] = field(default_factory=dict)
    columns: tuple[str, ...] = COLUMNS


def read_rows(
    run: Path,
    clips: Path,
    labels: str = "",
    label_columns: str = "",
    *,
    previews: bool = True,
    workers: int = 0,
    listener: Listener | None = None,
) -> PageRows:
    """All rows of a run for a page; the parameters are those of `run_page.write_report`."""
    with open_results(run) as results, results.failures():
        keyed = list(results.keyed_rows())
        configuration = results.configuration
        fingerprint = results.get("fingerprint") or ""
    recognizer = open_fitted(run, fingerprint, configuration.get("examples", ()))
    settings = recognizer.settings if recognizer else settings_from_dict(configuration["settings"])
    examples = {
        name: _Example(index, name, one)
        for index, (name, one) in enumerate(configuration["examples"].items())
    }
    page = _Page(run, settings, examples, recognizer, RowPreviews(settings, clips))
    rows = [_PageRow(key, row) for key, row in keyed]
    page.find(rows, labels, label_columns)
    page.look(rows, listener or Listener(), previews=previews, workers=workers)
    spotted = any(row.event or row.code == "E_NO_EVENT" for _, row in keyed)
    facts = {
        "version": __version__,
        "run": run.absolute().name,
        "preset": _preset(settings),
        "kind": "events" if spotted else "labels" if examples else "keypoints",
        "sureness": _sureness([row for _, row in keyed]),
        "margin_is": "score" if settings.classify.votes == 0 else "distance",
        "margin": settings.classify.margin,
        "min_score": settings.classify.min_score,
        "confidence": settings.classify.confidence,
        "reject": settings.classify.reject,
        "spot": _event_threshold(settings),
        "network": settings.pose.model,
        "unaligned": UNALIGNED if examples and not spotted and recognizer is None else "",
        "fingerprint": fingerprint,
        "labels": sorted({one.label for one in examples.values()}),
        "examples": [one.record() for one in examples.values()],
    }
    missing = Counter(one.missing for one in rows if one.missing)
    return PageRows(
        facts, [one.record() for one in rows], [one.detail for one in rows],
        [(one.key, one.row.person, one.row.event) for one in rows],
        len({one.preview.name for one in rows if one.preview and not one.missing}), missing,
    )  # fmt: skip


@dataclass
class _Example:
    """An example of the run."""

    index: int
    name: str
    known: Mapping[str, Any]
    start: float = 0.0
    preview: Preview | None = None
    seen: tuple[Input, Extracted, PoseSequence] | None = None

    @property
    def label(self) -> str:
        return str(self.known["label"])

    def record(self) -> list[Any]:
        clip = (self.preview.name, round(self.preview.seconds, 3)) if self.preview else ("", 0)
        return [printable(self.name), self.label, *clip]


@dataclass
class _PageRow:
    """A row of the run, and what the page shows beside it."""

    key: bytes
    row: Row
    near: int | None = None
    far: int | None = None
    preview: Preview | None = None
    missing: str = ""
    truth: str | None = None
    detail: dict[str, Any] | None = None

    def record(self) -> list[Any]:
        row, shown = self.row, None if self.missing else self.preview
        clip = (shown.name, round(shown.seconds, 3)) if shown else ("", 0)
        known = (row.distance, row.margin, row.confidence, row.score)
        numbers = [None if value is None else float(f"{value:.6g}") for value in known]
        times = [None if v is None else round(v, 3) for v in (row.start, row.end)]
        return [
            row.input, row.person, row.event, row.label, row.status, row.code, row.message, row.note,
            *numbers, *times, round(row.seconds, 3), self.near, self.far, *clip, self.missing, self.truth,
        ]  # fmt: skip


@dataclass
class _Page:
    run: Path
    settings: Settings
    examples: dict[str, _Example]
    recognizer: Recognizer | None
    previews: RowPreviews
    _items: dict[str, Input] = field(default_factory=dict)
    _events: EventExplainer | None = None

    def find(self, rows: Sequence[_PageRow], labels: str, columns: str) -> None:
        """Look for the inputs where the run found them, and for their labels."""
        places = {one.row.input: os.fsdecode(one.key.partition(b"\0")[0]) for one in rows}
        self._items = {name: item for name, item in look_again(places, self.settings).items() if item}
        if labels:
            items = list(self._items.values())
            roots = [os.path.commonpath([item.path.absolute().parent for item in items])] if items else []
            truth = {item.key: item.label for item in label_inputs(items, labels, roots, columns)}
            for one in rows:
                item = self._items.get(one.row.input)
                one.truth = truth.get(item.key) if item else None
        for one in rows:
            one.missing = "" if one.row.input in self._items else GONE
            near = [(name, label) for name, label, _ in one.row.neighbors if name in self.examples]
            winner = one.row.label or (near[0][1] if near else None)
            one.near = next((self.examples[name].index for name, label in near if label == winner), None)
            one.far = next((self.examples[name].index for name, label in near if label != winner), None)

    def look(self, rows: Sequence[_PageRow], listener: Listener, *, previews: bool, workers: int) -> None:
        """Take keypoints from the store, align, and make previews."""
        self._find_examples(listener, workers)
        of_input: dict[bytes, list[_PageRow]] = {}
        for row in rows:
            if row.row.input in self._items:
                of_input.setdefault(self._items[row.row.input].key, []).append(row)
        for batch in self._batches(of_input, listener, workers):
            self._align(batch)
        if not previews:
            for row in rows:
                row.missing = "previews were switched off"
            return
        named = {place for row in rows for place in (row.near, row.far)}
        shown = [one for one in self.examples.values() if one.index in named]
        for one in shown:
            if one.seen is not None:
                item, found, pose = one.seen
                one.preview = self.previews.want(
                    item, found.sha256, found.stored, pose.person, *_stretch(pose)
                )
        previews_of = [*(row.preview for row in rows), *(one.preview for one in shown)]
        wanted = {preview.name for preview in previews_of if preview}
        listener.planned(len(wanted), len(wanted), 0, "")
        listener.stage("previews")
        reasons = self.previews.make(workers, lambda name: listener.extracted(name, cached=False))
        for row in rows:
            row.missing = reasons.get(row.preview.name, "") if row.preview else row.missing
        for one in shown:
            one.preview = None if one.preview and one.preview.name in reasons else one.preview

    def _find_examples(self, listener: Listener, workers: int) -> None:
        """The keypoints of the examples that are still what they were."""
        by_key: dict[bytes, list[_Example]] = {}
        items: dict[bytes, Input] = {}
        places = {one.name: one.known["path"] for one in self.examples.values() if "path" in one.known}
        there = look_again(places, self.settings)
        for one in self.examples.values():
            item = there.get(one.name)
            if item and item.readable:
                by_key.setdefault(item.key, []).append(one)
                items[item.key] = item
        for item, found, people in people_of(
            list(items.values()), self.settings, workers=workers, listener=listener
        ):
            for one in by_key[item.key]:
                if people and found.sha256 == one.known["sha256"]:
                    one.seen, one.start = (item, found, people[0]), _stretch(people[0])[0]

    def _batches(
        self, of_input: Mapping[bytes, list[_PageRow]], listener: Listener, workers: int
    ) -> Iterator[list[tuple[_PageRow, Signals, float]]]:
        """Rows with their signals and where their previews begin, as the keypoints come."""
        chain = Chain.from_settings(self.settings)
        batch: list[tuple[_PageRow, Signals, float]] = []
        readable = [item for item in self._items.values() if item.readable]
        readable = list({item.key: item for item in readable}.values())
        for item, found, people in people_of(readable, self.settings, workers=workers, listener=listener):
            by_number = {pose.person: pose for pose in people}
            for one in of_input[item.key]:
                if found.sha256 != one.row.sha256:
                    one.missing = found.message or "has changed since the run"
                    continue
                pose = by_number.get(one.row.person)
                start = one.row.start or 0.0
                self._want(one, item, found, pose)
                if (
                    self.recognizer is not None
                    and pose
                    and one.row.distance is not None
                    and not one.row.event
                ):
                    try:
                        batch.append((one, chain(pose), start))
                    except GestureError:
                        continue  # its row says why
                elif pose and one.row.event:
                    self._align_event(one, pose, start)
            if len(batch) >= _BATCH:
                yield batch
                batch = []
        yield batch

    def _want(
        self, one: _PageRow, item: Input, found: Extracted, pose: PoseSequence | Recording | None
    ) -> None:
        if isinstance(pose, Recording):
            one.missing = "channels have no picture"
        elif pose is not None:
            start, end = _stretch(pose)
            if one.row.event and one.row.start is not None and one.row.end is not None:
                start, end = one.row.start, one.row.end
            one.preview = self.previews.want(item, found.sha256, found.stored, pose.person, start, end)
        elif item.kind == "video" and found.frames_read:
            one.preview = self.previews.want(item, found.sha256, found.stored, None, 0.0, found.seconds)
        else:
            one.missing = one.row.code or "nobody was found"

    def _align(self, batch: Sequence[tuple[_PageRow, Signals, float]]) -> None:
        if not batch or self.recognizer is None:
            return
        recognizer = self.recognizer
        starts = {one.name: one.start for one in self.examples.values()}
        distances = recognizer.distances([signals for _, signals, _ in batch])
        for (one, signals, start), row in zip(batch, distances, strict=True):
            try:
                found = explain(signals, recognizer.library, row, self.settings, recognizer.fitted)
            except GestureError:
                continue  # nothing could be compared, as its row says
            self._keep(one, found, start, starts)

    def _align_event(self, one: _PageRow, pose: PoseSequence, start: float) -> None:
        try:
            if self._events is None:
                seen = {name: known.seen[2] for name, known in self.examples.items() if known.seen}
                labels = [self.examples[name].label for name in seen]
                self._events = EventExplainer(list(seen.values()), labels, list(seen), self.settings)
            found = self._events(event_of(one.row), pose)
        except GestureError:
            return  # its example is not there any more, or it was found by other settings
        self._keep(one, found, start, {one.name: one.start for one in self.examples.values()})

    def _keep(self, one: _PageRow, found: Explanation, start: float, starts: dict[str, float]) -> None:
        names = ChannelNames(self.settings, spotted=bool(one.row.event))
        one.detail = alignment_record(found, start, starts, names)
        one.near = self.examples[found.nearest.example].index
        one.far = self.examples[found.runner_up.example].index if found.runner_up else None


def _stretch(pose: PoseSequence) -> tuple[float, float]:
    """Seconds of the first and the last frame in which somebody is seen."""
    times = pose.times[pose.seen.any(axis=1)]
    return float(times[0]), float(times[-1])


def _sureness(rows: Sequence[Row]) -> str:
    """The column that says how certain the rows are.

    Of events their score, where it was calibrated the probability, otherwise the margin, which is none.
    """
    if any(row.event for row in rows):
        return "score"
    return "margin" if all(row.confidence is None for row in rows) else "confidence"


def _event_threshold(settings: Settings) -> tuple[str, float]:
    """The setting that says how far an event may be, to which a score is a share, and its value."""
    chosen = settings.spot
    if chosen.threshold is not None:
        return "spot.threshold", chosen.threshold
    return "spot.tolerance", chosen.tolerance


def _preset(settings: Settings) -> str:
    """The preset of the package that is most like the settings of a run, which do not name theirs."""
    own = {"settings": settings.as_dict()}
    every = {name: {"settings": load_settings(name, environment={}).as_dict()} for name in presets()}
    return min(every, key=lambda name: len(differences(every[name], own)))
