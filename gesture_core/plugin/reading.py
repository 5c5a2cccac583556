"""What keypoint files leave open, said once for all keypoint readers: the settings ``keypoints.…``."""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from gesture_core.errors import ConfigError
from gesture_core.joints import PARTS
from gesture_core.skeletons import SKELETONS, Skeleton, skeleton_of

__all__ = ["Axes", "ReadOptions", "Unit"]

Axes = Literal["xy", "yx", "x-y"]
Unit = Literal["pixels", "shares", "metres"]
_CHOICES = {"axes": ("xy", "yx", "x-y"), "unit": ("pixels", "shares", "metres")}
_FPS, _FRAME_SIZE = 30.0, (640, 480)
_MOST_PIXELS = 1 << 20


@dataclass(frozen=True)
class ReadOptions:
    """What a keypoint file means where it does not say so itself; None where the reader is to judge.

    What a file says itself counts, whatever stands here. A reader that takes the parameter ``options`` is
    given these; what it has to assume because they leave it open is named by `assumed`.

    Attributes
    ----------
    axes : None, "xy", "yx" or "x-y"
        Order of the two coordinates of a joint: x first, y first, or x first with a y that points up.
    unit : None, "pixels", "shares" or "metres"
        Of the coordinates: pixels, shares of the picture's width and height, or metres (or any other unit
        that is the same in x and y), in which a third coordinate is a depth and no score.
    frame_size : None or (width, height)
        Of the picture that shares are of, in pixels, as 1920x1080; only the ratio of the two changes a
        gesture. 640x480 where it is left open.
    order : tuple of str
        The joints in the order of the file: the name of a known skeleton, the name of each joint, or a TOML
        file that has them (`order_of_file`). By the number of joints where it is empty.
    fps : None or float
        Frames per second of files without times; 30 where it is left open.
    depth : bool
        Keep the third coordinate; a file without one is refused. Of the networks `blazepose` gives one.
    parts : tuple of str
        What is kept of a person beside the body: ``body``, ``hands``, ``face``. Hands and faces are then
        looked for in videos, too, by networks of their own.

    Examples
    --------
    >>> options = ReadOptions(axes="yx", fps=25.0)
    >>> options.assumed(order="coco17", axes="yx", unit="pixels", fps=options.rate)
    'order=coco17, unit=pixels'
    """

    axes: Axes | None = None
    unit: Unit | None = None
    frame_size: tuple[int, ...] | None = None
    order: tuple[str, ...] = ()
    fps: float | None = None
    depth: bool = False
    parts: tuple[str, ...] = ("body",)

    def __post_init__(self) -> None:
        for name, known in _CHOICES.items():
            if vars(self)[name] not in (None, *known):
                raise _refused(name, vars(self)[name], " or ".join(known))
        if self.fps is not None and not (isinstance(self.fps, float | int) and 0.001 <= self.fps <= 100_000):
            raise _refused("fps", self.fps, "0.001 to 100000 frames a second")
        if self.frame_size is not None:
            sides = tuple(self.frame_size)
            whole = all(type(side) is int and 0 < side < _MOST_PIXELS for side in sides)
            if len(sides) != 2 or not whole:
                raise _refused("frame_size", self.frame_size, "width and height in pixels, as 1920x1080")
            object.__setattr__(self, "frame_size", sides)
        order = tuple(self.order)
        if len(order) == 1 and order[0].lower().endswith(".toml"):
            order = order_of_file(Path(order[0]))
        object.__setattr__(self, "order", order)
        object.__setattr__(self, "parts", tuple(self.parts))
        if not {"body"} <= {*self.parts} <= {*PARTS}:
            raise _refused(
                "parts", ",".join(self.parts), f"body, and what else is wanted of {', '.join(PARTS)}"
            )
        if self.order:
            _ = self.skeleton

    @property
    def rate(self) -> float:
        """Frames per second, also where they are left open."""
        return _FPS if self.fps is None else float(self.fps)

    @property
    def picture(self) -> tuple[int, int]:
        """Width and height of the picture, also where they are left open."""
        width, height = self.frame_size or _FRAME_SIZE
        return width, height

    @property
    def whole(self) -> bool:
        """Whether more than the body is wanted."""
        return len(set(self.parts)) > 1

    @property
    def skeleton(self) -> Skeleton | None:
        """The joints of ``order``; None where it is empty."""
        if not self.order:
            return None
        if len(self.order) == 1:
            if self.order[0] not in SKELETONS:
                known = f"one of {', '.join(SKELETONS)}, or the name of each joint"
                raise _refused("order", self.order[0], known)
            return SKELETONS[self.order[0]]
        from gesture_core.joint_names import joint_named

        stated = [name for name in self.order if "=" not in name]
        names = [joint_named(name) or name for name in stated]
        if twice := [name for name in names if names.count(name) > 1]:
            raise _refused("order", ",".join(self.order), f"each joint once; {twice[0]} is there twice")
        found = skeleton_of(names)
        own = [name.replace("+", "=").split("=") for name in self.order if "=" in name]
        if own:
            found = replace(found, derived={**found.derived, **{name: (one, two) for name, one, two in own}})
        if not (found.has_neck or (self.whole and found.has_hands)):
            raise _refused("order", ",".join(self.order), "neck, or both shoulders, among the joints")
        return found

    def assumed(
        self,
        *,
        order: str = "",
        axes: str = "",
        unit: str = "",
        frame_size: tuple[int, int] | None = None,
        fps: float = math.nan,
    ) -> str:
        """What a reader took for granted, for ``PoseSequence.provenance["assumed"]``: empty where nothing.

        Give what the file does not say and how it was read; what these options state is left out.
        """
        said = {
            "order": order if not self.order else "",
            "axes": axes if self.axes is None else "",
            "unit": unit if self.unit is None else "",
            "frame_size": f"{frame_size[0]}x{frame_size[1]}" if frame_size and not self.frame_size else "",
            "fps": f"{fps:g}" if self.fps is None and not math.isnan(fps) else "",
        }
        return ", ".join(f"{name}={value}" for name, value in said.items() if value)


def order_of_file(path: Path) -> tuple[str, ...]:
    """A skeleton in a TOML file, as ``keypoints.order``.

    ``joints`` are the names in the order of the file; a table ``names`` may say which of ours they are
    (``Handgelenk_L = "left_wrist"``), and a table ``derived`` which of ours lie in the middle between two
    (``neck = ["left_shoulder", "right_shoulder"]``): these follow as ``neck=left_shoulder+right_shoulder``.

    Raises
    ------
    ConfigError
        `E_OPTION` where it cannot be read, or is of another form.
    """
    try:
        tree = tomllib.loads(path.expanduser().read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise _refused("order", str(path), f"a TOML file that can be read: {error}") from None
    joints, names, derived = tree.get("joints"), tree.get("names", {}), tree.get("derived", {})
    tables = isinstance(names, dict) and isinstance(derived, dict)
    pairs = list(derived.values()) if tables else []
    words = [joints, *pairs, list(names.values()) if tables else None]
    plain = all(isinstance(one, list) and all(isinstance(word, str) for word in one) for one in words)
    if not plain or not joints or {*tree} - {"joints", "names", "derived"}:
        raise _refused("order", str(path), "joints = [names], and perhaps tables [names] and [derived]")
    order = [names.get(joint, joint) for joint in joints]
    if lost := sorted({*names} - {*joints}) + [
        parent for pair in pairs for parent in pair if len(pair) != 2 or parent not in order
    ]:
        raise _refused("order", str(path), f"{lost[0]!r} among its joints, two of which derive another")
    if odd := next((joint for joint in [*order, *derived] if not re.fullmatch(r"[\w .-]+", joint)), None):
        raise _refused("order", str(path), f"letters and digits in {odd!r}")
    return (*order, *(f"{name}={one}+{two}" for name, (one, two) in derived.items()))


def _refused(name: str, value: object, wanted: str) -> ConfigError:
    return ConfigError(f"keypoints.{name} = {value!r}", remedy=wanted, code="E_OPTION")
