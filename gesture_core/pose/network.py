"""From frames to people through a pose network, whatever runs it: letterbox, run, decode.

A backend differs only in how it opens a file and runs a batch; it subclasses `NetworkBackend` and
fills in two methods, so that all backends give the same keypoints on the same file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from gesture_core.errors import ModelError, PoseError
from gesture_core.plugin.interfaces import Person
from gesture_core.pose.contracts import ModelContract
from gesture_core.pose.decode import Found, decode
from gesture_core.pose.fields import AssemblyRules
from gesture_core.pose.layouts import Tensor, infer_contract
from gesture_core.pose.letterbox import Letterbox, input_size, to_batch
from gesture_core.pose.model_file import ModelFile
from gesture_core.pose.sighting import Sighting

PEOPLE = ("single", "multi")


class NetworkBackend(ABC):
    """A pose backend around one network.

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
    steady : bool
        Whether the limbs of a video are chosen for all frames together (`gesture_core.pose.steady`).
    """

    name = ""
    """Name of the backend, for provenance."""

    def __init__(
        self,
        model: ModelFile,
        height: int | None = None,
        score: float | None = None,
        batch_size: int = 8,
        threads: int = 0,
        steady: bool = True,
    ) -> None:
        if (
            not 0 <= (score or 0) <= 1
            or batch_size < 1
            or threads < 0
            or (height is not None and height < 32)
        ):
            raise ValueError(
                f"score {score}, batch_size {batch_size}, threads {threads}, height {height}: score lies in "
                "0..1, batch_size is at least 1, threads at least 0, height at least 32"
            )
        self.model = model
        self.height = height
        self.threads = threads
        self.steady = steady
        self.open(model)
        self.contract = model.contract or self._probe()
        self.score = self.contract.score if score is None else score
        self.rules = AssemblyRules(peak=max(self.score, 0.05))
        self.batch_size = self.contract.batch or batch_size
        self.skeleton = self.contract.skeleton

    @abstractmethod
    def open(self, model: ModelFile) -> None:
        """Load the network, once; a ModelError where the runtime cannot."""

    @abstractmethod
    def run(self, batch: np.ndarray) -> list[np.ndarray]:
        """Outputs of the network for one batch of its input."""

    @abstractmethod
    def declared_input(self) -> Tensor | None:
        """Name, type and shape of the input where the runtime knows them."""

    @property
    @abstractmethod
    def version(self) -> str:
        """Version of the runtime."""

    @property
    def provenance(self) -> dict[str, str]:
        """What made the keypoints, all of it as text."""
        return {
            "backend": self.name,
            "runtime": self.version,
            "model": self.model.name,
            "model_sha256": self.model.sha256,
            "score": repr(self.score),
            "height": str(self.contract.input_size[0] if self.contract.input_size else self.free_height),
        }

    @property
    def free_height(self) -> int:
        """Pixels of the input's height where the network takes any."""
        return self.height or self.contract.default_size

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        """People in each of ``frames``, each (H, W, 3) uint8 in BGR, best person first.

        Raises
        ------
        PoseError
            ``E_POSE_FRAME`` for an array that is no frame, ``E_POSE_PEOPLE`` for ``people`` that
            this network cannot give.
        """
        if people not in PEOPLE:
            raise PoseError(f"people = {people!r}", remedy=" or ".join(PEOPLE), code="E_POSE_PEOPLE")
        found: list[list[Person]] = []
        start = 0
        while start < len(frames):
            shape = _checked(frames[start]).shape
            end = start + 1
            while end < len(frames) and end - start < self.batch_size and frames[end].shape == shape:
                end += 1
            found += self._batch([_checked(frame) for frame in frames[start:end]], people)
            start = end
        return found

    def _batch(self, frames: Sequence[np.ndarray], people: str) -> list[list[Person]]:
        high, wide = frames[0].shape[:2]
        size = input_size(self.contract, (wide, high), self.height)
        box = Letterbox.fit((wide, high), size)
        outputs = self._run(to_batch(frames, box, self.contract))
        pictures = decode(outputs, self.contract, size, people, self.rules)
        return [[self._person(one, box, (wide, high)) for one in picture] for picture in pictures]

    def _run(self, batch: np.ndarray) -> list[np.ndarray]:
        """The outputs for a batch of at most `batch_size`, filled up where the file fixes their number."""
        lacking = (self.contract.batch or len(batch)) - len(batch)
        if not lacking:
            return self.run(batch)
        filled = np.concatenate([batch, np.repeat(batch[-1:], lacking, axis=0)])
        return [output[: len(batch)] for output in self.run(filled)]

    def _person(self, found: Found, box: Letterbox, frame_size: tuple[int, int]) -> Person:
        joints = np.concatenate([found.points, found.scores[:, None]], axis=1)
        kept = _in_frame(joints, self.score, box, frame_size)
        points, scores = kept[:, :2], kept[:, 2]
        if found.peaks is None:
            return Person(points, scores)
        return Sighting(points, scores, _in_frame(found.peaks, 0.0, box, frame_size))

    def _probe(self) -> ModelContract:
        """The contract of a network that no header describes, from one run on a grey picture."""
        declared = self.declared_input() or Tensor("input", "float32", (None, 3, 368, 368))
        shape = [1 if i == 0 else (n or 256) for i, n in enumerate(declared.shape)]
        if len(shape) != 4 or 3 not in (shape[1], shape[3]):
            infer_contract([declared], [], str(self.model.path))
        try:
            grey = np.full(shape, 128, declared.dtype)
            outputs = self.run(grey)
        except TypeError as error:
            raise ModelError(
                f"input of type {declared.dtype}", subject=str(self.model.path), code="E_MODEL_INPUT"
            ) from error
        return infer_contract([declared], [out.shape for out in outputs], str(self.model.path))


def _in_frame(joints: np.ndarray, least: float, box: Letterbox, frame_size: tuple[int, int]) -> np.ndarray:
    """(..., 3) x, y, score of the input in pixels of the frame; NaN, NaN, 0 outside and below ``least``."""
    points, scores = box.back(joints[..., :2]), joints[..., 2]
    wide, high = frame_size
    # A peak in the border that letterboxing added is a joint outside the picture: a guess.
    slack = 0.02 * max(wide, high)
    inside = (points > -slack).all(-1) & (points < np.array([wide, high]) + slack).all(-1)
    kept = (scores >= least) & inside
    out = np.empty(joints.shape, np.float32)
    limit = np.array([wide - 1, high - 1], np.float32)
    out[..., :2] = np.where(kept[..., None], np.clip(points, 0, limit), np.nan)
    out[..., 2] = np.where(kept, scores, 0)
    return out


def _checked(frame: np.ndarray) -> np.ndarray:
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or 0 in frame.shape:
        raise PoseError(
            f"a frame has shape {frame.shape} and type {frame.dtype}, expected (H, W, 3) uint8",
            code="E_POSE_FRAME",
        )
    return frame
