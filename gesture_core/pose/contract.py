"""What a pose network expects and what it gives: the facts that no model file states by itself.

The numbers of a contract come from the publisher of a network (`known_models.toml`), or are read off the
shapes of its inputs and outputs (`infer_contract`). All that lies between a frame and its keypoints
follows from them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from operator import attrgetter
from typing import Any

from gesture_core.errors import ModelError
from gesture_core.skeletons import FACE20, SKELETONS

LAYOUTS = ("openpose", "movenet", "simcc", "yolo-pose", "blazepose", "blazehand", "blazeface")
"""Forms of output that there are decoders for (`gesture_core.pose.decode`)."""

_JOINTS = {
    "movenet": "coco17",
    "yolo-pose": "coco17",
    "blazepose": "blazepose33",
    "blazehand": "right_hand21",
    "blazeface": "face20",
}
"""Skeletons of layouts that have only one."""
BLAZEPOSE = 39 * 5
"""Values of BlazePose's landmarks: 33 of the body and 6 more, each x, y, z, visibility and presence."""

Shape = Sequence[int | None]


@dataclass(frozen=True)
class Tensor:
    """Declared name, element type (NumPy's word for it) and shape of an input or output; None = free."""

    name: str
    dtype: str
    shape: tuple[int | None, ...]


@dataclass(frozen=True)
class ModelContract:
    """Input and output of one pose network.

    Attributes
    ----------
    layout : str
        One of `LAYOUTS`.
    skeleton : str
        A key of `gesture_core.skeletons.SKELETONS`: the joints, in the order of the output.
    colour : str
        ``bgr`` or ``rgb``.
    mean, scale : three floats each
        The network is fed ``(pixel - mean) * scale``, pixel in 0..255, in the order of `colour`; only
        with ``float32``.
    pad : int
        Grey level of the border that letterboxing adds.
    dtype : str
        ``float32``, ``uint8`` or ``int32``.
    channels_first : bool
        (N, 3, H, W) rather than (N, H, W, 3).
    input_size : (height, width) or None
        Pixels where the network takes one size only; None where it takes any multiple of `multiple`.
    multiple : int
        Of the height and the width of a free input.
    default_size : int
        Height in pixels of a free input unless the user sets one.
    stride : int
        Input pixels for each cell of a heat map.
    batch : int or None
        Pictures in one run where the file fixes it.
    follow : bool
        Whether a crop that follows the person pays: small inputs, single-person networks.
    crop : float
        Side of that crop over the reach of the body (raised hand to foot), as suits the network best.
    score : float
        Confidence below which a joint is missing, unless the user sets another.
    steady : bool
        Whether limbs are better chosen for all frames together, unless the user says otherwise.
    presence : three floats, or empty
        Of a network that does not say itself whether anybody is there: the weights of a logistic regression
        on 1, the confidence in the upper body (`gesture_core.pose.follow.Anatomy`), and the share of the
        joints that are found. Empty: the network says so, or everything that it finds counts.
    licence, attribution : str
        Of the weights.

    Raises
    ------
    ModelError
        ``E_MODEL_CONTRACT`` for a value that no network can have.
    """

    layout: str
    skeleton: str = "coco18"
    colour: str = "bgr"
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    pad: int = 128
    dtype: str = "float32"
    channels_first: bool = True
    input_size: tuple[int, int] | None = None
    multiple: int = 8
    default_size: int = 368
    stride: int = 8
    batch: int | None = None
    follow: bool = False
    crop: float = 1.1
    score: float = 0.1
    steady: bool = True
    presence: tuple[float, ...] = ()
    licence: str = ""
    attribution: str = ""

    def __post_init__(self) -> None:
        for name, value, choices in (
            ("layout", self.layout, LAYOUTS),
            ("skeleton", self.skeleton, (*SKELETONS, FACE20.name)),
            ("colour", self.colour, ("bgr", "rgb")),
            ("dtype", self.dtype, ("float32", "uint8", "int32")),
            ("channels_first", self.channels_first, (True, False)),
            ("follow", self.follow, (True, False)),
            ("steady", self.steady, (True, False)),
        ):
            if value not in choices:
                raise ModelError(
                    f"{name} {value!r} of a contract is unknown",
                    remedy=f"one of {', '.join(map(str, choices))}",
                    code="E_MODEL_CONTRACT",
                )
        _numbers("mean", self.mean, float, -1e9, 1e9, 3)
        _numbers("scale", self.scale, float, -1e9, 1e9, 3)
        object.__setattr__(self, "mean", tuple(map(float, self.mean)))
        object.__setattr__(self, "scale", tuple(map(float, self.scale)))
        if self.input_size is not None:
            _numbers("input_size", self.input_size, int, 1, 4096, 2)
            object.__setattr__(self, "input_size", tuple(self.input_size))
        if len(self.presence):
            _numbers("presence", self.presence, float, -1e3, 1e3, 3)
        object.__setattr__(self, "presence", tuple(map(float, self.presence)))
        _numbers("pad", [self.pad], int, 0, 255)
        _numbers("multiple", [self.multiple], int, 1, 4096)
        _numbers("default_size", [self.default_size], int, 1, 4096)
        _numbers("stride", [self.stride], int, 1, 4096)
        _numbers("batch", [1 if self.batch is None else self.batch], int, 1, 4096)
        _numbers("crop", [self.crop], float, 0.5, 4)
        _numbers("score", [self.score], float, 0, 1)
        joints = _JOINTS.get(self.layout, self.skeleton)
        if self.skeleton != joints:
            raise ModelError(f"layout {self.layout} has the skeleton {joints}", code="E_MODEL_CONTRACT")
        if self.dtype != "float32" and (any(self.mean) or self.scale != (1.0, 1.0, 1.0)):
            raise ModelError(
                f"an input of {self.dtype} holds whole pixels, so that mean and scale do not apply",
                code="E_MODEL_CONTRACT",
            )

    def as_table(self) -> dict[str, Any]:
        """What `from_table` takes, of the types that JSON gives back."""
        return dict(json.loads(json.dumps(asdict(self))))

    @classmethod
    def from_table(cls, table: Mapping[str, Any], subject: str = "") -> ModelContract:
        """A contract from a TOML or JSON table; unknown keys are an error, not ignored."""
        known = [*map(attrgetter("name"), fields(cls))]
        unknown = sorted(set(table) - set(known))
        if unknown:
            raise ModelError(
                f"a contract has no {', '.join(unknown)}",
                subject=subject,
                remedy=f"one of {', '.join(sorted(known))}",
                code="E_MODEL_CONTRACT",
            )
        try:
            return cls(**table)
        except TypeError as error:
            raise ModelError(f"not a contract: {error}", subject=subject, code="E_MODEL_CONTRACT") from error


def _numbers(name: str, values: object, kind: type, low: float, high: float, count: int = 1) -> None:
    """Refuse what is not `count` numbers of a kind in ``low..high``; NaN lies nowhere."""
    listed = values if isinstance(values, list | tuple) else ()
    if len(listed) != count or not all(type(n) in (int, kind) and low <= n <= high for n in listed):
        shown = f"{name} {listed[0]!r}" if len(listed) == 1 else f"{name} {values!r}"
        raise ModelError(
            f"{shown} of a contract is not {count} {'whole ' if kind is int else ''}number"
            f"{'s' if count > 1 else ''} in {low:g}..{high:g}",
            code="E_MODEL_CONTRACT",
        )


# Channels of an OpenPose-style output: joints, one background map, two field maps for each limb.
_MAPS: dict[int, str] = {
    57: "coco18", 19: "coco18", 18: "coco18",
    78: "body25", 26: "body25", 25: "body25",
    44: "mpi15", 16: "mpi15", 15: "mpi15",
}  # fmt: skip
FIELDS = {38: "coco18", 52: "body25", 28: "mpi15"}


def infer_contract(inputs: Sequence[Tensor], outputs: Sequence[Shape], subject: str = "") -> ModelContract:
    """The contract of a network from its declared input and its output shapes.

    Colour, mean and scale cannot be seen in a file: they are those of the best-known network of each
    layout. `gesture models add --contract` overrides them.

    Raises
    ------
    ModelError
        ``E_MODEL_INPUT`` where the network takes anything but one picture, ``E_MODEL_LAYOUT`` where the
        outputs fit no known form; the messages show the shapes.
    """
    if len(inputs) != 1:
        raise ModelError(
            f"the network has {len(inputs)} inputs, expected one picture",
            subject=subject,
            code="E_MODEL_INPUT",
        )
    image = inputs[0]
    if len(image.shape) != 4 or 3 not in (image.shape[1], image.shape[3]):
        raise ModelError(
            f"input {image.name!r} has shape {_shown([image.shape])}, expected (N, 3, H, W) or (N, H, W, 3)",
            subject=subject,
            code="E_MODEL_INPUT",
        )
    channels_first = image.shape[1] == 3
    high, wide = image.shape[2:] if channels_first else image.shape[1:3]
    size = (high, wide) if high and wide else None
    maps = [shape for shape in outputs if len(shape) == 4 and shape[1] in _MAPS]
    if len(outputs) == 1 and tuple(outputs[0][1:]) == (1, 17, 3):
        found = ModelContract("movenet", "coco17", "rgb", pad=0, multiple=32, default_size=256, follow=True)
    elif len(outputs) == 2 and all(len(shape) == 3 and shape[1] == 17 for shape in outputs):
        scale = (1 / 58.395, 1 / 57.12, 1 / 57.375)
        mean = (123.675, 116.28, 103.53)
        found = ModelContract("simcc", "coco17", "rgb", mean, scale, pad=0, follow=True)
    elif len(outputs) == 1 and len(outputs[0]) == 3 and 56 in outputs[0][1:]:
        scale = (1 / 255, 1 / 255, 1 / 255)
        found = ModelContract(
            "yolo-pose", "coco17", "rgb", scale=scale, pad=114, multiple=32, default_size=480
        )
    elif any(tuple(shape[1:]) == (BLAZEPOSE,) for shape in outputs) and any(
        shape[1:] and all(length == 1 for length in shape[1:]) for shape in outputs
    ):
        scale = (1 / 255, 1 / 255, 1 / 255)
        found = ModelContract(
            "blazepose", "blazepose33", "rgb", scale=scale, pad=0, follow=True, score=0, steady=False, batch=1
        )
    elif maps:
        cells = maps[-1][2]
        stride = round(size[0] / cells) if size and cells else 8
        small = size is not None and max(size) <= 256
        kind = _MAPS[maps[-1][1] or 0]
        found = ModelContract("openpose", kind, stride=stride, multiple=max(stride, 8), follow=small)
    else:
        raise ModelError(
            f"outputs of shape {_shown(outputs)} are of no known layout",
            subject=subject,
            remedy="a network that gives heat maps with 57, 19 or 18 (COCO), 78, 26 or 25 (BODY_25) or 44, "
            "16 or 15 (MPI) channels, (1, 1, 17, 3) as MoveNet, a SimCC pair (N, 17, W) and (N, 17, H), "
            "(N, 56, M) as YOLO-pose, or (1, 195) and a presence (1, 1) as BlazePose",
            code="E_MODEL_LAYOUT",
        )
    if image.dtype != "float32":  # whole pixels: the network scales them itself
        found = replace(found, mean=(0.0, 0.0, 0.0), scale=(1.0, 1.0, 1.0))
    batch = image.shape[0] or None
    return replace(found, dtype=image.dtype, channels_first=channels_first, input_size=size, batch=batch)


def split_openpose(shapes: Sequence[Shape], skeleton: str) -> tuple[int, int | None]:
    """Index of the output that holds the heat maps, and of the one with the fields if separate.

    Networks that refine in stages give one pair for each stage; the last one is the best.

    Raises
    ------
    ModelError
        ``E_MODEL_LAYOUT`` where none holds heat maps of the skeleton.
    """
    maps = fields_at = None
    for index, shape in enumerate(shapes):
        if len(shape) == 4 and _MAPS.get(shape[1] or 0) == skeleton:
            maps = index
        elif len(shape) == 4 and FIELDS.get(shape[1] or 0) == skeleton:
            fields_at = index
    if maps is None:
        raise ModelError(
            f"outputs of shape {_shown(shapes)} hold no heat maps of {skeleton}", code="E_MODEL_LAYOUT"
        )
    return maps, fields_at


def _shown(shapes: Sequence[Shape]) -> str:
    each = (f"({', '.join('?' if n is None else str(n) for n in shape)})" for shape in shapes)
    return ", ".join(each) or "(none)"
