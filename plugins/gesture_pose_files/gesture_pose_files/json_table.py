"""Clips in JSON that their author's own lines of Python wrote: read as a table with a row for each frame.

What is nested is flattened into names of columns, so that ``[{"nose": {"x": 1, "y": 2}}, …]``, MediaPipe's
landmarks in a list for each frame, tables of data-frame libraries and JSON lines are all one thing, and the
columns mean what they mean in a table.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, KeypointError
from gesture_core.files import printable
from gesture_core.joint_names import words_of
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.columns import FRAMES, INDEX, columns_of
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.files import MAX_FRAMES, MAX_LIST_BYTES, suffix_of
from gesture_pose_files.json_people import SCORES
from gesture_pose_files.json_text import described, kind_of, load, load_head, load_lines
from gesture_pose_files.layout import flat_widths
from gesture_pose_files.numbering import number_in

SUFFIXES = (".json", ".jsonl", ".ndjson")
_FRAMES = tuple(
    "frames data results predictions poses landmarks pose_landmarks keypoints joints bones".split()
)
_PEOPLE = tuple("people persons bodies instances predictions skeletons poses pose_landmarks".split())
_DETECTED = {"bbox", "box", "score", "class", "category_id"}
"""What a detected person has, and a frame has not."""
_RATES, _SIDES = ("fps", "frame_rate", "framerate"), ("width", "height")
_VALUES = {2: ("x", "y"), 3: ("x", "y", "score"), 4: ("x", "y", "z", "score")}
_MEDIAPIPE = 33
_MOST_DIGITS = 18
"""Of the number of a frame, so that it fits into 64 bits."""

Record = dict[str, Any]


@dataclass(frozen=True)
class _Clip:
    """Frames by their numbers, and what else the file says: the rate, and the size of the picture."""

    frames: Sequence[tuple[int, Any]]
    said: Mapping[str, Any]


class JsonTableReader(CsvReader):
    """Reads clips in JSON and JSON lines in the forms that people write by themselves.

    - A list of frames, or an object with that list in it (``frames``, ``data``, …) or with frames by their
      numbers; each frame a list of joints, an object of joints by name, or people with such.
    - A joint is ``{"x": …, "y": …}``, or a list of x, y, perhaps a score, or x, y, z and a visibility.
    - What pandas writes with any ``orient``.
    """

    name = "json-table"

    def accepts(self, path: Path) -> bool:
        """Whether the file holds a clip in one of these forms, and is none of the known tools' own."""
        suffix = suffix_of(path)
        if suffix not in SUFFIXES:
            return False
        kind = kind_of(path) if suffix == ".json" else "other"
        return kind != "list" and not (kind == "frame" and number_in(path.name)) and self._is_clip(path)

    def _is_clip(self, path: Path) -> bool:
        """By how it begins where that is enough."""
        for head in (True, False):
            try:
                names, _, options = self._table(path, head=head)
                if columns_of(names, options, printable(path)) is not None:
                    return True
            except KeypointError as error:
                if error.code == "E_KEYPOINTS_SKELETON" and not head:
                    return True  # reading it says why
        return False

    def refusal(self, path: Path) -> str:
        """What a file of JSON lines begins with; of JSON, others say it."""
        if suffix_of(path) == ".json":
            return ""
        return (
            f"{described(path)} in its first line, and no frame with joints by their names, as "
            '{"frame": 0, "nose": {"x": 1, "y": 2}, …}, or with a list of them'
        )

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The people in the file."""
        names, records, options = self._table(path)
        columns = columns_of(names, options, source)
        if columns is None:
            raise KeypointError("holds no frames with joints", subject=source, code="E_KEYPOINTS_FORMAT")
        rows = ([_cell(record.get(name)) for name in names] for record in records)
        return replace(self, options=options)._named(names, columns, rows, source)

    def _table(self, path: Path, *, head: bool = False) -> tuple[list[str], list[Record], ReadOptions]:
        """The names of the columns, the rows, and the options with what the file says; by its ``head``."""
        source = printable(path)
        clip = _clip(self._tree(path, head=head))
        if clip is None or not clip.frames:
            raise KeypointError("holds no frames", subject=source, code="E_KEYPOINTS_FORMAT")
        if len(clip.frames) > MAX_FRAMES:
            raise KeypointError(
                f"holds {len(clip.frames)} frames, more than {MAX_FRAMES}",
                subject=source,
                remedy="split it",
                code="E_KEYPOINTS_LIMIT",
            )
        options = _with_said(self.options, clip.said)
        frames = [(number, [*_records(frame, options)]) for number, frame in clip.frames]
        indexed = all(len(records) == 1 and _in_order(records[0], INDEX) for _, records in frames)
        for number, records in () if indexed else frames:
            for record in records:
                if not _in_order(record, FRAMES):
                    record["frame"] = number
        records = [record for _, some in frames for record in some]
        return list(dict.fromkeys(name for record in records for name in record)), records, options

    def _tree(self, path: Path, *, head: bool = False) -> Any:
        if suffix_of(path) == ".json":
            try:
                return load_head(path) if head else load(path, MAX_LIST_BYTES)
            except KeypointError as error:
                if error.code != "E_KEYPOINTS_JSON":
                    raise  # lines of JSON may be called .json as well
        return load_lines(path, MAX_LIST_BYTES, head=head)


def _cell(value: Any) -> str:
    return "" if value is None else repr(value) if isinstance(value, int | float) else str(value)


def _clip(tree: Any) -> _Clip | None:
    """The frames of a clip; None where it is not clear that these are frames, and not people of one frame."""
    if isinstance(tree, list):
        some = [one for one in tree if isinstance(one, Mapping)]
        detected = any(_DETECTED & one.keys() and not _in_order(one, FRAMES) for one in some)
        return None if detected or len(tree) < 2 else _Clip(list(enumerate(tree)), {})
    if not isinstance(tree, Mapping) or not tree:
        return None
    values = list(tree.values())
    columns, data = tree.get("columns"), tree.get("data")
    if isinstance(columns, list) and isinstance(data, list) and all(isinstance(row, list) for row in data):
        rows = [dict(zip(map(str, columns), row, strict=False)) for row in data]
        index = tree.get("index")
        if isinstance(index, list) and len(index) == len(rows):
            rows = [{"index": number, **row} for number, row in zip(index, rows, strict=True)]
        return _Clip(list(enumerate(rows)), {})
    if all(map(_is_number, tree)) and len(tree) > 1:
        return _Clip(sorted(((int(key), tree[key]) for key in tree), key=itemgetter(0)), {})
    if all(isinstance(value, Mapping) and all(map(_is_number, value)) for value in values):
        numbers = sorted({int(number) for value in values for number in value})
        return _Clip([(n, {name: tree[name].get(str(n)) for name in tree}) for n in numbers], {})
    lists = len(values) > 1 and all(isinstance(value, list) and len(value) > 1 for value in values)
    if lists and len({len(value) for value in values}) == 1:
        rows = [dict(zip(tree, row, strict=True)) for row in zip(*values, strict=True)]
        return _Clip(list(enumerate(rows)), {})
    held = {key.casefold(): key for key in tree}
    for key in _FRAMES:
        inside = _clip(tree[held[key]]) if key in held else None
        if inside is not None:
            return replace(inside, said={**{k.casefold(): v for k, v in tree.items()}, **inside.said})
    return None


def _is_number(key: str) -> bool:
    """Whether a key is the number of a frame."""
    return key.isdecimal() and len(key) <= _MOST_DIGITS


def _in_order(frame: Mapping[str, Any], names: Collection[str]) -> bool:
    """Whether a frame or a row says which it is, by one of these names."""
    return any("".join(words_of(key)) in names for key in frame)


def _with_said(options: ReadOptions, said: Mapping[str, Any]) -> ReadOptions:
    """The options with the rate and the size of the picture that the file says; nonsense is as nothing."""
    rate = next((said[key] for key in _RATES if isinstance(said.get(key), int | float)), None)
    sides = tuple(said[key] for key in _SIDES if type(said.get(key)) is int)
    with suppress(ConfigError):
        options = replace(options, fps=options.fps or rate)
    with suppress(ConfigError):
        options = replace(options, frame_size=options.frame_size or (sides if len(sides) == 2 else None))
    return options


def _records(frame: Any, options: ReadOptions) -> Iterator[Record]:
    """A row for each person in a frame; one without coordinates where there is nobody."""
    common: Record = {}
    people: Any = [frame]
    if isinstance(frame, Mapping):
        held = {key.casefold(): key for key in frame}
        for key in _PEOPLE:
            if key in held and _are_people(frame[held[key]]):
                people = frame[held[key]]
                frame = {name: value for name, value in frame.items() if name != held[key]}
                _flatten(frame, "", common, options)
                break
    elif isinstance(frame, list) and _are_people(frame):
        people = frame
    for person in people or [None]:
        record = dict(common)
        _flatten(person, "", record, options)
        yield record


def _are_people(held: Any) -> bool:
    """Whether a list is one of people, each with joints, and not the joints of one person."""
    if not isinstance(held, list):
        return False
    if all(isinstance(one, Mapping) and "x" not in {key.casefold() for key in one} for one in held):
        return True
    return all(isinstance(one, list) and one and isinstance(one[0], list | Mapping) for one in held)


def _flatten(value: Any, name: str, out: Record, options: ReadOptions) -> None:
    """Put what is inside ``value`` into ``out``, by names that say the way to it."""
    if isinstance(value, Mapping):
        points = value.get("x"), value.get("y")
        if all(isinstance(one, list) for one in points):  # lists of x, of y and of scores
            held = {"x": "x", "y": "y", "z": "z"}
            held |= dict.fromkeys(("score", "confidence", "visible"), "score")
            lists = {part: value[key] for key, part in held.items() if isinstance(value.get(key), list)}
            joints = [dict(zip(lists, joint, strict=True)) for joint in zip(*lists.values(), strict=False)]
            _flatten(joints, name, out, options)
            value = {key: one for key, one in value.items() if held.get(key) not in lists}
        scored = next((key for key in SCORES if isinstance(value.get(key), list)), None)
        for key, one in value.items():
            if scored and key != scored and _fits(one, value[scored]):
                one = [_scored(*joint) for joint in zip(one, value[scored], strict=True)]
            elif key == scored:
                continue
            key = str(key).removesuffix("_2d")  # OpenPose's names
            _flatten(one, f"{name}_{key}" if name else key, out, options)
    elif isinstance(value, list):
        _flatten_list(value, name, out, options)
    else:
        out[name] = value


def _flatten_list(value: list[Any], name: str, out: Record, options: ReadOptions) -> None:
    if all(isinstance(one, int | float) or one is None for one in value):
        if name and len(value) in _VALUES:
            values = ("x", "y", "z") if _is_depth(value, options) else _VALUES[len(value)]
        elif len(value) in flat_widths(options):
            joints, width = flat_widths(options)[len(value)]
            some = [value[start : start + width] for start in range(0, len(value), width)]
            return _flatten_list(some, name, out, options) if joints > 1 else None
        else:
            values = tuple(map(str, range(len(value))))
        if options.axes == "yx" and values[:2] == ("x", "y"):
            values = ("y", "x", *values[2:])
        for part, one in zip(values, value, strict=True):
            out[f"{name}_{part}"] = one
        return None
    for number, one in enumerate(value):
        if isinstance(one, list) and len(one) == 3 and len(value) == _MEDIAPIPE:
            names = ("y", "x", "z") if options.axes == "yx" else ("x", "y", "z")
            one = dict(zip(names, one, strict=True))  # MediaPipe's landmarks without visibility
        own = one.get("name", one.get("part")) if isinstance(one, Mapping) else None
        _flatten(one, f"{name}_{own or number}" if name else str(own or number), out, options)
    return None


def _is_depth(joint: list[Any], options: ReadOptions) -> bool:
    """Whether the third of three values is no score, by what the user says of the unit."""
    return len(joint) == 3 and options.unit == "metres"


def _scored(joint: list[Any], score: Any) -> list[Any]:
    """A joint with its score, which may stand in it already; another third value is its depth."""
    return [*joint[:2], score] if joint[2:] in ([], [score]) else [*joint, score]


def _fits(points: Any, scores: list[Any]) -> bool:
    """Whether ``scores`` belong to the joints ``points``."""
    return (
        isinstance(points, list)
        and len(points) == len(scores)
        and all(isinstance(joint, list) and len(joint) in (2, 3) for joint in points)
    )
