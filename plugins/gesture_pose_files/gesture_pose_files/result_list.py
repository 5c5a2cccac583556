"""Result lists: one JSON file for a whole clip, as AlphaPose, COCO's tools and MMPose write it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.clip import Clip
from gesture_pose_files.files import MAX_FRAMES, MAX_LIST_BYTES, suffix_of
from gesture_pose_files.json_people import Found, is_frame, people_in
from gesture_pose_files.json_text import described, kind_of, load
from gesture_pose_files.named import order_of
from gesture_pose_files.numbering import number_in
from gesture_pose_files.reader import Reader, clip_called
from gesture_pose_files.whole_body import BODY_OF

KNOWN = (
    "list of 'image_id' and 'keypoints' (AlphaPose, COCO) or of 'frame_id' and 'instances' (MMPose), "
    "object of image names (AlphaPose), or COCO annotations"
)


class ResultListReader(Reader):
    """Reads lists of detected people, grouped by image or frame.

    - AlphaPose: its own list, and the forms ``open`` and ``cmu``, objects of image names.
    - COCO: result lists, and annotations with ``images``, whose file names and sizes are used.
    - MMPose: ``predictions`` of a video, with or without ``meta_info``.

    Images are put in the order of the last number in their names; what comes before it tells clips apart.
    These formats leave out images without people: numbers that are missing count as such. A frame's time is
    its number over the rate. People are told apart by ``idx`` or ``track_id`` where everybody has one, by
    place otherwise.
    """

    def accepts(self, path: Path) -> bool:
        """Whether a ``.json`` file begins like one of the known lists."""
        return suffix_of(path) == ".json" and kind_of(path) == "list"

    def refusal(self, path: Path) -> str:
        """What the file begins with, and what is known; nothing where it is a frame."""
        return "" if kind_of(path) == "frame" else f"{described(path)}, and no {KNOWN}"

    def members(self, path: Path) -> list[str]:
        """Names of the clips in the list; ``[""]`` where there is only one."""
        names = list(_clips(load(path, MAX_LIST_BYTES), printable(path)))
        return names if len(names) > 1 else [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The people of one clip; nobody where the list is empty.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_JSON`, `E_KEYPOINTS_MEMBER`, `E_KEYPOINTS_LIMIT`, and those
            of `clip.Clip`.
        """
        tree = load(path, MAX_LIST_BYTES)
        found = _clips(tree, printable(path))
        if not found and not member:
            return []
        images = clip_called(member, found, path)
        source = printable(path) + (f"::{member}" if member else "")
        options = _with_order(tree, self.options)
        clip = Clip(source, "result-list")
        for image in sorted(images.values(), key=lambda image: image.number):
            clip.add(image.number, image.found(source, options))
        clip.fill()
        sizes = {image.size for image in images.values()}
        size = next(iter(sizes)) if len(sizes) == 1 else None
        return clip.sequences(options, self.people, size)


@dataclass
class _Image:
    """One image of a list, by the name or number that the list gives it."""

    name: str
    number: int
    size: tuple[int, int] | None = None
    people: list[Any] = field(default_factory=list)

    def found(self, source: str, options: ReadOptions) -> Found | KeypointError:
        try:
            return people_in(self.people, f"{source}: image {self.name}", options)
        except KeypointError as error:
            return error


def _clips(tree: object, source: str) -> dict[str, dict[str, _Image]]:
    """Name of the clip -> name of the image -> the image; in the order of the file."""
    clips: dict[str, dict[str, _Image]] = {}
    for count, (name, size, people) in enumerate(_images(tree, source)):
        numbered = ("", name) if isinstance(name, int) else number_in(name)
        if numbered is None:
            raise KeypointError(
                f"image {name!r} has no number that would tell its place in a clip",
                subject=source,
                remedy="images named after their frame, such as wave_0001.jpg",
                code="E_KEYPOINTS_FORMAT",
            )
        if count >= MAX_FRAMES:
            raise KeypointError(
                f"holds more than {MAX_FRAMES} entries", subject=source, code="E_KEYPOINTS_LIMIT"
            )
        clip = clips.setdefault(numbered[0], {})
        clip.setdefault(str(name), _Image(str(name), numbered[1], size)).people.extend(people)
    return clips


def _with_order(tree: object, options: ReadOptions) -> ReadOptions:
    """The options with the joints that MMPose or COCO's categories name, unless they name them otherwise.

    Orders that are known by their number are left to it; so are names that tell no neck or shoulders.
    """
    names: object = None
    if isinstance(tree, Mapping) and isinstance(tree.get("meta_info"), Mapping):
        names = tree["meta_info"].get("keypoint_id2name")
        if isinstance(names, Mapping):
            numbered = {str(number): name for number, name in names.items()}
            names = [numbered.get(str(index)) for index in range(len(numbered))]
    elif isinstance(tree, Mapping) and isinstance(tree.get("categories"), list) and tree["categories"]:
        first = tree["categories"][0]
        names = first.get("keypoints") if isinstance(first, Mapping) else None
    if options.order or not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return options
    return options if len(names) in BODY_OF else replace(options, order=order_of(names))


_Entry = tuple[int | str, tuple[int, int] | None, list[Any]]


def _images(tree: object, source: str) -> Iterator[_Entry]:
    """Name or number of each image, its size, and people in it; an image may come several times."""
    if isinstance(tree, Mapping) and isinstance(tree.get("instance_info"), list):
        tree = tree["instance_info"]
    if isinstance(tree, Mapping) and isinstance(tree.get("annotations"), list):
        yield from _coco(tree, source)
        return
    if isinstance(tree, Mapping) and tree and all(is_frame(frame) for frame in tree.values()):
        for name, frame in tree.items():
            people = next(frame[key] for key in ("people", "bodies") if key in frame)
            yield name, None, people if isinstance(people, list) else [people]
        return
    if not isinstance(tree, list) or not all(isinstance(entry, Mapping) for entry in tree):
        raise _unknown(source)
    for entry in tree:
        if "instances" in entry and "frame_id" in entry:
            people = entry["instances"]
            yield _name(entry["frame_id"], source), None, people if isinstance(people, list) else [people]
        elif "image_id" in entry:
            yield _name(entry["image_id"], source), None, [entry]
        else:
            raise _unknown(source)


def _coco(tree: Mapping[str, Any], source: str) -> Iterator[_Entry]:
    images = {}
    for image in tree.get("images") or []:
        if not isinstance(image, Mapping) or not isinstance(image.get("id"), int | str):
            raise _unknown(source)
        images[image["id"]] = _name(image.get("file_name", image["id"]), source), _size(image)
    for name, size in images.values():  # also those without people
        yield name, size, []
    for entry in tree["annotations"]:
        if not isinstance(entry, Mapping) or "image_id" not in entry:
            raise _unknown(source)
        name, size = images.get(_name(entry["image_id"], source), (entry["image_id"], None))
        yield name, size, [entry] if "keypoints" in entry else []


def _name(name: object, source: str) -> int | str:
    if isinstance(name, str) or (type(name) is int and 0 <= name < 10**18):
        return name
    raise KeypointError(
        f"an image is called {str(name)[:40]!r}, expected a name or a number",
        subject=source,
        code="E_KEYPOINTS_FORMAT",
    )


def _size(image: Mapping[str, Any]) -> tuple[int, int] | None:
    """Width and height that an annotation file tells, None where no picture can have them."""
    width, height = image.get("width"), image.get("height")
    if type(width) is int and type(height) is int and 0 < width < 1 << 20 and 0 < height < 1 << 20:
        return width, height
    return None


def _unknown(source: str) -> KeypointError:
    return KeypointError(
        "is no known list of people", subject=source, remedy=f"a {KNOWN}", code="E_KEYPOINTS_FORMAT"
    )
