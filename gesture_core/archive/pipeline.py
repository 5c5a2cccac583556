"""The main job: inputs and examples in, rows out, whatever happens in between.

Examples are extracted first, then queries; as keypoints arrive they are compared with all examples
in batches, and each input's rows are committed in one transaction.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from gesture_core.archive.assemble import person_rows, skipped_row
from gesture_core.archive.deciding import ExampleSet, predict, stored_poses
from gesture_core.archive.discovery import Input, discover, label_inputs
from gesture_core.archive.extraction import extract_all
from gesture_core.archive.extractor import STORE_FAILED
from gesture_core.archive.fingerprint import differences, fingerprint, pose_identity, run_configuration
from gesture_core.archive.hashing import content_sha256, stamp
from gesture_core.archive.journal import Journal
from gesture_core.archive.keypoint_files import publish
from gesture_core.archive.lock import run_lock
from gesture_core.archive.probe import require_model
from gesture_core.archive.rows import Row
from gesture_core.archive.run import Listener, RunRequest, RunSummary, keypoint_store
from gesture_core.archive.work import Outcome
from gesture_core.classify.estimator import GestureClassifier
from gesture_core.errors import ConfigError, GestureError, InputError, RunFolderError
from gesture_core.plugin import registry
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence, Prediction

_BATCH = 64
_SECONDS_BETWEEN_BATCHES = 2.0


def run_archive(request: RunRequest, listener: Listener | None = None) -> RunSummary:
    """Do what ``request`` asks for, as far as it has not been done yet.

    Raises
    ------
    InputError, ConfigError, PluginError, ModelError
        Before anything is done: a source, setting, plugin or model that cannot be used, or a run
        folder made with other settings (E_CONFIG_CHANGED).
    RunFolderError
        Where the run folder is held by another run or damaged.
    """
    started = time.monotonic()
    request.out.mkdir(parents=True, exist_ok=True)
    with run_lock(request.out), Journal(request.out, create=True) as journal, journal.failures():
        run = _Run.plan(request, journal, listener or Listener())
        if run.waiting:
            run.work()
        return RunSummary(
            request.out,
            journal.counts(),
            len(run.waiting),
            tuple(run.failed_examples),
            time.monotonic() - started,
            run.frames,
            run.kernel,
            run.fingerprint,
            tuple(sorted(run.lost_classes)),
        )


@dataclass
class _Run:
    request: RunRequest
    settings: Settings
    journal: Journal
    listener: Listener
    examples: list[Input]
    waiting: list[Input]
    pose_key: str
    kernel: str
    fingerprint: str
    failed_examples: list[Row] = field(default_factory=list)
    lost_classes: set[str] = field(default_factory=set)
    classifier: GestureClassifier | None = None
    frames: int = 0

    @classmethod
    def plan(cls, request: RunRequest, journal: Journal, listener: Listener) -> _Run:
        """Find the inputs and examples, hold the configuration against the folder's, list what waits."""
        _check_options(request)
        inputs = discover(request.sources, avoid=request.out)
        if not inputs:
            raise InputError(
                "holds no input", subject=", ".join(request.sources), remedy="another path", code="E_EMPTY"
            )
        examples = []
        if request.examples:
            found = [item for item in discover(request.examples, avoid=request.out) if item.kind != "other"]
            examples = label_inputs(found, request.labels, request.examples)
            if not examples:
                raise InputError(
                    "holds no example", subject=", ".join(request.examples), remedy="examples/<label>/<clip>"
                )
            _check_neighbors(request.settings, len(examples))
        videos = any(item.kind == "video" for item in (*inputs, *examples))
        identity = pose_identity(request.settings, with_model=videos)
        kernel = _kernel(request) if examples else ""
        hashed = [(item, _known_sha256(journal, item)) for item in examples]
        configuration = run_configuration(request.settings, identity, hashed, kernel)
        _hold_against(journal, configuration, overwrite=request.overwrite)
        done = journal.done(retry_errors=request.retry_errors)
        waiting = [item for item in inputs if not _is_done(journal, item, done)]
        if any(item.kind == "video" for item in (*waiting, *examples)) and waiting:
            require_model(request.settings, identity, request.engine)
        listener.planned(len(inputs), len(waiting), len(examples), kernel)
        key = fingerprint(identity)
        settings = replace(request.settings, classify=replace(request.settings.classify, kernel=kernel))
        mark = fingerprint(configuration)
        return cls(request, settings, journal, listener, examples, waiting, key, kernel, mark)

    def work(self) -> None:
        """Extract, compare, commit, until nothing waits."""
        for item in self.waiting:
            if item.kind == "other":
                self._commit(item, [skipped_row(item, self.fingerprint)])
        readable = [item for item in self.waiting if item.kind != "other"]
        everything = [*self.examples, *readable] if readable else []
        extraction = extract_all(
            everything,
            self.settings,
            pose_key=self.pose_key,
            workers=self.request.workers,
            engine=self.request.engine,
            on_frames=self.listener.frames,
        )
        examples: dict[int, Outcome] = {}
        arrived: list[tuple[Input, Outcome]] = []
        last = time.monotonic()
        for outcome in extraction:
            if outcome.code == STORE_FAILED:
                raise RunFolderError(outcome.message, kept="every committed row", code=STORE_FAILED)
            item = everything[outcome.number]
            self.listener.extracted(item.name, outcome.cached)
            self.frames += 0 if outcome.cached else outcome.frames_read
            if outcome.number < len(self.examples):
                examples[outcome.number] = outcome
            else:
                arrived.append((item, outcome))
            if self.examples and self.classifier is None:
                if len(examples) < len(self.examples):
                    continue
                self.classifier = self._fit([examples[number] for number in sorted(examples)])
            if len(arrived) >= _BATCH or time.monotonic() - last > _SECONDS_BETWEEN_BATCHES:
                self._decide(arrived)
                arrived, last = [], time.monotonic()
        self._decide(arrived)

    def _fit(self, outcomes: Sequence[Outcome]) -> GestureClassifier:
        """The classifier of all examples that can be used; the others are reported."""
        classifier = GestureClassifier(self.settings)
        usable = ExampleSet.of(self.examples, outcomes, classifier, self.fingerprint)
        self.failed_examples = usable.failed
        self.lost_classes = {str(item.label) for item in self.examples} - set(usable.labels)
        for row in usable.failed:
            self.listener.example_failed(row)
        return classifier.fit(usable.signals, usable.labels, usable.names)

    def _decide(self, batch: Sequence[tuple[Input, Outcome]]) -> None:
        poses = [self._poses(item, outcome) for item, outcome in batch]
        every = [pose for _, people in poses for pose in people]
        if self.classifier is None:
            predictions = [Prediction(None, "ok") for _ in every]
        else:
            predictions = predict(self.classifier, every, self.settings)
        start = 0
        for (item, _), (outcome, people) in zip(batch, poses, strict=True):
            decided = predictions[start : start + len(people)]
            start += len(people)
            if people and not self.examples:
                publish(keypoint_store() / outcome.stored, item, self.request)
            rows = person_rows(item, outcome, people, decided, self.fingerprint)
            self._commit(item, rows, outcome.stored)

    def _poses(self, item: Input, outcome: Outcome) -> tuple[Outcome, list[PoseSequence]]:
        try:
            return outcome, stored_poses(item, outcome)
        except GestureError as error:
            return replace(outcome, stored="", code=error.code, message=error.message), []

    def _commit(self, item: Input, rows: Sequence[Row], stored: str = "") -> None:
        self.journal.remember(item.key, _stamp(item), rows[0].sha256)
        self.journal.commit(item.key, rows, stored=stored)
        for row in rows:
            self.listener.row(row)


def _check_neighbors(settings: Settings, examples: int) -> None:
    if not 1 <= settings.classify.neighbors <= examples:
        raise ConfigError(
            f"{settings.classify.neighbors} neighbours of {examples} examples",
            remedy=f"--neighbors 1 to {examples}",
            code="E_NEIGHBORS",
        )


def _kernel(request: RunRequest) -> str:
    from gesture_core.dtw.distances import choose_kernel

    return choose_kernel(request.settings.classify.kernel, request.settings.dtw)[0]


def _check_options(request: RunRequest) -> None:
    plugins = registry()
    known = {name for _, name in plugins.entries}
    for name in request.settings.options:
        if name.partition(":")[0] not in known:
            raise ConfigError(
                f"options for {name!r}, which is no plugin",
                remedy=f"one of {', '.join(sorted(known))}",
                code="E_OPTION",
            )


def _stamp(item: Input) -> str:
    try:
        return stamp(item.path)
    except OSError:
        return "unreadable"


def _known_sha256(journal: Journal, item: Input) -> str:
    """Content hash of an example, computed only where the file has been written since last time."""
    now = _stamp(item)
    known = journal.sha256(item.key, now)
    if known:
        return known
    try:
        known = content_sha256(item.path)
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror}", subject=item.name, remedy="check its permissions"
        ) from None
    journal.remember(item.key, now, known)
    return known


def _is_done(journal: Journal, item: Input, done: dict[bytes, str]) -> bool:
    return item.key in done and journal.sha256(item.key, _stamp(item)) == done[item.key]


def _hold_against(journal: Journal, configuration: dict[str, object], *, overwrite: bool) -> None:
    before = journal.get("configuration")
    changed = differences(json.loads(before), configuration) if before else []
    if changed and not overwrite:
        lines = "\n  ".join(changed[:20]) + (f"\n  and {len(changed) - 20} more" if changed[20:] else "")
        raise ConfigError(
            f"this folder holds a run made with other settings:\n  {lines}\n",
            kept="its rows and all keypoints",
            remedy="--overwrite to classify again (keypoints are reused), or another --out",
            code="E_CONFIG_CHANGED",
        )
    if changed:
        journal.clear()
    journal.set({"configuration": configuration, "fingerprint": fingerprint(configuration)})
