"""From frames to people through a pose network, whatever runs it: letterbox, run, decode.

A backend differs only in how it opens a file and runs a batch; it subclasses `NetworkBackend` and
fills in two methods, so that all backends give the same keypoints on the same file.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import ClassVar

import numpy as np

from gesture_core.errors import ConfigError, ModelError, PoseError
from gesture_core.pose.contract import ModelContract, Tensor, infer_contract
from gesture_core.pose.decode import decode
from gesture_core.pose.follow import Anatomy
from gesture_core.pose.models import FINDER, ModelFile, find_model, known_by_hash
from gesture_core.skeletons import skeleton
from gesture_core.types import Person

_REGION = 256
"""Pixels of a side of BlazePose's input, which no header states."""
MAX_ASPECT = 3.0
"""A free input is at most this much wider than high; wider pictures are letterboxed into it."""


@dataclass(frozen=True)
class Letterbox:
    """How a picture lies in the network's input: scaled, then moved by `left`, `top`.

    Both ends count coordinates from the centre of the first pixel, as cv2.resize does, so that
    ``input = (picture + 0.5) * scale - 0.5 + offset``. All sizes are in pixels.
    """

    width: int
    height: int
    scale_x: float
    scale_y: float
    left: int
    top: int
    inner_width: int
    inner_height: int

    @classmethod
    def fit(cls, frame_size: tuple[int, int], input_size: tuple[int, int]) -> Letterbox:
        """The largest undistorted, centred copy of a (width, height) picture in (height, width)."""
        width, height = frame_size
        high, wide = input_size
        scale = min(wide / width, high / height)
        inner_width = min(wide, max(1, round(width * scale)))
        inner_height = min(high, max(1, round(height * scale)))
        left, top = (wide - inner_width) // 2, (high - inner_height) // 2
        scales = inner_width / width, inner_height / height
        return cls(wide, high, *scales, left, top, inner_width, inner_height)

    def back(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) points of the input as points of the picture."""
        scale = np.array([self.scale_x, self.scale_y], np.float32)
        offset = np.array([self.left, self.top], np.float32)
        return ((points - offset + 0.5) / scale - 0.5).astype(np.float32)


def input_size(contract: ModelContract, frame_size: tuple[int, int], size: int | None) -> tuple[int, int]:
    """(height, width) of the input for a (width, height) picture.

    A free input has the height `size` and the picture's aspect ratio, both rounded up to the
    network's multiple, as OpenPose does (``net_resolution -1x368``).
    """
    if contract.input_size is not None:
        return contract.input_size
    step = contract.multiple
    width, height = frame_size
    high = math.ceil((size or contract.default_size) / step) * step
    wide = math.ceil(round(high * min(width / height, MAX_ASPECT)) / step) * step
    return high, max(wide, step)


def to_batch(frames: Sequence[np.ndarray], box: Letterbox, contract: ModelContract) -> np.ndarray:
    """The input of the network for ``frames``, (H, W, 3) uint8 in BGR, all of one size.

    Returns
    -------
    (N, 3, H, W) or (N, H, W, 3) array of the contract's dtype
    """
    import cv2

    picture = np.full((box.height, box.width, 3), contract.pad, np.uint8)
    wide, high = box.inner_width, box.inner_height
    inner = picture[box.top : box.top + high, box.left : box.left + wide]
    order = (0, 1, 2) if contract.colour == "bgr" else (2, 1, 0)
    first = contract.channels_first
    shape = (3, box.height, box.width) if first else (box.height, box.width, 3)
    batch = np.empty((len(frames), *shape), contract.dtype)
    for frame, target in zip(frames, batch if first else np.moveaxis(batch, 3, 1), strict=True):
        # Halved by averaging as long as possible, then interpolated: interpolation alone would drop thin
        # limbs, and averaging to any size takes six times as long.
        while frame.shape[1] >= 2 * wide and frame.shape[0] >= 2 * high:
            half = frame.shape[1] // 2, frame.shape[0] // 2
            frame = cv2.resize(frame, half, interpolation=cv2.INTER_AREA)
        inner[...] = cv2.resize(frame, (wide, high), interpolation=cv2.INTER_LINEAR)
        for plane, channel, mean, scale in zip(target, order, contract.mean, contract.scale, strict=True):
            plane[...] = picture[..., channel]
            if mean:
                plane -= mean
            if scale != 1:
                plane *= scale
    return batch


class NetworkBackend(ABC):
    """A pose backend around one network: a `PoseBackend` with all optional abilities.

    Parameters
    ----------
    model : ModelFile
    height : int, optional
        Pixels that a picture's height is scaled to where the network takes any size.
    score : float, optional
        Joints below this confidence are missing; the contract's figure by default.
    batch_size : int
        Frames that run together, where the network takes batches.
    threads : int
        Of the runtime; 0 leaves it to the runtime.
    steady : bool, optional
        Whether the limbs of a video are chosen for all frames together (`gesture_core.pose.temporal`); as the
        contract says by default.
    presence : float
        Least probability that somebody is a person at all.
    device : str
        What it runs on, one of `devices`; ``auto`` is the first of them.

    Raises
    ------
    ConfigError
        ``E_OPTION`` where a height is asked for that the network does not take.
    ModelError
        Where the file changed, is no network, keeps weights in other files, or has an unknown layout.
    """

    name: ClassVar[str] = ""
    """Name of the backend, for provenance."""
    runtime: ClassVar[str] = ""
    """Name and version of what runs the network, for provenance."""

    def __init__(
        self,
        model: ModelFile,
        height: int | None = None,
        score: float | None = None,
        batch_size: int = 8,
        threads: int = 0,
        steady: bool | None = None,
        presence: float = 0.5,
        device: str = "auto",
    ) -> None:
        if (
            not 0 <= (score or 0) <= 1
            or not 0 <= presence <= 1
            or batch_size < 1
            or threads < 0
            or (height is not None and height < 32)
        ):
            raise ValueError(
                f"score {score}, presence {presence}, batch_size {batch_size}, threads {threads}, "
                f"height {height}: score and presence lie in 0..1, batch_size is at least 1, threads at "
                "least 0, height at least 32"
            )
        self.model = model
        self.height = height
        self.threads = threads
        self.presence = presence
        first = next(iter(self.devices().values()), ["cpu"])[0]
        self.device = first if device == "auto" else device
        # The bytes that are checked are the bytes that run: the file is not opened again.
        data = model.read()
        if not known_by_hash(model.sha256):
            self.declared(data)  # refuses what would have a runtime open other files
        self.open(data)
        self.contract = model.contract or self._contract_of_a_run(data)
        size = self.contract.input_size
        if height is not None and size is not None and height != size[0]:
            raise ConfigError(
                f"height {height}: the network takes pictures of {size[1]}x{size[0]} alone",
                subject=model.name,
                remedy="no pose.height, or a network of any size",
                code="E_OPTION",
            )
        self.follow, self.crop = self.contract.follow, self.contract.crop
        self.steady = self.contract.steady if steady is None else steady
        regional = self.contract.layout in ("blazepose", "blazehand", "blazeface")
        self.region = (self.contract.input_size or (256, 256))[0] if regional else 0
        self.score = self.contract.score if score is None else score
        self.batch_size = self.contract.batch or batch_size
        self.skeleton = self.contract.skeleton
        self._anatomy = Anatomy(skeleton(self.skeleton)) if self.contract.presence else None
        free = height or self.contract.default_size
        self.provenance = {
            "backend": self.name,
            "runtime": self.runtime,
            "device": self.device,
            "model": model.name,
            "model_sha256": model.sha256,
            "score": repr(self.score),
            "presence": repr(presence),
            "height": str(self.contract.input_size[0] if self.contract.input_size else free),
        }

    def finder(self) -> NetworkBackend:
        """The packaged network on the same runtime, for the first region of one that needs a region."""
        return type(self)(find_model(FINDER), threads=self.threads, presence=0, device=self.device)

    @classmethod
    def devices(cls) -> Mapping[str, Sequence[str]]:
        """As `gesture_core.plugin.abilities.DeviceChoice` says: nothing to choose."""
        return {}

    def declared(self, data: bytes) -> tuple[Sequence[Tensor], Sequence[Tensor]]:
        """Inputs and outputs in the order of an ONNX file; none of another file, which has no header."""
        if self.model.path.suffix.lower() != ".onnx":
            return (), ()
        from gesture_core.pose.onnx_header import read_header

        header = read_header(data, str(self.model.path))
        return header.inputs, header.outputs

    @abstractmethod
    def open(self, data: bytes) -> None:
        """Load the network of `model`, once, from the bytes of its file; a ModelError where that fails."""

    @abstractmethod
    def run(self, batch: np.ndarray) -> list[np.ndarray]:
        """Outputs of the network for one batch of its input."""

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        """People in each of ``frames``, each (H, W, 3) uint8 in BGR, best person first.

        Raises
        ------
        PoseError
            ``E_POSE_FRAME`` for an array that is no frame, ``E_POSE_PEOPLE`` for ``people`` that
            this network cannot give.
        """
        if people not in ("single", "multi"):
            raise PoseError(f"people = {people!r}", remedy="single or multi", code="E_POSE_PEOPLE")
        for frame in frames:
            if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or 0 in frame.shape:
                raise PoseError(
                    f"a frame has shape {frame.shape} and type {frame.dtype}, expected (H, W, 3) uint8",
                    code="E_POSE_FRAME",
                )
        found: list[list[Person]] = []
        while len(found) < len(frames):
            start = end = len(found)  # a batch holds frames of one size
            while (
                end < min(start + self.batch_size, len(frames)) and frames[end].shape == frames[start].shape
            ):
                end += 1
            found += self._batch(frames[start:end], people)
        return found

    def _batch(self, frames: Sequence[np.ndarray], people: str) -> list[list[Person]]:
        frame_size = frames[0].shape[1], frames[0].shape[0]
        size = input_size(self.contract, frame_size, self.height)
        box = Letterbox.fit(frame_size, size)
        batch = to_batch(frames, box, self.contract)
        lacking = (self.contract.batch or len(batch)) - len(batch)
        if lacking:  # the file fixes the number of pictures
            batch = np.concatenate([batch, np.repeat(batch[-1:], lacking, axis=0)])
        outputs = self.run(batch)
        if lacking:
            outputs = [output[: len(frames)] for output in outputs]
        pictures = decode(outputs, self.contract, size, people, max(self.score, 0.05))
        placed = iter(self._in_frame([one for picture in pictures for one in picture], box, frame_size))
        found = [list(islice(placed, len(picture))) for picture in pictures]
        return [[person for person in picture if person.presence >= self.presence] for picture in found]

    def _in_frame(
        self, people: Sequence[Person], box: Letterbox, frame_size: tuple[int, int]
    ) -> list[Person]:
        """People of the input in pixels of the frame; joints outside it or below the score are missing."""
        if not people:
            return []
        joints = np.concatenate(
            [
                np.stack([person.keypoints for person in people]),
                np.stack([person.scores for person in people])[..., None],
            ],
            axis=2,
        )[:, :, None]
        peaks = [person.peaks for person in people if person.peaks is not None]
        if peaks:  # all have some, or none
            joints = np.concatenate([joints, np.stack(peaks)], axis=2)
        # A peak may be lower than a joint that counts by itself.
        least = np.array([self.score] + [0] * (joints.shape[2] - 1), np.float32)
        points, scores = box.back(joints[..., :2]), joints[..., 2]
        size = np.array(frame_size)
        # A peak in the border that letterboxing added is a joint outside the picture: a guess. A network
        # that sees one region is made to guess where the body goes on.
        slack = np.inf if self.region else 0.02 * max(frame_size)
        inside = (points > -slack).all(-1) & (points < size + slack).all(-1)
        kept = (scores >= least) & inside
        placed = points if self.region else np.clip(points, 0, (size - 1).astype(np.float32))
        places = np.where(kept[..., None], placed, np.float32(np.nan))
        sure = np.where(kept, scores, np.float32(0))
        found = np.concatenate([places, sure[..., None]], axis=-1)
        return [self._person(one, there, box) for one, there in zip(people, found, strict=True)]

    def _person(self, person: Person, found: np.ndarray, box: Letterbox) -> Person:
        """``person`` in pixels of the frame, where its joint and peaks are ``found`` (J, 1 + K, 3)."""
        # Copies, so that the joints do not keep the peaks in memory, nor these those of a whole batch.
        places, sure = found[:, 0, :2].copy(), found[:, 0, 2].copy()
        placed = Person(
            places,
            sure,
            None if person.peaks is None else found[:, 1:].copy(),
            person.presence,
            None if person.region is None else box.back(person.region),
            person.others,
            None if person.depth is None else person.depth / np.float32(box.scale_x),
        )
        if self._anatomy:
            facts = 1, self._anatomy.confidence(placed), float((sure > 0).mean())
            logit = float(np.dot(self.contract.presence, facts))
            placed = replace(placed, presence=1 / (1 + math.exp(-logit)))
        return placed

    def _contract_of_a_run(self, data: bytes) -> ModelContract:
        """The contract of a network that no header describes, from one run on a grey picture."""
        side = _REGION if self.model.path.suffix.lower() == ".tflite" else 368
        inputs, _ = self.declared(data)
        declared = next(iter(inputs), Tensor("input", "float32", (None, 3, side, side)))
        shape = [1 if i == 0 else (n or 256) for i, n in enumerate(declared.shape)]
        if len(shape) != 4 or 3 not in (shape[1], shape[3]):
            infer_contract([declared], [], str(self.model.path))  # raises, and names the shape
        try:
            outputs = self.run(np.full(shape, 128, declared.dtype))
        except TypeError as error:
            raise ModelError(
                f"input of type {declared.dtype}", subject=str(self.model.path), code="E_MODEL_INPUT"
            ) from error
        return infer_contract([declared], [out.shape for out in outputs], str(self.model.path))
