"""Everything that decides a result, as one tree, and its hash."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gesture_core
from gesture_core.files import tree_sha256
from gesture_core.plugin import registry
from gesture_core.run.inputs import Input
from gesture_core.settings import Settings


def pose_identity(settings: Settings, items: Collection[Input]) -> dict[str, Any]:
    """What decides the keypoints of ``items``, apart from their content.

    Parameters
    ----------
    settings : Settings
    items : collection of Input

    Returns
    -------
    dict
        ``readers`` by name, all of them, so that no row depends on what else is in its run; and ``video``
        where there is one: otherwise it does not count which network is there, if any. See `pose_keys`.

    Raises
    ------
    PluginError
        Where the pose backend or the video reader is none.
    ModelError, ConfigError
        From `choose_pose`, where there are videos.
    """
    plugins, tree = registry(), settings.as_dict()
    for kind, name in (("pose", settings.pose.backend), ("video", settings.pose.reader)):
        if name != "auto":  # a mistyped name is one whether there are videos or not
            plugins.find(kind, name)
    shared = {
        "people": tree["pose"]["people"],
        "score": tree["pose"]["score"],
        "keypoints": tree["keypoints"],
    }
    identity: dict[str, Any] = {
        "readers": {
            name: {
                "origin": plugins.find("reader", name).identity,
                "options": settings.options.get(name, {}),
                **shared,
            }
            for name in plugins.names("reader", usable=True)
        }
    }
    videos = any(item.kind == "video" for item in items)
    return {"video": _video_identity(settings), **identity} if videos else identity


def _video_identity(settings: Settings) -> dict[str, Any]:
    from gesture_core.pose.extract import REVISION
    from gesture_core.pose.models import FINDER, choose_pose, find_model
    from gesture_core.video import reader_name

    plugins, settings = registry(), choose_pose(settings)
    found = find_model(settings.pose.model)
    contract = found.contract
    model: dict[str, Any] = {"sha256": found.sha256, "contract": contract.as_table() if contract else None}
    if contract and contract.layout == "blazepose":
        model["finder"] = find_model(FINDER).sha256
    if {"hands", "face"} & {*settings.keypoints.parts}:
        from gesture_core.pose.parts import finders_of

        for finder in finders_of(settings.keypoints.parts):
            model[finder.part] = find_model(finder.model).sha256
            model[f"{finder.part}_revision"] = finder.revision
    reader = reader_name(settings.pose.reader, settings.options)
    return {
        "package": gesture_core.__version__,
        "extraction": REVISION,
        "settings": settings.as_dict()["pose"],
        "times": settings.as_dict()["video"],
        **({"depth": True} if settings.keypoints.depth else {}),
        "backend": plugins.find("pose", settings.pose.backend).identity,
        "options": settings.options.get(settings.pose.backend, {}),
        "reader": {
            "name": reader,
            "origin": plugins.find("video", reader).identity,
            "options": settings.options.get(reader, {}),
        },
        "model": model,
    }


def pose_keys(identity: Mapping[str, Any]) -> dict[str, str]:
    """For videos (``video``) and each keypoint reader (its name): the part of a name in the store."""
    video = {"video": fingerprint(identity["video"])} if "video" in identity else {}
    return video | {f"reader {name}": fingerprint(tree) for name, tree in identity["readers"].items()}


def run_configuration(
    settings: Settings,
    identity: Mapping[str, Any],
    examples: Sequence[Input],
    kernel: str,
    spot: bool = False,
) -> dict[str, Any]:
    """What decides the result of a run; ``examples`` have their content hashes.

    With ``spot`` they are looked for in long recordings. Without a ``kernel`` nothing is compared, and
    only what decides the keypoints counts.
    """
    if not kernel:
        tree = _told(settings, identity)
        pose = {section: tree[section] for section in ("video", "pose", "keypoints") if section in tree}
        return {"settings": pose, "keypoints": dict(identity), "plugins": {}, "examples": {}}
    settings = replace(settings, classify=replace(settings.classify, kernel=kernel))
    steps = [registry().find(kind, name.partition(":")[0]) for kind, name in settings.plugins()]
    tree = _told(settings, identity)
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
                "sha256": item.sha256,
                "member": item.member,
                "path": os.fsdecode(item.place),
            }
            for item in examples
        },
    }


def with_parts_of(earlier: Mapping[str, Any], configuration: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration, with what decided the inputs of an earlier run of which this one has none.

    A run of keypoint files alone has no network, and one of videos alone no reader: what stood for them
    neither changes nor gets lost.
    """
    before, now = earlier["keypoints"], configuration["keypoints"]
    settings = {**configuration["settings"]}
    if "video" not in now and "video" in before:
        settings |= {
            "video": earlier["settings"]["video"],
            "pose": earlier["settings"]["pose"] | settings["pose"],
        }
    keypoints = {**before, **now, "readers": {**before["readers"], **now["readers"]}}
    return {**configuration, "settings": settings, "keypoints": keypoints}


def _told(settings: Settings, identity: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that count: those of videos only where there are any, and the file of a network, if it is
    one, as it is found from any folder.
    """
    tree = settings.as_dict()
    model = Path(settings.pose.model).expanduser()
    if model.name != settings.pose.model and model.is_file():
        tree["pose"]["model"] = str(model.absolute())
    if "video" not in identity:
        del tree["video"]
        tree["pose"] = {name: tree["pose"][name] for name in ("people", "score")}
    return tree


def fingerprint(configuration: Mapping[str, Any]) -> str:
    """Sixteen hexadecimal digits that change when anything in ``configuration`` does that decides a result.

    Of examples that is what is in them and their labels, not where they are.
    """
    tree = dict(configuration)
    if "examples" in tree:
        tree["examples"] = sorted(map(list, contents_of(tree["examples"]).values()))
    return tree_sha256(tree)[:16]


def contents_of(examples: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[str, str, str]]:
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
    there = Counter(contents_of(other.get("examples", {})).values())
    for name, content in contents_of(examples).items():
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
