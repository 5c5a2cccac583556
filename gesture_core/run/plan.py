"""What a run will do: found and checked before anything is changed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import content_sha256, stamp
from gesture_core.plugin import registry
from gesture_core.run.deciding import Decider, Deciding
from gesture_core.run.discovery import FRAMES, PICTURE_SUFFIXES, Input, discover
from gesture_core.run.fingerprint import differences, fingerprint, pose_identity, run_configuration
from gesture_core.run.guarded import decider
from gesture_core.run.journal import Journal
from gesture_core.run.keypoint_files import KeypointFiles
from gesture_core.run.labels import label_folders, label_inputs
from gesture_core.run.probe import require_model
from gesture_core.run.readers import Readers
from gesture_core.run.run import RunRequest
from gesture_core.run.sandbox import Sandbox
from gesture_core.settings import Settings

# What lies beside clips and never is one: notes, subtitles, thumbnails, and what file managers leave.
_COMPANIONS = frozenset(
    ".txt .md .log .pdf .html .srt .vtt .ass .jpg .jpeg .png .xml .yaml .yml .toml .ini .db .lnk".split()
)


@dataclass(frozen=True)
class Plan:
    """The work of a run.

    Attributes
    ----------
    settings : Settings
        With the kernel that was chosen.
    inputs, examples : list of Input
    waiting : list of Input
        Inputs that have no row for their content yet.
    stamps : dict
        Stamp of each input and example by its key; empty where it cannot be looked at.
    hashes : dict
        Content hash of each example by its key; empty for those that cannot be read.
    identity : mapping
        From `fingerprint.pose_identity`.
    configuration : mapping
        From `fingerprint.run_configuration`.
    deciding : Deciding or None
        What classifies; None where keypoints are only extracted.
    files : KeypointFiles or None
        Where an extraction leaves its keypoints.
    announced : frozenset of str
        Labels that the folders of the examples stand for, whatever is in them.
    gone : int
        Inputs of earlier runs whose rows were removed, as they are not there any more.
    """

    settings: Settings
    inputs: list[Input]
    examples: list[Input]
    waiting: list[Input]
    stamps: dict[bytes, str]
    hashes: dict[bytes, str]
    identity: Mapping[str, Any]
    configuration: Mapping[str, Any]
    deciding: Deciding | None
    files: KeypointFiles | None
    announced: frozenset[str] = frozenset()
    gone: int = 0

    @property
    def kernel(self) -> str:
        """The distance kernel; empty where keypoints are only extracted."""
        return self.settings.classify.kernel

    @property
    def fingerprint(self) -> str:
        """Of everything that decides a row, but for the input."""
        return fingerprint(self.configuration)


def check_out(request: RunRequest) -> None:
    """Raise ``E_OUT`` where the run folder is one of inputs or examples, as it would not be looked into."""
    out = request.out.resolve()
    for source in map(Path, (*request.sources, *request.examples)):
        if source.is_dir() and source.resolve() == out:
            cause = f"--out {request.out} holds the inputs or examples"
            raise ConfigError(cause, remedy="a folder of its own, such as run/", code="E_OUT")


def make_plan(request: RunRequest, journal: Journal, sandbox: Sandbox | None) -> Plan:
    """Find the inputs and examples and check everything that can be checked; then, and only then,
    make the run folder's configuration that of this run.

    Third parties' plugins are asked in ``sandbox``; without one, in this process.

    Raises
    ------
    InputError, ConfigError, PluginError, ModelError
        A source, setting, plugin or model that cannot be used, or a run folder made with other
        settings (E_CONFIG_CHANGED). The journal is as it was.
    """
    settings = request.settings
    readers = Readers(sandbox)
    registry().find("engine", request.engine)
    inputs = discover(request.sources, avoid=request.out, readers=readers)
    if not inputs:
        raise InputError(
            "holds no input", subject=", ".join(request.sources), remedy="another path", code="E_EMPTY"
        )
    examples = _examples(request, readers)
    if examples:
        _check_enough(settings, [item for item in examples if item.kind != "other"])
    kernel = _kernel(settings) if examples else ""
    settings = replace(settings, classify=replace(settings.classify, kernel=kernel))
    deciding = decider(settings, sandbox) if examples else None
    if isinstance(deciding, Decider):  # costs nothing; in a sandbox it waits until there is work
        deciding.check()
    videos = any(item.kind == "video" for item in (*inputs, *examples))
    identity = pose_identity(settings, with_model=videos)
    stamps = {item.key: _stamp(item) for item in (*inputs, *examples)}
    hashes = {
        item.key: _sha256(journal, item, stamps[item.key]) if item.kind != "other" else ""
        for item in examples
    }
    configuration = run_configuration(settings, identity, [(e, hashes[e.key]) for e in examples], kernel)
    changed = _changes(journal, configuration, overwrite=request.overwrite)
    done = {} if changed or request.overwrite else journal.done(retry_errors=request.retry_errors)
    files = KeypointFiles(request.out, journal, inputs, request.sources) if not examples else None
    lacking = files.lacking() if files else set()
    waiting = [
        item for item in inputs if item.key in lacking or not _is_done(journal, item, stamps[item.key], done)
    ]
    if any(item.kind == "video" for item in (*waiting, *examples)) and waiting:
        require_model(settings, identity, request.engine)
    if deciding and waiting:
        deciding.check()
    if changed or request.overwrite:
        journal.clear()
    journal.set({"configuration": configuration, "fingerprint": fingerprint(configuration)})
    gone = _gone(journal, inputs)
    journal.forget(gone)
    if files:
        files.sweep()
    return Plan(
        settings=settings,
        inputs=inputs,
        examples=examples,
        waiting=waiting,
        stamps=stamps,
        hashes=hashes,
        identity=identity,
        configuration=configuration,
        deciding=deciding,
        files=files,
        announced=frozenset(
            label_folders(request.examples, request.out) if request.labels == "folder" else ()
        ),
        gone=len(gone),
    )


def _kernel(settings: Settings) -> str:
    """The distance kernel that the settings name, or the fastest one; only this package's are tried."""
    from gesture_core.classify.comparison import check_settings
    from gesture_core.dtw.distances import choose_kernel

    check_settings(settings)
    name = settings.classify.kernel
    if name != "auto" and not registry().find("kernel", name).origin.built_in:
        return name
    return choose_kernel(name, settings.dtw, settings.options)[0]


def _examples(request: RunRequest, readers: Readers) -> list[Input]:
    if not request.examples:
        return []
    found = discover(request.examples, avoid=request.out, readers=readers)
    if all(item.kind == "other" for item in found):
        pictures = any(item.path.suffix.lower() in PICTURE_SUFFIXES for item in found)
        raise InputError(
            "holds no example",
            subject=", ".join(request.examples),
            remedy="examples/<label>/<clip>" + (f", or for a picture {FRAMES}" if pictures else ""),
            code="E_EMPTY",
        )
    labelled = label_inputs(found, request.labels, request.examples)
    # What nobody reads is a lost example where it has a label; without one it was never meant as any.
    return [item for item in labelled if item.kind != "other" or (item.label and not _is_companion(item))]


def _is_companion(item: Input) -> bool:
    return item.path.suffix.lower() in _COMPANIONS


def _check_enough(settings: Settings, examples: Sequence[Input]) -> None:
    """Raise what too few examples would raise, before hours of extraction instead of after them."""
    if settings.classify.neighbors > len(examples):
        raise ConfigError(
            f"{settings.classify.neighbors} neighbours of {len(examples)} examples",
            remedy=f"--neighbors 1 to {len(examples)}, or 0 for all of them, weighed",
            code="E_NEIGHBORS",
        )
    if settings.classify.reject_sd is not None and len({item.label for item in examples}) == len(examples):
        raise ConfigError(
            f"--reject {settings.classify.reject_sd:g}sd: no class has two examples",
            remedy="two examples of a class at least (better three of each), or --reject with a distance",
            code="E_REJECT",
        )


def _stamp(item: Input) -> str:
    """The file's stamp; empty where it cannot be looked at, which never counts as known."""
    try:
        return stamp(item.path)
    except OSError:
        return ""


def _sha256(journal: Journal, item: Input, now: str) -> str:
    """Content hash of an example, computed only where the file has been written since last time."""
    known = journal.sha256(item.key, now) if now else ""
    if known:
        return known
    try:
        known = content_sha256(item.path)
    except OSError:
        return ""
    journal.remember(item.key, now, known)
    return known


def _is_done(journal: Journal, item: Input, now: str, done: dict[bytes, str]) -> bool:
    return bool(now) and item.key in done and journal.sha256(item.key, now) == done[item.key]


def _changes(journal: Journal, configuration: Mapping[str, Any], *, overwrite: bool) -> bool:
    """Whether the folder's rows were made with other settings; an error unless that is wanted."""
    before = journal.get("configuration")
    changed = differences(json.loads(before), configuration) if before else []
    if not changed or not journal.places():
        return bool(changed)
    if not overwrite:
        lines = "\n  ".join(changed[:20]) + (f"\n  … and {len(changed) - 20} more" if changed[20:] else "")
        raise ConfigError(
            "holds a run made with other settings",
            subject=str(journal.path.parent),
            kept="its rows and all keypoints",
            remedy=f"--overwrite to begin again (keypoints are reused), or another --out\n  {lines}",
            code="E_CONFIG_CHANGED",
        )
    return True


def _gone(journal: Journal, inputs: Sequence[Input]) -> list[bytes]:
    """Keys of rows whose input no longer exists, or is now read in another way."""
    keys = {item.key for item in inputs}
    places = {item.place for item in inputs}
    return [
        key
        for key, place in journal.places()
        if key not in keys and (place in places or not os.path.lexists(place))
    ]
