"""What a run will do: found and checked before anything is changed."""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import content_sha256, stamp, switched_on
from gesture_core.plugin import registry
from gesture_core.pose.models import choose_pose
from gesture_core.run.addresses import fetch, local_path, look, roots, sha256_of, shown
from gesture_core.run.extract import OpenEngine
from gesture_core.run.fingerprint import (
    contents_of,
    differences,
    fingerprint,
    pose_identity,
    run_configuration,
    with_parts_of,
)
from gesture_core.run.inputs import COMPANIONS, FRAMES, PICTURE_SUFFIXES, Input, discover
from gesture_core.run.labels import label_inputs
from gesture_core.run.results import Results
from gesture_core.run.workers.engines import Assistant
from gesture_core.settings import Settings

if TYPE_CHECKING:
    from gesture_core.run.export import KeypointFiles


@dataclass(frozen=True)
class RunRequest:
    """What a run is to do: the parameters of `archive.classify_archive`; without examples, extract only."""

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
    shard: str = ""


@dataclass(frozen=True)
class Plan:
    """The work of a run.

    Attributes
    ----------
    settings : Settings
        With the kernel that was chosen; ``""`` where keypoints are only extracted.
    inputs, examples : list of Input
    waiting : list of Input
        Inputs that have no row for their content yet.
    identity : mapping
        From `fingerprint.pose_identity`.
    fingerprint : str
        Of everything that decides a row, but for the input.
    contradictions : dict
        An example of another label with the same content, by the key of each example that has one: either
        label may be the wrong one, so neither can be used.
    files : KeypointFiles or None
        Where an extraction leaves its keypoints.
    gone : int
        Inputs of earlier runs whose rows were removed, as they are not there any more.
    """

    settings: Settings
    inputs: list[Input]
    examples: list[Input]
    waiting: list[Input]
    identity: Mapping[str, Any]
    fingerprint: str
    contradictions: dict[bytes, Input]
    files: KeypointFiles | None
    gone: int = 0


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
    settings, shard = request.settings, None
    if request.spot:
        from gesture_core.spot.signals import refuse_channels, refuse_limits

        refuse_limits(settings)
        if settings.spot.live:
            refuse_channels(settings)
    if request.shard:
        from gesture_core.run.shards import Shard

        shard = Shard.parse(request.shard)
    registry().load("engine", request.engine)
    found = discover(request.sources, avoid=request.out, assistant=assistant)
    if not found:
        raise InputError(
            "holds no input",
            subject=", ".join(map(shown, request.sources)),
            remedy="another path",
            code="E_EMPTY",
        )
    for place, item in enumerate(found):  # in their place, as there may be a million
        if shard is None or shard.holds(item):
            found[place] = _stamped(item)
    inputs = found if shard is None else [item for item in found if shard.holds(item)]
    examples = _examples(request, assistant)
    kernel = ""
    if examples:
        _check_enough(settings, [item for item in examples if item.kind != "other"])
        kernel = assistant.ask("open_classifier", keep=True)
    settings = replace(settings, classify=replace(settings.classify, kernel=kernel))
    examples = [_hashed(_stamped(item), results) for item in examples]
    every = [*found, *examples]  # a shard's rows are those that one run of all would have
    videos = any(item.kind == "video" for item in every)
    if videos:
        settings = choose_pose(settings)
    identity = pose_identity(settings, every)
    configuration = run_configuration(settings, identity, examples, kernel, request.spot)
    configuration, changed = _compared(results, configuration, overwrite=request.overwrite)
    if not request.overwrite:
        _check_same_shard(results, str(shard or ""))
    again = changed or request.overwrite or switched_on("GESTURE_NO_CACHE")
    files = None
    if not examples:
        from gesture_core.run.export import KeypointFiles

        files = KeypointFiles(request.out, results, found, [*map(local_path, request.sources)])
    lacking = files.lacking() if files else set()
    undone = {item.key: item.stamp for item in inputs}
    for key, stamp_then in () if again else results.done(retry_errors=request.retry_errors):
        if stamp_then and key not in lacking and undone.get(key) == stamp_then:
            del undone[key]
    waiting = [item for item in inputs if item.key in undone]
    del undone
    if waiting and any(item.kind == "video" for item in (*waiting, *examples)):
        with OpenEngine(settings, identity, most=1, engine=request.engine) as engine:
            engine.require_model()
    if changed or request.overwrite:
        results.clear()
    elif not waiting:
        configuration["examples"] = _as_known(configuration["examples"], results.configuration)
    mark = fingerprint(configuration)
    part = _part(str(shard or ""), found, inputs)
    results.set({"configuration": configuration, "fingerprint": mark, "part": part})
    gone = _gone(results, found, request.sources)
    results.forget(gone)
    if files:
        files.sweep()
    return Plan(
        settings=settings,
        inputs=inputs,
        examples=examples,
        waiting=waiting,
        identity=identity,
        fingerprint=mark,
        contradictions=_contradictions(examples),
        files=files,
        gone=len(gone),
    )


def _examples(request: RunRequest, assistant: Assistant) -> list[Input]:
    if not request.examples:
        return []
    found = discover(request.examples, avoid=request.out, assistant=assistant)
    if all(item.kind == "other" for item in found):
        pictures = any(item.path.suffix.lower() in PICTURE_SUFFIXES for item in found)
        why = next((f": {item.name}: {item.fault}" for item in found if item.fault), "")
        raise InputError(
            f"holds no example{why}",
            subject=", ".join(map(shown, request.examples)),
            remedy="examples/<label>/<clip>" + (f", or for a picture {FRAMES}" if pictures else ""),
            code="E_EMPTY",
        )
    labelled = label_inputs(found, request.labels, request.examples, request.label_columns)
    # What nobody reads is a lost example where it has a label; without one it was never meant as any.
    meant = [
        item
        for item in labelled
        if item.kind != "other" or (item.label and item.path.suffix.lower() not in COMPANIONS)
    ]
    named = [item.path for item in meant if item.kind != "other"]
    clips = {*named, *(path.with_suffix("") for path in named)}
    beside = {
        item.key: item.name for item in meant if item.kind == "other" and item.path.with_suffix("") in clips
    }
    if beside:
        first = next(iter(beside.values()))
        text = f"no examples, but files beside clips of their names: {len(beside)}, as {first}"
        warnings.warn(text, stacklevel=3)
    return [item for item in meant if item.key not in beside]


def _check_enough(settings: Settings, examples: Sequence[Input]) -> None:
    """Raise what too few examples would raise, before hours of extraction instead of after them."""
    if settings.classify.votes > len(examples):
        raise ConfigError(
            f"{settings.classify.votes} neighbours of {len(examples)} examples",
            remedy=f"--neighbors 1 to {len(examples)}, or 0 for all of them, weighed",
            code="E_NEIGHBORS",
        )
    if settings.classify.reject_sd is not None and len({item.label for item in examples}) == len(examples):
        raise ConfigError(
            f"--reject {settings.classify.reject_sd:g}sd: no class has two examples",
            remedy="two examples of a class at least (better three of each), or --reject with a distance",
            code="E_REJECT",
        )


def _stamped(item: Input) -> Input:
    """With the file's stamp; without one, where it cannot be looked at, it never counts as known."""
    if item.stamp:  # it was found with it
        return item
    with suppress(OSError):
        return replace(item, stamp=stamp(item.path))
    return item


def _hashed(item: Input, results: Results) -> Input:
    """An example with its content hash, computed only where the file has been written since last time."""
    if item.kind == "other":
        return item
    known = results.sha256(item) if item.stamp else None
    with suppress(OSError):
        if not known:
            known = _content(item)
            results.remember(item, known)
    return replace(item, sha256=known or "")


def _as_known(examples: dict[str, Any], before: Mapping[str, Any]) -> dict[str, Any]:
    """The same examples, wherever they lie now, by the names that rows and what is fitted have for them."""
    names: dict[tuple[str, str, str], list[str]] = {}
    for name, content in contents_of(before.get("examples", {})).items():
        names.setdefault(content, []).append(name)
    found = contents_of(examples)
    return {names[found[name]].pop(0): known for name, known in examples.items()} if names else examples


def _content(item: Input) -> str:
    """The content hash of an example, as it is now."""
    if item.address:
        entry = look(item.address)
        if known := sha256_of(entry):
            return known
        fetch(entry, item.path)
    return content_sha256(item.path)


def _compared(
    results: Results, configuration: dict[str, Any], *, overwrite: bool
) -> tuple[dict[str, Any], bool]:
    """The configuration, with what the folder's rows need as well, and whether these were made with another
    one: an error unless that is wanted.
    """
    before = results.configuration
    if not before:
        return configuration, False
    together = with_parts_of(before, configuration)
    changed = differences(with_parts_of(configuration, before), together)
    if not changed:
        return together, False
    if not results.counts():
        return configuration, True
    if not overwrite:
        lines = "\n  ".join(changed[:20]) + (f"\n  … and {len(changed) - 20} more" if changed[20:] else "")
        what = "examples" if all(line.startswith("example ") for line in changed) else "settings"
        raise ConfigError(
            f"holds a run made with other {what}",
            subject=str(results.path.parent),
            kept="its rows and all keypoints",
            remedy=f"--overwrite to begin again (keypoints are reused), or another --out\n  {lines}",
            code="E_CONFIG_CHANGED",
        )
    return configuration, True


def _part(shard: str, found: Sequence[Input], inputs: Sequence[Input]) -> dict[str, Any]:
    """What a run folder is merged by: its shard, the number of its inputs, and a hash of all names."""
    names = hashlib.sha256()
    for name in sorted(map(attrgetter("name"), found)):
        names.update(name.encode("utf-8", "surrogatepass") + b"\0")
    return {"shard": shard, "inputs": len(inputs), "found": len(found), "names": names.hexdigest()[:16]}


def _check_same_shard(results: Results, shard: str) -> None:
    """Raise ``E_CONFIG_CHANGED`` where the run folder has rows, of another shard."""
    before = json.loads(results.get("part") or "{}").get("shard", "")
    if before != shard and results.counts():
        raise ConfigError(
            f"holds {f'shard {before}' if before else 'a run without --shard'}",
            subject=str(results.path.parent),
            kept="its rows",
            remedy="another --out for each shard",
            code="E_CONFIG_CHANGED",
        )


def _gone(results: Results, inputs: Sequence[Input], sources: Sequence[str]) -> list[bytes]:
    """Keys of rows whose input no longer exists, or is now read in another way."""
    keys = {item.key for item in inputs}
    listed = roots(sources)
    strange = [
        (key, place)
        for key, place in results.places()
        if key not in keys and (b"://" not in place or place.startswith(listed))
    ]
    places = {item.place for item in inputs} if strange else set()
    return [key for key, place in strange if place in places or not os.path.lexists(place)]


def _contradictions(examples: Sequence[Input]) -> dict[bytes, Input]:
    alike: dict[tuple[str, str], list[Input]] = {}
    for item in examples:
        if item.sha256:
            alike.setdefault((item.sha256, item.member), []).append(item)
    found = {}
    for group in alike.values():
        for item in group:
            if others := [one for one in group if one.label != item.label]:
                found[item.key] = others[0]
    return found
