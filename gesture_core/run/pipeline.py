"""The main job: inputs and examples in, rows out, whatever happens in between.

Examples are extracted first, then queries; as keypoints arrive they are compared with all examples
in batches, and each input's rows are committed in one transaction.
"""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from gesture_core.errors import Code, ConfigError, GestureError, InputError, RunFolderError
from gesture_core.run.contradictions import contradicting_row, contradictions
from gesture_core.run.deciding import Arrived, Decided, Deciding, Example
from gesture_core.run.discovery import Input
from gesture_core.run.extraction import Extraction
from gesture_core.run.extractor import STORE_FAILED
from gesture_core.run.folder import run_folder
from gesture_core.run.journal import Committed, Journal
from gesture_core.run.plan import Plan, check_out, make_plan
from gesture_core.run.pruning import prune
from gesture_core.run.rows import broken_row, failed_row, person_rows, skipped_row
from gesture_core.run.run import Listener, RunRequest, RunSummary, keypoint_store
from gesture_core.run.sandbox import Sandbox
from gesture_core.run.store import read_keypoints
from gesture_core.run.work import Outcome
from gesture_core.types import PoseSequence, Prediction, Row

_BATCH = 64
_SECONDS_BETWEEN_BATCHES = 2.0


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
    with (
        run_folder(request.out),
        Journal(request.out, create=True) as journal,
        journal.failures(),
        Sandbox(request.settings.limits) as sandbox,
    ):
        plan = make_plan(request, journal, None if request.engine == "inline" else sandbox)
        listener.planned(len(plan.inputs), len(plan.waiting), len(plan.examples), plan.kernel)
        run = _Run(request, plan, journal, listener)
        if plan.waiting:
            run.work()
            if plan.files:
                plan.files.sweep()  # of what has turned out to be unreadable
            if run.added:
                prune(keypoint_store(), request.settings.limits.cache)
        failed = tuple(journal.rows("example"))
        classes = Counter(str(item.label) for item in _usable(plan.examples, failed) if item.label)
        known = set(plan.hashes.values()) - {""}
        lost = (_labels(plan.examples) | plan.announced) - classes.keys()
        return RunSummary(
            request.out,
            journal.counts(),
            done_now=len(plan.waiting),
            failed_examples=failed,
            elapsed=time.monotonic() - started,
            frames=run.frames,
            kernel=plan.kernel,
            fingerprint=plan.fingerprint,
            lost_classes=tuple(sorted(lost)),
            assumed=dict(run.assumed),
            classes=dict(sorted(classes.items())),
            inputs_among_examples=journal.copies(known),
            gone=plan.gone,
        )


def _remedy(first: Row) -> str:
    """What to try where no example can be used, and the first one's row does not say it."""
    code = Code.of(first.code)
    if code and code.plugin:
        return "another version of that plugin, or settings without it"
    return "" if "; try: " in first.message else "better clips"


def _usable(examples: Sequence[Input], failed: Sequence[Row]) -> list[Input]:
    names = {row.input for row in failed}
    return [item for item in examples if item.name not in names]


def _labels(examples: Sequence[Input]) -> set[str]:
    return {item.label for item in examples if item.label}


@dataclass
class _Run:
    request: RunRequest
    plan: Plan
    journal: Journal
    listener: Listener
    frames: int = 0
    added: bool = False
    assumed: Counter[str] = field(default_factory=Counter)

    def work(self) -> None:
        """Extract, compare, commit, until nothing waits."""
        for item in self.plan.waiting:
            if item.kind == "other":
                self._commit(item, [skipped_row(item, self.plan.fingerprint)])
            elif item.kind == "broken":
                self._commit(item, [broken_row(item, self.plan.fingerprint)])
        readable = [item for item in self.plan.waiting if item.kind in ("video", "keypoints")]
        if not readable:
            return
        examples = [
            item
            for item in self.plan.examples
            if item.kind in ("video", "keypoints") and item.key not in self._contradictions
        ]
        with Extraction(
            self.plan.settings,
            self.plan.identity,
            most=max(len(readable), len(examples)),
            workers=self.request.workers,
            engine=self.request.engine,
            on_frames=self.listener.frames,
        ) as extraction:
            if self.plan.deciding:
                self._fit(self.plan.deciding, dict(self._extract(extraction, examples)))
            arrived: list[tuple[Input, Outcome]] = []
            last = time.monotonic()
            for item, outcome in self._extract(extraction, readable):
                arrived.append((item, outcome))
                if len(arrived) >= _BATCH or time.monotonic() - last > _SECONDS_BETWEEN_BATCHES:
                    self._decide(arrived)
                    arrived, last = [], time.monotonic()
            self._decide(arrived)

    @cached_property
    def _contradictions(self) -> dict[bytes, Input]:
        return contradictions(self.plan.examples, self.plan.hashes)

    def _extract(self, extraction: Extraction, items: Sequence[Input]) -> Iterator[tuple[Input, Outcome]]:
        for outcome in extraction(items):
            if outcome.code == STORE_FAILED:
                raise RunFolderError(outcome.message, kept="every committed row", code=STORE_FAILED)
            item = items[outcome.number]
            self.listener.extracted(item.name, outcome.cached)
            self.frames += 0 if outcome.cached else outcome.frames_read
            self.added |= bool(outcome.stored) and not outcome.cached
            self.assumed.update([outcome.assumed] if outcome.assumed else [])
            yield item, outcome

    def _fit(self, deciding: Deciding, outcomes: Mapping[Input, Outcome]) -> None:
        """Make known all examples that can be used; rows say why the others cannot."""
        self.journal.forget([item.key for item in self.plan.examples], role="example")
        failed = []
        for item in self.plan.examples:
            row = self._example(deciding, item, outcomes.get(item))
            if row:
                failed.append(row)
                self.journal.commit(Committed(item.key, item.place, ""), [row], role="example")
                self.listener.example_failed(row)
        if len(failed) == len(self.plan.examples):
            raise InputError(
                f"no example can be used; the first one: {failed[0].code} {failed[0].message}",
                kept="the keypoints extracted so far",
                remedy=_remedy(failed[0]),
                code="E_EXAMPLES",
            )
        self._hold(sorted(_usable(self.plan.examples, failed), key=lambda item: item.key))
        deciding.fit()

    def _hold(self, usable: Sequence[Input]) -> None:
        """Stop where the rows that are there were decided by other examples than can be used now."""
        library = hashlib.sha256(b"\0".join(item.key for item in usable)).hexdigest()
        before = self.journal.get("library")
        decided = self.journal.counts().keys() & {"ok", "degraded", "rejected"}
        if before not in (None, library) and decided:
            raise ConfigError(
                "other examples can be used now than when its rows were decided",
                subject=str(self.request.out),
                kept="its rows and all keypoints",
                remedy="--overwrite to decide all of them by the same examples (keypoints are reused)",
                code="E_CONFIG_CHANGED",
            )
        self.journal.set({"library": library})

    def _example(self, deciding: Deciding, item: Input, outcome: Outcome | None) -> Row | None:
        """The row that says why an example cannot be used."""
        mark = self.plan.fingerprint
        if other := self._contradictions.get(item.key):
            return contradicting_row(item, other, self.plan.hashes[item.key], mark)
        if outcome is None:
            return (skipped_row if item.kind == "other" else broken_row)(item, mark)
        if outcome.sha256 not in ("", self.plan.hashes[item.key]):
            changed = Outcome(0, code="E_CHANGED", message="has changed since the run began; try: again")
            return failed_row(item, changed, mark)
        try:
            people = _stored_poses(item, outcome)
            if outcome.code or not people:
                return failed_row(item, outcome, mark)
            deciding.add(Example(item.name, str(item.label), outcome.stored), people)
        except ConfigError:
            raise
        except GestureError as error:
            broken = replace(outcome, stored="", code=error.code, message=error.message)
            return failed_row(item, broken, mark)
        return None

    def _decide(self, batch: Sequence[tuple[Input, Outcome]]) -> None:
        poses = [self._poses(item, outcome) for item, outcome in batch]
        if self.plan.deciding is None:
            decided = [Decided(tuple(Prediction(None, "ok") for _ in people)) for _, people in poses]
        else:
            arrived = [
                Arrived(item.name, outcome.stored, people)
                for (item, _), (outcome, people) in zip(batch, poses, strict=True)
            ]
            decided = self.plan.deciding.predict(arrived)
        for (item, _), (outcome, people), one in zip(batch, poses, decided, strict=True):
            outcome = replace(outcome, attempts=max(outcome.attempts, one.attempts))
            rows = person_rows(item, outcome, people, one.predictions, self.plan.fingerprint)
            self._commit(item, rows, outcome.stamp)

    def _poses(self, item: Input, outcome: Outcome) -> tuple[Outcome, list[PoseSequence]]:
        """The keypoints of an input; where keypoints are all that is wanted, also as a file of the run."""
        try:
            people = _stored_poses(item, outcome)
            if people and self.plan.files:
                self.plan.files.put(item, keypoint_store() / outcome.stored)
            return outcome, people
        except GestureError as error:
            return replace(outcome, stored="", code=error.code, message=error.message), []

    def _commit(self, item: Input, rows: Sequence[Row], stamp: str = "") -> None:
        """Commit the rows of an input, with its stamp as it was read, or as it was when the run began."""
        self.journal.commit(Committed(item.key, item.place, stamp or self.plan.stamps[item.key]), rows)
        for row in rows:
            self.listener.row(row)


def _stored_poses(item: Input, outcome: Outcome) -> list[PoseSequence]:
    """The keypoints of an input, one sequence for each person; none where there are none.

    Raises
    ------
    KeypointError
        Where the file in the store has been damaged since it was written.
    """
    if not outcome.stored:
        return []
    return read_keypoints(keypoint_store() / outcome.stored, item.name).sequences
