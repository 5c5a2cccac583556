"""What the columns of a table are, by the names that its header gives them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joint_named, joints_named, words_of
from gesture_core.plugin.reading import ReadOptions, Unit
from gesture_core.skeletons import COCO18, Skeleton, skeleton_of
from gesture_pose_files.layout import by_count
from gesture_pose_files.table import UNITS

_PARTS = {
    "x": "x", "y": "y", "z": "z", "score": "score", "scores": "score", "confidence": "score",
    "conf": "score", "c": "score", "likelihood": "score", "visibility": "score", "vis": "score",
    "v": "score", "prob": "score", "probability": "score", "p": "score", "s": "score",
}  # fmt: skip
# What is written without a mark after a joint: nosex, LShoulderConf.
_ENDINGS = ("confidence", "likelihood", "visibility", "score", "conf", "x", "y", "z", "c")
_NUMBERED = set(
    "kp kpt kps kpts keypoint keypoints joint joints landmark landmarks lm point points pt pose j k marker "
    "node position pos location bones".split()
)
_TIMES = dict.fromkeys(
    ("time", "times", "timestamp", "timestamps", "t", "sec", "secs", "second", "seconds", "timesec", "times",
     "timeseconds", "timestampsec", "timestamps", "timestampseconds"), 1.0,
) | dict.fromkeys(
    ("ms", "msec", "timems", "timemsec", "timestampms", "timestampmsec", "milliseconds", "timemilliseconds"),
    1e-3,
) | {"timeus": 1e-6, "timestampus": 1e-6, "us": 1e-6, "timens": 1e-9, "timestampns": 1e-9}  # fmt: skip
FRAMES = set(
    "frame frames frameid framenumber frameno framenum frameidx frameindex framenr framecount image imageid "
    "imageindex imgid imagename f bodypartscoords scorerbodypartscoords coords".split()
)
# The likelier one first.
_PEOPLE = (
    "person personid personidx personindex people peopleid track trackid trackingid trackerid human humanid "
    "player playerid individual individuals subject subjectid actor actorid object objectid obj objid "
    "instance instanceid body bodyid skeletonid poseid poseindex pid targetid id ids".split()
)
_CLIPS = set(
    "video videoid videoname videofile clip clipid clipname sequence sequenceid seq seqid recording "
    "recordingid recordingname trial trialid".split()
)
_JOINTS = set(
    "keypoint keypointid keypointname keypointidx keypointindex joint jointid jointname jointidx jointindex "
    "bodypart bodypartname landmark landmarkid landmarkname landmarkidx landmarkindex kp kpid part partname "
    "point pointid node nodename marker markername jointtype bone bonename".split()
)
INDEX = {"", "index", "indexlevel0", "level0", "unnamed", "row", "rowid", "rownumber", "rownames"}
_SHOWN = 5
_FEWEST_NUMBERED = 5


@dataclass(frozen=True)
class Columns:
    """Where a header puts what.

    Attributes
    ----------
    body : Skeleton or None
        Of the joints that are named; None in a long table, whose rows name them.
    x, y, z, score : tuple of (int or None)
        Column of each joint; one each in a long table; z is empty where nothing has one.
    named : bool
        The header names the joints; otherwise it numbers them.
    time, frame, person, joint, clip : int or None
        Columns; the seconds of a unit of the first are ``tick``.
    index : tuple of int
        Columns that number the rows, as data-frame libraries write them.
    unused : tuple of str
        Names of all other columns.
    unit : "pixels", "metres" or None
        Of the coordinates, where all their names say one.
    """

    body: Skeleton | None
    x: tuple[int | None, ...]
    y: tuple[int | None, ...]
    score: tuple[int | None, ...]
    z: tuple[int | None, ...] = ()
    named: bool = True
    time: int | None = None
    tick: float = 1.0
    frame: int | None = None
    person: int | None = None
    joint: int | None = None
    clip: int | None = None
    index: tuple[int, ...] = ()
    unused: tuple[str, ...] = ()
    unit: Unit | None = None


def unused_note(names: Sequence[str]) -> list[str]:
    """A clause about columns that are not used."""
    if not names:
        return []
    shown = ", ".join(name.strip()[:40] or "(no name)" for name in names[:_SHOWN])
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return [f"column{'s' if len(names) > 1 else ''} not used: {shown}{more}"]


def missing_note(body: Skeleton | None) -> list[str]:
    """A clause about joints that a file of its own choice of joints lacks."""
    if body is None or body.name != "named":
        return []
    lacking = [j for j in COCO18.joints if j not in body.joints and j not in body.derived]
    parts = dict.fromkeys(j.removeprefix("left_").removeprefix("right_") for j in lacking)
    named = [
        f"{part}s" if {f"left_{part}", f"right_{part}"} <= set(lacking) else
        next(j for j in lacking if j.endswith(part)).replace("_", " ")
        for part in parts
    ]  # fmt: skip
    return [f"not in the file and not compared: {', '.join(named)}"] if named else []


def columns_of(names: Sequence[str], options: ReadOptions, source: str) -> Columns | None:
    """The columns that a header names; None where it names no joints.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_FORMAT` where two columns are one coordinate or one of two is not there,
        `E_KEYPOINTS_SKELETON` where joints are numbered and no known skeleton has so many, or neither neck
        nor shoulders are among them.
    """
    places: dict[tuple[str | int, str], int] = {}
    single: dict[str, int] = {}
    other: list[int] = []
    split = [words_of(name) for name in names]
    keys = [_coordinate(words) for words in split]
    based = any(
        key is not None and key[0] == "neck" not in words for key, words in zip(keys, split, strict=True)
    )
    for column, (name, words, key) in enumerate(zip(names, split, keys, strict=True)):
        if key is None:
            role = "".join(words).removesuffix("0") if words[:1] == ["unnamed"] else "".join(words)
            if role in single:
                other.append(column)
            else:
                single[role] = column
        elif based and key[0] == "neck" in words:
            places["upper_neck", key[1]] = column  # another is its base: Kinect's, Human3.6M's
        elif key in places and key[0] == "":
            other.append(column)
        elif key in places:
            raise KeypointError(
                f"its columns {names[places[key]]!r} and {name!r} are the same coordinate",
                subject=source,
                code="E_KEYPOINTS_FORMAT",
            )
        else:
            places[key] = column
    pairs = [joint for joint, part in places if part == "x" and (joint, "y") in places]
    _refuse_halves([*places], pairs, [names[column] for column in places.values()], source)
    named = [joint for joint in pairs if isinstance(joint, str) and joint]
    numbers = sorted(joint for joint in pairs if isinstance(joint, int))
    joint = next((single[role] for role in single if role in _JOINTS), None)
    body: Skeleton | None = None
    if len(named) > 1:
        body, joints = _with_neck(skeleton_of(named), options, source), list[str | int](named)
    elif len(numbers) >= _FEWEST_NUMBERED:  # fewer may be the corners of a box
        body, joints = _numbered(numbers, options, source), list[str | int](numbers)
    elif joint is not None and "" in pairs:
        joints = [""]
    else:
        bare, unit = _without_units(names)
        found = columns_of(bare, options, source) if unit and bare != [*names] else None
        return replace(found, unit=unit) if found else None
    time = next((role for role in single if role in _TIMES), None)
    frame = next((single[role] for role in single if role in FRAMES), None)
    person = next((single[role] for role in _PEOPLE if role in single), None)
    known = {frame, person, single.get(time or "-"), joint if joints == [""] else None}
    known |= {places[j, part] for j in joints for part in ("x", "y", "z", "score") if (j, part) in places}
    index = tuple(column for role, column in single.items() if role in INDEX)
    known |= {*index, single.get("id")}
    unused = [n for column, n in enumerate(names) if column not in known]
    z = tuple(places.get((j, "z")) for j in joints)
    flat = [f"{j} (no z)" for j, column in zip(joints, z, strict=True) if column is None]
    if len(flat) == len(joints):
        z = ()
    elif options.depth:
        unused[:0] = flat
    else:
        unused.insert(0, "depth (z), which --preset depth uses")
    return Columns(
        body,
        tuple(places.get((j, "x")) for j in joints),
        tuple(places.get((j, "y")) for j in joints),
        tuple(places.get((j, "score")) for j in joints),
        z=z,
        named=body is None or len(named) > 1,
        time=single[time] if time else None,
        tick=_TIMES[time] if time else 1.0,
        frame=frame,
        person=person,
        joint=joint if joints == [""] else None,
        clip=next((single[role] for role in single if role in _CLIPS), None),
        index=index,
        unused=tuple(unused),
    )


def _refuse_halves(
    places: Sequence[tuple[str | int, str]], pairs: Sequence[str | int], names: Sequence[str], source: str
) -> None:
    """Refuse joints that have an x and no y, or a y and no x, where others have both."""
    for (joint, part), name in zip(places, names, strict=True):
        if len(pairs) > 1 and joint != "" and isinstance(joint, str) and part in "xy" and joint not in pairs:
            other = "y" if part == "x" else "x"
            raise KeypointError(
                f"has a column {name.strip()[:40]!r} and none for its {other}",
                subject=source,
                remedy="both columns of a joint, or neither",
                code="E_KEYPOINTS_FORMAT",
            )


def _without_units(names: Sequence[str]) -> tuple[list[str], Unit | None]:
    """Names without the units of coordinates at their ends, and that unit where there is one."""
    bare, units = [], set()
    for name in names:
        words = words_of(name)
        unit = UNITS.get(words[-1]) if len(words) > 1 else None
        ends = [*re.finditer(re.escape(words[-1]), name, re.IGNORECASE | re.ASCII)] if unit else []
        bare.append(name[: ends[-1].start()] if ends else name)
        units |= {unit} if unit and _coordinate(words[:-1]) else set()
    return bare, ("metres" if "metres" in units else "pixels") if len(units) == 1 else None


def _coordinate(words: list[str]) -> tuple[str | int, str] | None:
    """The joint, by name or number, and which of its values a column of this name holds.

    The joint is "" where only the value is named, as in a table with a row for each joint.
    """
    for part, rest in ((words[-1:], words[:-1]), (words[:1], words[1:])):
        value = _PARTS.get(part[0]) if part else None
        if value is None:
            continue
        if not rest:
            return ("", value) if part[0] not in ("t", "p", "s", "c") else None
        if rest[-1].isdigit() and (len(rest) == 1 or set(rest[:-1]) <= _NUMBERED) and len(rest[-1]) < 5:
            return int(rest[-1]), value
        plain = [word for word in rest if word not in _NUMBERED]  # pose_nose_x, nose_landmark_x
        if joint := joint_named("_".join(rest)) or joint_named("_".join(plain)):
            return joint, value
    for ending in _ENDINGS if words else ():
        if words[-1].endswith(ending) and words[-1] != ending:
            rest = [*words[:-1], words[-1].removesuffix(ending)]
            if joint := joint_named("_".join(word for word in rest if word not in _NUMBERED)):
                return joint, _PARTS[ending]
    return None


def _with_neck(body: Skeleton, options: ReadOptions, source: str) -> Skeleton:
    if not (body.has_neck or (options.whole and body.has_hands)):
        raise KeypointError(
            f"names {len(body.joints)} joints, but neither a neck nor both shoulders: the body has no origin",
            subject=source,
            remedy="columns left_shoulder_x, left_shoulder_y, right_shoulder_x, right_shoulder_y",
            code="E_KEYPOINTS_SKELETON",
        )
    return body


def _numbered(numbers: list[int], options: ReadOptions, source: str) -> Skeleton:
    count = len(numbers)
    whole = numbers[0] in (0, 1) and numbers[-1] - numbers[0] == count - 1
    body = options.skeleton or by_count(options).get(count)
    if not whole or body is None or len(body.joints) != count:
        said = f", and keypoints.order names {len(body.joints)}" if body and options.order else ""
        raise KeypointError(
            f"numbers {count} joints from {numbers[0]} to {numbers[-1]}{said}, which is no known skeleton",
            subject=source,
            remedy="--set keypoints.order=… with a skeleton, or the names of the joints",
            code="E_KEYPOINTS_SKELETON",
        )
    return body


def body_of_rows(labels: Sequence[str], options: ReadOptions, source: str) -> tuple[Skeleton, dict[str, int]]:
    """The skeleton of a table with a row for each joint, and the place of each label in it."""
    if all(label.strip().isdigit() for label in labels):
        numbers = sorted({int(label) for label in labels})
        body = _numbered(numbers, options, source)
        return body, {label: int(label) - numbers[0] for label in labels}
    joints = dict(zip(labels, joints_named(labels), strict=True))
    found = [joint for joint in joints.values() if joint]
    if len(set(found)) < max(2, len(found)):
        unknown = ", ".join(label[:40] for label, joint in joints.items() if not joint) or ", ".join(found)
        raise KeypointError(
            f"its rows name no joints: {unknown[:200]}", subject=source, code="E_KEYPOINTS_SKELETON"
        )
    body = _with_neck(skeleton_of(found), options, source)
    return body, {label: body.index(joint) for label, joint in joints.items() if joint}
