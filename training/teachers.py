"""The two teachers: human-pose-estimation-0001 (lightweight OpenPose) and MoveNet Lightning.

Both are Apache-2.0 and are read from the folder that the user names; none is shipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .decode import decode
from .joints import COUNT, FROM_COCO17, MIRROR


def square(picture: np.ndarray, center: np.ndarray, side: float, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Cut a square out of a picture; what lies outside is grey.

    Returns
    -------
    crop : (size, size, 3) uint8
    back : (2, 3) float64
        Affine matrix from crop pixels to picture pixels.
    """
    scale = side / size
    back = np.array([[scale, 0, center[0] - side / 2], [0, scale, center[1] - side / 2]])
    shrink = 1.0
    if scale > 2:  # warpAffine has no area filter: shrink first
        shrink = 1.5 / scale
        picture = cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    crop = cv2.warpAffine(
        picture,
        back * shrink,
        (size, size),
        flags=cv2.WARP_INVERSE_MAP | cv2.INTER_LINEAR,
        borderValue=(127, 127, 127),
    )
    return crop, back


def apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """``matrix`` (2, 3) on (..., 2) points."""
    return points @ matrix[:, :2].T + matrix[:, 2]


@dataclass
class Teachers:
    """Both networks, ready to label crops.

    Parameters
    ----------
    folder : Path
        Holds ``hpe0001_f32_dynamic.onnx`` and ``movenet_lightning_dequantised_192.onnx``.
    threads : int
    """

    folder: Path
    threads: int = 2

    def __post_init__(self) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.log_severity_level = 3
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # others need the cores
        self._hpe, self._movenet = (
            onnxruntime.InferenceSession(str(self.folder / name), options, providers=["CPUExecutionProvider"])
            for name in ("hpe0001_f32_dynamic.onnx", "movenet_lightning_dequantised_192.onnx")
        )

    def heat(self, crops: np.ndarray) -> np.ndarray:
        """(N, 18, h, w) heat maps of hpe0001 for (N, H, W, 3) uint8 BGR, H and W multiples of 8."""
        feed = np.ascontiguousarray(crops.transpose(0, 3, 1, 2), np.float32)
        outputs = self._hpe.run(None, {self._hpe.get_inputs()[0].name: feed})
        return next(o for o in outputs if o.shape[1] in (57, 19))[:, :COUNT]

    def both_ways(self, crop: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """hpe0001 on a crop and on its mirror image: (18, 2) pixels of the crop and (18,) peaks of each."""
        maps = self.heat(np.stack([crop, crop[:, ::-1]]))
        points, scores = decode(maps, crop.shape[0] / maps.shape[2])
        return [(points[0], scores[0]), _mirrored(points[1], scores[1], crop.shape[1])]

    def quick(self, crop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """hpe0001 on a crop once: (18, 2) pixels and (18,) scores, good enough to find a person."""
        maps = self.heat(crop[None])
        points, scores = decode(maps, crop.shape[0] / maps.shape[2])
        return points[0], scores[0]

    def movenet(self, crop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """MoveNet on a square crop: (18, 2) pixels and (18,) scores, the neck zero."""
        size = 192
        small = cv2.resize(crop, (size, size), interpolation=cv2.INTER_AREA)
        feed = np.ascontiguousarray(small[None, :, :, ::-1])
        kind = self._movenet.get_inputs()[0].type
        cast = {"tensor(uint8)": np.uint8, "tensor(int32)": np.int32}.get(kind, np.float32)
        (out,) = self._movenet.run(None, {self._movenet.get_inputs()[0].name: feed.astype(cast)})
        rows = out.reshape(17, 3)[FROM_COCO17]
        points = rows[:, 1::-1] * crop.shape[0] - 0.5
        scores = np.where(FROM_COCO17 < 0, 0, rows[:, 2])
        return points, scores

    def movenet_both_ways(self, crop: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """MoveNet on a crop and on its mirror image."""
        return [self.movenet(crop), _mirrored(*self.movenet(crop[:, ::-1]), crop.shape[1])]


def _mirrored(points: np.ndarray, scores: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    other = points[MIRROR].copy()
    other[:, 0] = width - 1 - other[:, 0]
    return other, scores[MIRROR]
