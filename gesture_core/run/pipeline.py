"""The main job: inputs and examples in, rows out, whatever happens in between.

Examples are extracted first, then inputs; as keypoints arrive they are compared with all examples in
batches, and each input's rows are committed in one transaction.
"""

from __future__ import annotations

import hashlib
import re
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from gesture_core.classify.examples import sided_labels
from gesture_core.errors import Code, ConfigError, GestureError, InputError, KeypointError, WorkerError
from gesture_core.files import switched_on
from gesture_core.pose.models import described
from gesture_core.records import Job, Row, encoded
from gesture_core.run.addresses import drop, local_path
from gesture_core.run.extract import Listener, OpenEngine
from gesture_core.run.inputs import Input
from gesture_core.run.labels import label_folders, word
from gesture_core.run.plan import Plan, RunRequest, check_out, make_plan
from gesture_core.run.results import Results, open_results, run_folder
from gesture_core.run.rows import contradicting_row, nearer, rows_of, unread_row
from gesture_core.run.store import Extracted, keypoint_store, prune
from gesture_core.run.workers.engines import Assistant

_BATCH = 64
_TIMES = re.compile(r" \(\d+ times\)$")
_SECONDS_BETWEEN_BATCHES = 2.0
_TOGETHER = 16
"""Inputs that are decided in one call: where it ends its process, each is decided alone."""
_LONG = 4.0
"""Times the longest example from which on an input may hold several gestures."""


@dataclass(frozen=True)
class RunSummary:
    """What came of a run.

    Attributes
    ----------
    out : Path
    counts : mapping
        Number of rows by status, those of earlier runs in the same folder included.
    done_now : int
        Inputs that this run worked on; zero where there was nothing to do.
    failed_examples : tuple of Row
    elapsed : float
        Seconds.
    frames : int
        Frames that were decoded now, not taken from the keypoint store.
    kernel : str
    fingerprint : str
    lost_classes : tuple of str
        Labels of which no example can be used, or whose folder holds none: no input can get them.
    assumed : mapping
        What files do not say and was assumed, such as the frames a second of keypoints without
        times, and of how many inputs and examples that this run looked at.
    notes : mapping
        What is worth knowing of inputs and examples that this run looked at and of which nothing is lost,
        such as pixels that are not square, and of how many.
    classes : mapping
        Number of examples that can be used, by label.
    sided : tuple of str
        Labels on the left that have their like on the right, where examples also stand for the other hand.
    inputs_among_examples : int
        Inputs whose content or movement is that of an example: they find themselves.
    gone : int
        Inputs of earlier runs that are not there any more; their rows were removed.
    refused, nearer : tuple of float, str
        Of gestures farther than their threshold: how many times as far; and what would let some of them in.
    """

    out: Path
    counts: Mapping[str, int]
    done_now: int = 0
    failed_examples: tuple[Row, ...] = field(default_factory=tuple)
    elapsed: float = 0.0
    frames: int = 0
    kernel: str = ""
    fingerprint: str = ""
    lost_classes: tuple[str, ...] = ()
    assumed: Mapping[str, int] = field(default_factory=dict)
    notes: Mapping[str, int] = field(default_factory=dict)
    classes: Mapping[str, int] = field(default_factory=dict)
    sided: tuple[str, ...] = ()
    inputs_among_examples: int = 0
    gone: int = 0
    refused: tuple[float, ...] = ()
    nearer: str = ""

    @property
    def exit_code(self) -> int:
        """0 when every row is whole, 3 where there are errors, degraded rows, or examples that are lost.

        Also 3 where every input was skipped: then nothing was read.
        """
        flawed = self.counts.get("error", 0) + self.counts.get("degraded", 0)
        flawed += bool(self.counts) and set(self.counts) == {"skipped"}
        return 3 if flawed or self.failed_examples or self.lost_classes else 0

    def rows(self) -> list[Row]:
        """All rows of the run folder, ordered by input."""
        with open_results(self.out) as results:
            return list(results.rows())


def run_archive(request: RunRequest, listener: Listener | None = None) -> RunSummary:
    """Do what ``request`` asks for, as far as it has not been done yet.

    Raises
    ------
    InputError, ConfigError, PluginError, ModelError
        Before anything is done, see `plan.make_plan`; or where no example at all can be used.
    RunFolderError
        Where the run folder is held by another run, damaged, or its disk is full.
    """
    started = time.monotonic()
    listener = listener or Listener()
    check_out(request)
    job = Job(request.settings.as_dict(), str(keypoint_store()), spot=request.spot)
    with (
        run_folder(request.out),
        Results(request.out, create=True) as results,
        results.failures(),
        Assistant(job, request.settings.limits, inline=request.engine == "inline") as assistant,
    ):
        plan = make_plan(request, results, assistant)
        kernel = plan.settings.classify.kernel
        listener.planned(len(plan.inputs), len(plan.waiting), len(plan.examples), kernel)
        if plan.waiting and "video" in plan.identity:
            first = not results.counts()  # what is said once need not be said by every command
            listener.network(described(plan.settings, hint=first))
        run = _Run(request, plan, results, assistant, listener)
        if plan.waiting:
            run.work()
            if plan.files:
                plan.files.sweep()  # of what has turned out to be unreadable
            if run.frames:
                prune(keypoint_store(), request.settings.limits.cache)
        for item in (*plan.inputs, *plan.examples):
            if item.address:  # what was fetched to see whose it is, and had nothing left to do
                drop(item.path)
        failed = tuple(results.rows("example"))
        names = {row.input for row in failed}
        labelled = [item for item in plan.examples if item.label]
        classes = Counter([str(item.label) for item in labelled if item.name not in names])
        named = {str(item.label) for item in labelled}
        if request.labels == "folder":  # a folder stands for a label, whatever is in it
            named |= set(
                map(word, label_folders(plan.examples, [*map(local_path, request.examples)], request.out))
            )
        return RunSummary(
            request.out,
            results.counts(),
            done_now=len(plan.waiting),
            failed_examples=failed,
            elapsed=time.monotonic() - started,
            frames=run.frames,
            kernel=kernel,
            fingerprint=plan.fingerprint,
            lost_classes=tuple(sorted(named - classes.keys())),
            assumed=dict(run.assumed),
            notes=dict(run.notes),
            classes=dict(sorted(classes.items())),
            sided=tuple(sided_labels(classes)) if plan.settings.classify.mirror is not None else (),
            inputs_among_examples=results.copies({item.sha256 for item in plan.examples} - {""}),
            gone=plan.gone,
            refused=tuple(run.refused),
            nearer=nearer(run.refused, plan.settings.spot),
        )


@dataclass
class _Run:
    request: RunRequest
    plan: Plan
    results: Results
    assistant: Assistant
    listener: Listener
    frames: int = 0
    assumed: Counter[str] = field(default_factory=Counter)
    notes: Counter[str] = field(default_factory=Counter)
    refused: list[float] = field(default_factory=list)
    _longest: float = 0.0
    _warned: bool = False

    def work(self) -> None:
        """Extract, compare, commit, until nothing waits."""
        plan = self.plan
        for item in plan.waiting:
            if not item.readable:
                self._commit(item, [unread_row(item, plan.fingerprint)])
        readable = [item for item in plan.waiting if item.readable]
        if not readable:
            return
        examples = [item for item in plan.examples if item.readable and item.key not in plan.contradictions]
        self._look_ahead(readable, examples)
        with OpenEngine(
            plan.settings,
            plan.identity,
            most=max(len(readable), len(examples)),
            workers=self.request.workers,
            engine=self.request.engine,
            listener=self.listener,
        ) as engine:
            if plan.examples and not self._is_fitted():
                taken = {item.key: found for item, found in self._extract(engine, examples)}
                self._longest = max([found.seconds for found in taken.values()], default=0.0)
                self._fit(taken)
            arrived: list[tuple[Input, Extracted]] = []
            last = time.monotonic()
            self.listener.stage("keypoints")
            for item, found in self._extract(engine, readable):
                self._warn_of_length(item, found.seconds, self._longest)
                arrived.append((item, found))
                if len(arrived) >= _BATCH or time.monotonic() - last > _SECONDS_BETWEEN_BATCHES:
                    self._decide(arrived)
                    self.listener.stage("keypoints")
                    arrived, last = [], time.monotonic()
            self._decide(arrived)
            if plan.examples:
                self.listener.stage("writing")
                self.assistant.ask("keep_distances", {"run": encoded(self.request.out)})

    def _is_fitted(self) -> bool:
        """Whether an earlier run in this folder has fitted these examples, all of which could be used."""
        if switched_on("GESTURE_NO_CACHE") or self.request.spot:
            return False
        asked = {**self._place, "names": [item.name for item in self.plan.examples]}
        if not self.assistant.ask("open_fitted", asked, keep=True):
            return False
        for item in self.plan.examples:
            self.listener.extracted(item.name, cached=True)
        return True

    @property
    def _place(self) -> dict[str, str]:
        """Where what is fitted lies, and what it belongs to."""
        return {"run": encoded(self.request.out), "fingerprint": self.plan.fingerprint}

    def _look_ahead(self, inputs: Sequence[Input], examples: Sequence[Input]) -> None:
        """Say before hours of extraction that a video is much longer than the examples."""
        one, other = _largest_video(inputs), _largest_video(examples)
        if self.request.spot or not one or not other:
            return
        (size, item), (own, example) = one, other
        if size < own * _LONG:
            return
        try:
            lengths = [
                self.assistant.ask("lasts", {"path": encoded(one.path)}, retry=False)
                for one in (item, example)
            ]
        except GestureError:  # what is wrong with it stands in its row
            return
        if None not in lengths:
            self._warn_of_length(item, *lengths)

    def _warn_of_length(self, item: Input, seconds: float, longest: float) -> None:
        """Say of the first input that is much longer than the examples what is for such inputs."""
        if self.request.spot or self._warned or not 0 < longest * _LONG < seconds:
            return
        warnings.warn(
            f"{item.name} lasts {seconds:.0f} s, the longest example {longest:.1f} s: such inputs get one "
            "label here; gesture spot finds every gesture in them, with its start and end",
            stacklevel=2,
        )
        self._warned = True

    def _extract(self, engine: OpenEngine, items: Sequence[Input]) -> Iterator[tuple[Input, Extracted]]:
        for item, found in engine.extract(items):
            self.frames += 0 if found.cached else found.frames_read
            self.assumed.update([found.assumed] if found.assumed else [])
            self.notes.update(_TIMES.sub("", note) for note in found.notes if found.complete)
            yield item, found

    def _fit(self, found: Mapping[bytes, Extracted]) -> None:
        """Take all examples that can be used; rows say why the others cannot."""
        self.results.forget([item.key for item in self.plan.examples], role="example")
        failed, usable = [], list[bytes]()
        for item in self.plan.examples:
            row = self._example(item, found.get(item.key))
            if row is None:
                content = (str(item.label), item.sha256, item.member)
                usable.append("\0".join(content).encode("utf-8", "surrogatepass"))
                continue
            failed.append(row)
            self.results.commit(replace(item, stamp=""), [row], role="example")
            self.listener.example_failed(row)
        if not usable:
            remedy, code = "" if "; try: " in failed[0].message else "better clips", Code.of(failed[0].code)
            if code and code.plugin:
                remedy = "another version of that plugin, or settings without it"
            raise InputError(
                f"no example can be used; the first one: {failed[0].code} {failed[0].message}",
                kept="the keypoints extracted so far",
                remedy=remedy,
                code="E_EXAMPLES",
            )
        # Rows that are there must have been decided by the same examples.
        library = hashlib.sha256(b"\0".join(sorted(usable))).hexdigest()
        decided = self.results.counts().keys() & {"ok", "degraded", "rejected"}
        if self.results.get("library") not in (None, library) and decided:
            raise ConfigError(
                "other examples can be used now than when its rows were decided",
                subject=str(self.request.out),
                kept="its rows and all keypoints",
                remedy="--overwrite to decide all of them by the same examples (keypoints are reused)",
                code="E_CONFIG_CHANGED",
            )
        self.results.set({"library": library})
        self.listener.stage("fitting")
        if note := self.assistant.ask("fit", self._place, keep=True):
            warnings.warn(note, stacklevel=2)

    def _example(self, item: Input, found: Extracted | None) -> Row | None:
        """Take an example; or the row that says why it cannot be used."""
        mark = self.plan.fingerprint
        if other := self.plan.contradictions.get(item.key):
            return contradicting_row(item, other, mark)
        if found is None:
            return unread_row(item, mark)
        if found.sha256 not in ("", item.sha256):
            changed = Extracted(code="E_CHANGED", message="has changed since the run began; try: again")
            return rows_of(item, changed, None, mark)[0]
        if found.code or not found.people:
            return rows_of(item, found, None, mark)[0]
        try:
            example = {"name": item.name, "label": str(item.label), "stored": found.stored}
            self.assistant.ask("add_example", example, keep=True)
        except ConfigError:
            raise
        except GestureError as error:
            return rows_of(item, found.failed(error), None, mark)[0]
        return None

    def _decide(self, batch: Sequence[tuple[Input, Extracted]]) -> None:
        """Decide about the people in a batch of inputs, and commit their rows."""
        met = [(item, found) for item, found in batch if found.people and not found.code]
        decided: dict[bytes, tuple[list[dict[str, Any]], int]] = {}
        if self.plan.examples and met:
            self.listener.stage("comparing")
            together = 1 if self.request.spot else _TOGETHER
            for start in range(0, len(met), together):
                decided |= self._decided(met[start : start + together])
        for item, found in batch:
            predictions, attempts = decided.get(item.key, (None, 1))
            self.refused += [times for one in predictions or () for times in one.get("refused", ())]
            found = replace(found, attempts=max(found.attempts, attempts))
            if found.people and not found.code and self.plan.files:
                try:
                    self.plan.files.put(item, keypoint_store() / found.stored)
                except FileNotFoundError:
                    gone = "its keypoints are gone from the store"
                    found = found.failed(KeypointError(gone, remedy="--retry-errors", code="E_STORE"))
            mark, spot = self.plan.fingerprint, self.plan.settings.spot
            self._commit(item, rows_of(item, found, predictions, mark, spot), found.stamp)

    def _decided(
        self, some: Sequence[tuple[Input, Extracted]], *, alone: bool = False
    ) -> dict[bytes, tuple[list[dict[str, Any]], int]]:
        """Predictions and attempts by the input's key; where that fails, once more, of each input alone."""
        inputs = [
            {"name": item.name, "stored": found.stored, "people": len(found.people)} for item, found in some
        ]
        try:
            what = "spot" if self.request.spot else "decide"
            answers = self.assistant.ask(what, {"inputs": inputs}, retry=False)
        except ConfigError:
            raise
        except GestureError as error:
            if not alone:
                each = [self._decided([one], alone=True) for one in some]
                return {key: value for one in each for key, value in one.items()}
            prediction = {"status": "error", "code": error.code, "message": error.message}
            attempts = 2 if isinstance(error, WorkerError) else 1
            return {some[0][0].key: ([prediction] * len(some[0][1].people), attempts)}
        return {item.key: (answer, 1) for (item, _), answer in zip(some, answers, strict=True)}

    def _commit(self, item: Input, rows: Sequence[Row], stamp: str = "") -> None:
        """Commit the rows of an input, with its stamp as it was read, or as it was when the run began."""
        self.results.commit(replace(item, stamp=stamp or item.stamp), rows)
        for row in rows:
            self.listener.row(row)


def _largest_video(items: Sequence[Input]) -> tuple[int, Input] | None:
    """The largest file among the videos, and its size."""
    found = [(one.path.stat().st_size, one) for one in items if one.kind == "video" and one.path.exists()]
    return max(found, key=itemgetter(0), default=None)
