"""What a run will do: found and checked before anything is changed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import content_sha256, stamp, switched_on
from gesture_core.plugin import registry
from gesture_core.pose.choice import choose_pose, described
from gesture_core.run.extract import OpenEngine
from gesture_core.run.fingerprint import differences, fingerprint, pose_identity, run_configuration
from gesture_core.run.inputs import COMPANIONS, FRAMES, PICTURE_SUFFIXES, Input, discover
from gesture_core.run.label_folders import label_folders
from gesture_core.run.labels import label_inputs, word
from gesture_core.run.results import Results
from gesture_core.run.workers.engines import Assistant
from gesture_core.settings import Settings

if TYPE_CHECKING:
    from gesture_core.run.keypoint_files import KeypointFiles


@dataclass(frozen=True)
class RunRequest:
    """What a run is to do.

    Attributes
    ----------
    sources : tuple of str
        Files, folders, globs or manifests.
    out : Path
        The run folder.
    settings : Settings
    examples : tuple of str
        Sources of the examples; empty to extract keypoints only.
    labels : str
        How examples get their labels, see `labels.label_inputs`.
    workers : int
        Worker processes; 0 for one for each core.
    engine : str
        Name of an execution engine.
    retry_errors : bool
        Try inputs again whose row is an error.
    label_columns : str
        Headings of path and label in a table of labels.
    overwrite : bool
        Forget the rows of a run that was made with other settings.
    spot : bool
        Look for the examples in long recordings, instead of comparing them with whole inputs.
    """

    sources: tuple[str, ...]
    out: Path
    settings: Settings
    examples: tuple[str, ...] = ()
    labels: str = "folder"
    workers: int = 0
    engine: str = "processes"
    retry_errors: bool = False
    overwrite: bool = False
    label_columns: str = ""
    spot: bool = False


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
    contradictions : dict
        An example of another label with the same content, by the key of each example that has one: either
        label may be the wrong one, so neither can be used.
    files : KeypointFiles or None
        Where an extraction leaves its keypoints.
    announced : frozenset of str
        Labels that the folders of the examples stand for, whatever is in them.
    gone : int
        Inputs of earlier runs whose rows were removed, as they are not there any more.
    network : str
        What finds people, in words; empty where there is no video.
    """

    settings: Settings
    inputs: list[Input]
    examples: list[Input]
    waiting: list[Input]
    stamps: dict[bytes, str]
    hashes: dict[bytes, str]
    identity: Mapping[str, Any]
    configuration: Mapping[str, Any]
    contradictions: dict[bytes, Input]
    files: KeypointFiles | None
    announced: frozenset[str] = frozenset()
    gone: int = 0
    network: str = ""

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


def make_plan(request: RunRequest, results: Results, assistant: Assistant) -> Plan:
    """Find the inputs and examples and check everything that can be checked; then, and only then,
    make the run folder's configuration that of this run.

    Plugins are asked in the ``assistant``, which has made the chain and the kernel afterwards.

    Raises
    ------
    InputError, ConfigError, PluginError, ModelError
        A source, setting, plugin or model that cannot be used, or a run folder made with other
        settings (E_CONFIG_CHANGED). The results are as they were.
    """
    settings = request.settings
    registry().find("engine", request.engine)
    inputs = discover(request.sources, avoid=request.out, assistant=assistant)
    if not inputs:
        raise InputError(
            "holds no input", subject=", ".join(request.sources), remedy="another path", code="E_EMPTY"
        )
    examples = _examples(request, assistant)
    kernel = ""
    if examples:
        _check_enough(settings, [item for item in examples if item.kind != "other"])
        kernel = assistant.ask("open_classifier", keep=True)
    settings = replace(settings, classify=replace(settings.classify, kernel=kernel))
    videos = any(item.kind == "video" for item in (*inputs, *examples))
    settings = choose_pose(settings, needed=videos)
    identity = pose_identity(settings, with_model=videos)
    stamps = {item.key: _stamp(item) for item in (*inputs, *examples)}
    hashes = {
        item.key: _sha256(results, item, stamps[item.key]) if item.kind != "other" else ""
        for item in examples
    }
    configuration = run_configuration(
        settings, identity, [(e, hashes[e.key]) for e in examples], kernel, request.spot
    )
    changed = _changes(results, configuration, overwrite=request.overwrite)
    again = changed or request.overwrite or switched_on("GESTURE_NO_CACHE")
    done = {} if again else results.done(retry_errors=request.retry_errors)
    files = None
    if not examples:
        from gesture_core.run.keypoint_files import KeypointFiles

        files = KeypointFiles(request.out, results, inputs, request.sources)
    lacking = files.lacking() if files else set()
    waiting = [
        item
        for item in inputs
        if item.key in lacking
        or item.key not in done
        or not stamps[item.key]
        or results.sha256(item.key, stamps[item.key]) != done[item.key]
    ]
    if waiting and any(item.kind == "video" for item in (*waiting, *examples)):
        with OpenEngine(settings, identity, most=1, engine=request.engine) as engine:
            engine.require_model(identity)
    if changed or request.overwrite:
        results.clear()
    results.set({"configuration": configuration, "fingerprint": fingerprint(configuration)})
    gone = _gone(results, inputs)
    results.forget(gone)
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
        contradictions=_contradictions(examples, hashes),
        files=files,
        announced=frozenset(
            map(word, label_folders(examples, request.examples, request.out))
            if request.labels == "folder"
            else ()
        ),
        gone=len(gone),
        network=described(settings) if videos else "",
    )


def _examples(request: RunRequest, assistant: Assistant) -> list[Input]:
    if not request.examples:
        return []
    found = discover(request.examples, avoid=request.out, assistant=assistant)
    if all(item.kind == "other" for item in found):
        pictures = any(item.path.suffix.lower() in PICTURE_SUFFIXES for item in found)
        raise InputError(
            "holds no example",
            subject=", ".join(request.examples),
            remedy="examples/<label>/<clip>" + (f", or for a picture {FRAMES}" if pictures else ""),
            code="E_EMPTY",
        )
    labelled = label_inputs(found, request.labels, request.examples, request.label_columns)
    # What nobody reads is a lost example where it has a label; without one it was never meant as any.
    return [
        item
        for item in labelled
        if item.kind != "other" or (item.label and item.path.suffix.lower() not in COMPANIONS)
    ]


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


def _sha256(results: Results, item: Input, now: str) -> str:
    """Content hash of an example, computed only where the file has been written since last time."""
    known = results.sha256(item.key, now) if now else ""
    if known:
        return known
    try:
        known = content_sha256(item.path)
    except OSError:
        return ""
    results.remember(item.key, now, known)
    return known


def _changes(results: Results, configuration: Mapping[str, Any], *, overwrite: bool) -> bool:
    """Whether the folder's rows were made with other settings; an error unless that is wanted."""
    before = results.get("configuration")
    changed = differences(json.loads(before), configuration) if before else []
    if not changed or not results.places():
        return bool(changed)
    if not overwrite:
        lines = "\n  ".join(changed[:20]) + (f"\n  … and {len(changed) - 20} more" if changed[20:] else "")
        raise ConfigError(
            "holds a run made with other settings",
            subject=str(results.path.parent),
            kept="its rows and all keypoints",
            remedy=f"--overwrite to begin again (keypoints are reused), or another --out\n  {lines}",
            code="E_CONFIG_CHANGED",
        )
    return True


def _gone(results: Results, inputs: Sequence[Input]) -> list[bytes]:
    """Keys of rows whose input no longer exists, or is now read in another way."""
    keys = {item.key for item in inputs}
    places = {item.place for item in inputs}
    return [
        key
        for key, place in results.places()
        if key not in keys and (place in places or not os.path.lexists(place))
    ]


def _contradictions(examples: Sequence[Input], hashes: Mapping[bytes, str]) -> dict[bytes, Input]:
    alike: dict[tuple[str, str], list[Input]] = {}
    for item in examples:
        if hashes[item.key]:
            alike.setdefault((hashes[item.key], item.member), []).append(item)
    return {
        item.key: other
        for group in alike.values()
        for item in group
        for other in [next((one for one in group if one.label != item.label), None)]
        if other is not None
    }
