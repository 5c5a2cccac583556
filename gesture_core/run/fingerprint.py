"""Everything that decides a result, as one tree, and its hash."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gesture_core
from gesture_core.errors import ModelError
from gesture_core.files import tree_sha256
from gesture_core.plugin import registry
from gesture_core.run.inputs import Input
from gesture_core.settings import Settings


def pose_identity(settings: Settings, with_model: bool) -> dict[str, Any]:
    """What decides the keypoints of an input, apart from its content.

    Parameters
    ----------
    settings : Settings
    with_model : bool
        False where no input is a video; then the model may be missing.

    Returns
    -------
    dict
        ``video`` and ``readers``, the latter by name; see `pose_keys`.
    """
    from gesture_core.pose.extract import REVISION
    from gesture_core.pose.models import FINDER, choose_pose, find_model
    from gesture_core.video import reader_name

    plugins = registry()
    settings = choose_pose(settings, needed=with_model)
    tree = settings.as_dict()
    pose = tree["pose"]
    shared = {"people": pose["people"], "score": pose["score"], "keypoints": tree["keypoints"]}
    model: dict[str, Any] | None
    try:
        found = find_model(settings.pose.model)
        contract = found.contract
        model = {"sha256": found.sha256, "contract": contract.as_table() if contract else None}
        if contract and contract.layout == "blazepose":
            model["finder"] = find_model(FINDER).sha256
    except ModelError:
        if with_model:
            raise
        model = None
    backend = settings.pose.backend
    reader = reader_name(settings.pose.reader, settings.options)
    video = {
        "package": gesture_core.__version__,
        "extraction": REVISION,
        "settings": pose,
        "fps": settings.video.fps,
        "backend": backend if backend == "auto" else plugins.find("pose", backend).identity,
        "options": settings.plugin_options(settings.pose.backend),
        "reader": {
            "name": reader,
            "origin": plugins.find("video", reader).identity,
            "options": settings.plugin_options(reader),
        },
        "model": model,
    }
    readers = {
        name: {
            "origin": plugins.find("reader", name).identity,
            "options": settings.plugin_options(name),
            **shared,
        }
        for name in plugins.names("reader", usable=True)
    }
    return {"video": video, "readers": readers}


def pose_keys(identity: Mapping[str, Any]) -> dict[str, str]:
    """For videos (``video``) and each keypoint reader (its name): the part of a name in the store."""
    return {
        "video": fingerprint(identity["video"]),
        **{f"reader {name}": fingerprint(tree) for name, tree in identity["readers"].items()},
    }


def run_configuration(
    settings: Settings,
    identity: Mapping[str, Any],
    examples: Sequence[tuple[Input, str]],
    kernel: str,
    spot: bool = False,
) -> dict[str, Any]:
    """What decides the result of a run; ``examples`` come with their content hashes.

    With ``spot`` they are looked for in long recordings. Without a ``kernel`` nothing is compared, and
    only what decides the keypoints counts.
    """
    if not kernel:
        tree = _placed(settings).as_dict()
        pose = {section: tree[section] for section in ("video", "pose", "keypoints")}
        return {"settings": pose, "keypoints": dict(identity), "plugins": {}, "examples": {}}
    settings = replace(settings, classify=replace(settings.classify, kernel=kernel))
    steps = [registry().find(kind, name.partition(":")[0]) for kind, name in settings.plugins()]
    tree = _placed(settings).as_dict()
    del tree["limits"]
    if not spot:
        del tree["spot"]
    return {
        "settings": tree,
        "keypoints": dict(identity),
        "plugins": {f"{step.kind} {step.name}": step.identity for step in steps},
        "examples": {
            item.name: {
                "label": item.label,
                "sha256": sha256,
                "member": item.member,
                "path": os.fsdecode(item.place),
            }
            for item, sha256 in examples
        },
    }


def _placed(settings: Settings) -> Settings:
    """The settings with the file of a model, if it is one, as it is found from any folder."""
    model = Path(settings.pose.model).expanduser()
    if model.name == settings.pose.model or not model.is_file():
        return settings
    return replace(settings, pose=replace(settings.pose, model=str(model.absolute())))


def fingerprint(configuration: Mapping[str, Any]) -> str:
    """Sixteen hexadecimal digits that change when anything in ``configuration`` does that decides a result.

    Of examples that is what is in them and their labels, not where they are.
    """
    tree = dict(configuration)
    if "examples" in tree:
        tree["examples"] = sorted(map(list, _contents(tree["examples"]).values()))
    return tree_sha256(tree)[:16]


def _contents(examples: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[str, str, str]]:
    """Label, content and sequence of each example, by its name."""
    return {
        name: (str(known["label"]), known["sha256"], known.get("member", name.partition("::")[2]))
        for name, known in examples.items()
    }


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """What changed between two configurations, one line each: ``key: old -> new``.

    Settings come first, by the keys that ``--set`` takes; of a plugin only another version is said,
    because a setting says that another one was chosen.
    """
    before, after = _said(old, new), _said(new, old)
    lines = []
    for key in sorted(before.keys() | after.keys()):
        one, other = before.get(key, _ABSENT), after.get(key, _ABSENT)
        if one != other and not (key[1].startswith("plugin ") and _ABSENT in (one, other)):
            lines.append(f"{key[1]}: {one} -> {other}")
    return lines


_ABSENT = "(absent)"


def _said(configuration: Mapping[str, Any], other: Mapping[str, Any]) -> dict[tuple[int, str], Any]:
    """What a user is told of a configuration beside another one, by rank and key."""
    tree = dict(configuration)
    settings, plugins, examples = (tree.pop(part, {}) for part in ("settings", "plugins", "examples"))
    said = {(0, ".".join(path).removeprefix("options.")): value for path, value in _leaves(settings)}
    said |= {(1, f"plugin {name}"): origin for name, origin in plugins.items()}
    said |= {(2, " ".join(path)): value for path, value in _leaves(tree)}
    there = Counter(_contents(other.get("examples", {})).values())
    for name, content in _contents(examples).items():
        if not there[content]:
            said[3, f"example {name}"] = f"{content[0]} ({content[1][:12]})"
        there[content] -= there[content] > 0
    return said


def _leaves(tree: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            yield from _leaves(value, (*path, key))
    else:
        yield path, tree
