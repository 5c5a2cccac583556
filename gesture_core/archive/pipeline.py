"""The main job: inputs and examples in, rows out, whatever happens in between.

Examples are extracted first, then queries; as keypoints arrive they are compared with all examples
in batches, and each input's rows are committed in one transaction.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from gesture_core.archive.assemble import failed_row, person_rows, skipped_row
from gesture_core.archive.discovery import Input, discover, label_inputs
from gesture_core.archive.extraction import extract_all
from gesture_core.archive.fingerprint import differences, fingerprint, pose_identity, run_configuration
from gesture_core.archive.hashing import content_sha256, stamp
from gesture_core.archive.journal import Journal
from gesture_core.archive.keypoint_files import publish
from gesture_core.archive.lock import run_lock
from gesture_core.archive.rows import Row
from gesture_core.archive.run import Listener, RunRequest, RunSummary, keypoint_store
from gesture_core.archive.store import read_keypoints
from gesture_core.archive.work import Outcome
from gesture_core.classify.estimator import GestureClassifier
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.plugin import registry
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
    with run_lock(request.out), Journal(request.out, create=True) as journal:
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
    journal: Journal
    listener: Listener
    examples: list[Input]
    waiting: list[Input]
    pose_key: str
    kernel: str
    fingerprint: str
    failed_examples: list[Row] = field(default_factory=list)
    lost_classes: set[str] = field(default_factory=set)
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
        videos = any(item.kind == "video" for item in (*inputs, *examples))
        identity = pose_identity(request.settings, with_model=videos)
        kernel = _kernel(request) if examples else ""
        hashed = [(item, _known_sha256(journal, item)) for item in examples]
        configuration = run_configuration(request.settings, identity, hashed, kernel)
        _hold_against(journal, configuration, overwrite=request.overwrite)
        done = journal.done(retry_errors=request.retry_errors)
        waiting = [item for item in inputs if not _is_done(journal, item, done)]
        listener.planned(len(inputs), len(waiting), len(examples), kernel)
        key = fingerprint(identity)
        return cls(request, journal, listener, examples, waiting, key, kernel, fingerprint(configuration))

    def work(self) -> None:
        """Extract, compare, commit, until nothing waits."""
        readable = [item for item in self.waiting if item.kind != "other"]
        for item in self.waiting:
            if item.kind == "other":
                self._commit(item, [skipped_row(item, self.fingerprint)])
        everything = [*self.examples, *readable] if readable else []
        outcomes: dict[int, Outcome] = {}
        arrived: list[int] = []
        classifier: GestureClassifier | None = None
        last = time.monotonic()
        extraction = extract_all(
            everything,
            self.request.settings,
            pose_key=self.pose_key,
            workers=self.request.workers,
            engine=self.request.engine,
            on_frames=self.listener.frames,
        )
        for outcome in extraction:
            item = everything[outcome.number]
            self.listener.extracted(item.name, outcome.cached)
            self.frames += 0 if outcome.cached else outcome.frames_read
            outcomes[outcome.number] = outcome
            if outcome.number >= len(self.examples):
                arrived.append(outcome.number)
            if self.examples and classifier is None:
                if not all(number in outcomes for number in range(len(self.examples))):
                    continue
                classifier = self._fit([outcomes[number] for number in range(len(self.examples))])
            if len(arrived) >= _BATCH or time.monotonic() - last > _SECONDS_BETWEEN_BATCHES:
                self._decide([(everything[n], outcomes[n]) for n in arrived], classifier)
                arrived, last = [], time.monotonic()
        self._decide([(everything[n], outcomes[n]) for n in arrived], classifier)

    def _fit(self, outcomes: Sequence[Outcome]) -> GestureClassifier:
        """The classifier of all examples that can be used; the others are reported."""
        settings = self.request.settings
        classifier = GestureClassifier(settings, kernel=self.kernel)
        signals, labels, names = [], [], []
        for item, outcome in zip(self.examples, outcomes, strict=True):
            try:
                poses = self._poses(item, outcome)
                if outcome.code or not poses:
                    self._fail_example(failed_row(item, outcome, self.fingerprint))
                    continue
                signals.extend(classifier.signals(poses[:1]))
                labels.append(str(item.label))
                names.append(item.name)
            except GestureError as error:
                broken = Outcome(0, outcome.sha256, code=error.code, message=error.message)
                self._fail_example(failed_row(item, broken, self.fingerprint))
        self.lost_classes = {str(item.label) for item in self.examples} - set(labels)
        if not labels:
            first = self.failed_examples[0]
            raise InputError(
                f"no example can be used; the first one: {first.code} {first.message}",
                kept="the keypoints extracted so far",
                remedy="better clips",
                code="E_EXAMPLES",
            )
        return classifier.fit(signals, labels, names)

    def _fail_example(self, row: Row) -> None:
        self.failed_examples.append(row)
        self.listener.example_failed(row)

    def _poses(self, item: Input, outcome: Outcome) -> list[PoseSequence]:
        if not outcome.stored:
            return []
        return read_keypoints(keypoint_store() / outcome.stored, item.name).sequences

    def _decide(self, batch: Sequence[tuple[Input, Outcome]], classifier: GestureClassifier | None) -> None:
        poses = [self._poses(item, outcome) for item, outcome in batch]
        every = [pose for people in poses for pose in people]
        if classifier is None:
            predictions = [Prediction(None, "ok") for _ in every]
        else:
            predictions = classifier.predictions(every) if every else []
        start = 0
        for (item, outcome), people in zip(batch, poses, strict=True):
            decided = predictions[start : start + len(people)]
            start += len(people)
            if outcome.stored and not self.examples:
                publish(keypoint_store() / outcome.stored, item, self.request)
            rows = person_rows(item, outcome, people, decided, self.fingerprint)
            self._commit(item, rows, outcome.stored)

    def _commit(self, item: Input, rows: Sequence[Row], stored: str = "") -> None:
        self.journal.remember(item.key, _stamp(item), rows[0].sha256)
        self.journal.commit(item.key, rows, stored=stored)
        for row in rows:
            self.listener.row(row)


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
