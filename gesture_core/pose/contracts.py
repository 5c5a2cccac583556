"""What a pose network expects and what it gives: the facts that no model file states by itself.

The numbers of a contract come from the publisher of a network (`known_models.toml`) or are read off
the file (`gesture_core.pose.layouts`). Everything between a frame and its keypoints follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from gesture_core.errors import ModelError
from gesture_core.skeletons import SKELETONS

LAYOUTS = ("openpose", "movenet", "simcc", "yolo-pose")
"""Forms of output that there are decoders for (`gesture_core.pose.decode`)."""


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
    licence, attribution : str
        Of the weights.
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
    licence: str = ""
    attribution: str = ""

    def __post_init__(self) -> None:
        _one_of("layout", self.layout, LAYOUTS)
        _one_of("skeleton", self.skeleton, tuple(SKELETONS))
        _one_of("colour", self.colour, ("bgr", "rgb"))
        _one_of("dtype", self.dtype, ("float32", "uint8", "int32"))
        for name in ("mean", "scale"):
            object.__setattr__(self, name, _numbers(name, getattr(self, name), 3, float))
        if self.input_size is not None:
            object.__setattr__(self, "input_size", _numbers("input_size", self.input_size, 2, int))
        _within("pad", self.pad, 0, 255)
        for name, size in {
            "multiple": self.multiple,
            "default_size": self.default_size,
            "stride": self.stride,
            "batch": 1 if self.batch is None else self.batch,
        }.items():
            _within(name, size, 1, 4096)
        for side in self.input_size or ():
            _within("input_size", side, 1, 4096)
        for name, low, high in (("crop", 0.5, 4), ("score", 0, 1)):
            share = getattr(self, name)
            if type(share) not in (int, float) or not low <= share <= high:
                raise ModelError(
                    f"{name} {share!r} of a contract is not in {low}..{high}", code="E_MODEL_CONTRACT"
                )
        if self.layout in ("movenet", "yolo-pose") and self.skeleton != "coco17":
            raise ModelError(f"layout {self.layout} has the skeleton coco17", code="E_MODEL_CONTRACT")
        if self.dtype != "float32" and (any(self.mean) or self.scale != (1.0, 1.0, 1.0)):
            raise ModelError(
                f"an input of {self.dtype} holds whole pixels, so that mean and scale do not apply",
                code="E_MODEL_CONTRACT",
            )
        for name in ("channels_first", "follow"):
            _one_of(name, getattr(self, name), (True, False))

    def as_table(self) -> dict[str, Any]:
        """What `from_table` takes, of the types that JSON gives back."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(self).items()}

    @classmethod
    def from_table(cls, table: Mapping[str, Any], subject: str = "") -> ModelContract:
        """A contract from a TOML or JSON table; unknown keys are an error, not ignored."""
        known = {field.name for field in fields(cls)}
        strange = sorted(set(table) - known)
        if strange:
            raise ModelError(
                f"a contract has no {', '.join(strange)}",
                subject=subject,
                remedy=f"one of {', '.join(sorted(known))}",
                code="E_MODEL_CONTRACT",
            )
        try:
            return cls(**table)
        except TypeError as error:
            raise ModelError(f"not a contract: {error}", subject=subject, code="E_MODEL_CONTRACT") from error


def _one_of(name: str, value: object, choices: tuple[object, ...]) -> None:
    if value not in choices:
        raise ModelError(
            f"{name} {value!r} of a contract is unknown",
            remedy=f"one of {', '.join(map(str, choices))}",
            code="E_MODEL_CONTRACT",
        )


def _within(name: str, value: object, low: int, high: int) -> None:
    if type(value) is not int or not low <= value <= high:
        raise ModelError(
            f"{name} {value!r} of a contract is no whole number in {low}..{high}", code="E_MODEL_CONTRACT"
        )


def _numbers(name: str, value: object, count: int, kind: type) -> tuple[Any, ...]:
    numbers = tuple(value) if isinstance(value, list | tuple) else ()
    if len(numbers) != count or not all(type(n) in (int, kind) and math.isfinite(n) for n in numbers):
        raise ModelError(f"{name} {value!r} of a contract is not {count} numbers", code="E_MODEL_CONTRACT")
    return tuple(kind(n) for n in numbers)
