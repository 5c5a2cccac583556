"""Recognises what a network of unknown origin gives, by the shapes of its outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gesture_core.errors import ModelError
from gesture_core.pose.contracts import ModelContract

Shape = Sequence[int | None]


@dataclass(frozen=True)
class Tensor:
    """Declared name, element type (NumPy's word for it) and shape of an input or output; None = free."""

    name: str
    dtype: str
    shape: tuple[int | None, ...]


# Channels of an OpenPose-style output: joints, one background map, two field maps for each limb.
_MAPS: dict[int, str] = {
    57: "coco18", 19: "coco18", 18: "coco18",
    78: "body25", 26: "body25", 25: "body25",
    44: "mpi15", 16: "mpi15", 15: "mpi15",
}  # fmt: skip
_FIELDS = {38: "coco18", 52: "body25", 28: "mpi15"}

_KNOWN_FORMS = (
    "heat maps with 57, 19 or 18 (COCO), 78, 26 or 25 (BODY_25) or 44, 16 or 15 (MPI) channels, "
    "(1, 1, 17, 3) as MoveNet, a SimCC pair (N, 17, W) and (N, 17, H), or (N, 56, M) as YOLO-pose"
)


def infer_contract(inputs: Sequence[Tensor], outputs: Sequence[Shape], subject: str = "") -> ModelContract:
    """The contract of a network from its declared input and its output shapes.

    Colour, mean and scale cannot be seen in a file: they are those of the best-known network of each
    layout. `gesture models add --contract` overrides them.

    Raises
    ------
    ModelError
        ``E_MODEL_LAYOUT`` where the outputs fit no known form; the message shows them.
    """
    if len(inputs) != 1:
        raise ModelError(
            f"the network has {len(inputs)} inputs, expected one picture",
            subject=subject,
            code="E_MODEL_INPUT",
        )
    image = inputs[0]
    channels_first, size = _picture(image, subject)
    shapes = [tuple(shape) for shape in outputs]
    contract = _by_outputs(shapes, size)
    if contract is not None:
        if image.dtype != "float32":  # whole pixels: the network scales them itself
            contract = replace(contract, mean=(0.0, 0.0, 0.0), scale=(1.0, 1.0, 1.0))
        return replace(
            contract,
            dtype=image.dtype,
            channels_first=channels_first,
            input_size=size,
            batch=image.shape[0] or None,
        )
    raise ModelError(
        f"outputs of shape {', '.join(map(_words, shapes)) or '(none)'} are of no known layout",
        subject=subject,
        remedy=f"a network that gives {_KNOWN_FORMS}",
        code="E_MODEL_LAYOUT",
    )


def _by_outputs(shapes: Sequence[Shape], size: tuple[int, int] | None) -> ModelContract | None:
    """What the outputs alone say."""
    if len(shapes) == 1 and tuple(shapes[0][1:]) == (1, 17, 3):
        return ModelContract("movenet", "coco17", "rgb", pad=0, multiple=32, default_size=256, follow=True)
    if len(shapes) == 2 and all(len(shape) == 3 and shape[1] == 17 for shape in shapes):
        scale = (1 / 58.395, 1 / 57.12, 1 / 57.375)
        mean = (123.675, 116.28, 103.53)
        return ModelContract("simcc", "coco17", "rgb", mean, scale, pad=0, follow=True)
    if len(shapes) == 1 and len(shapes[0]) == 3 and 56 in shapes[0][1:]:
        scale = (1 / 255, 1 / 255, 1 / 255)
        return ModelContract(
            "yolo-pose", "coco17", "rgb", scale=scale, pad=114, multiple=32, default_size=480
        )
    maps = [shape for shape in shapes if len(shape) == 4 and shape[1] in _MAPS]
    if not maps:
        return None
    cells = maps[-1][2]
    stride = round(size[0] / cells) if size and cells else 8
    small = size is not None and max(size) <= 256
    kind = _MAPS[maps[-1][1] or 0]
    return ModelContract("openpose", kind, stride=stride, multiple=max(stride, 8), follow=small)


def _picture(image: Tensor, subject: str) -> tuple[bool, tuple[int, int] | None]:
    """Whether channels come first, and the fixed (height, width) if there is one."""
    shape = image.shape
    if len(shape) == 4 and shape[1] == 3:
        first, high, wide = True, shape[2], shape[3]
    elif len(shape) == 4 and shape[3] == 3:
        first, high, wide = False, shape[1], shape[2]
    else:
        raise ModelError(
            f"input {image.name!r} has shape {_words(shape)}, expected (N, 3, H, W) or (N, H, W, 3)",
            subject=subject,
            code="E_MODEL_INPUT",
        )
    return first, (high, wide) if high and wide else None


def _words(shape: Shape) -> str:
    return f"({', '.join('?' if n is None else str(n) for n in shape)})"


def split_openpose(shapes: Sequence[Shape], skeleton: str) -> tuple[int, int | None]:
    """Index of the output that holds the heat maps, and of the one with the fields if separate.

    Networks that refine in stages give one pair for each stage; the last one is the best.
    """
    maps = [i for i, s in enumerate(shapes) if len(s) == 4 and _MAPS.get(s[1] or 0) == skeleton]
    pafs = [i for i, s in enumerate(shapes) if len(s) == 4 and _FIELDS.get(s[1] or 0) == skeleton]
    if not maps:
        raise ModelError(
            f"outputs of shape {', '.join(map(_words, shapes))} hold no heat maps of {skeleton}",
            code="E_MODEL_LAYOUT",
        )
    return maps[-1], pafs[-1] if pafs else None
