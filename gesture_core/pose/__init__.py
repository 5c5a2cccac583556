"""Pose: from frames to keypoints.

`extract_poses` (`extract`) takes frames in batches. Where one person is followed, `Follower` (`follow`)
crops the frames to them. A backend finds people in the frames; one around a network is a `NetworkBackend`
(`network`), which letterboxes, runs and decodes (`decode`, `heatmaps`) as the network's `ModelContract`
(`contract`) says. At the end limbs are chosen for all frames together (`temporal`). Networks are found in
`models` and `model_store`, and a file is checked in `onnx_header` before any runtime sees it.

Public for plugins of the kinds ``pose`` and ``reader``, besides `gesture_core.errors`, `gesture_core.files`,
`gesture_core.skeletons`, `gesture_core.types` and `gesture_core.plugin.interfaces`: the names below.
"""

from gesture_core.pose.contract import ModelContract, Tensor
from gesture_core.pose.extract import Tracker, extract_poses, open_backend
from gesture_core.pose.models import ModelFile, find_model, read_model
from gesture_core.pose.network import NetworkBackend
from gesture_core.pose.onnx_header import OnnxHeader

__all__ = [
    "ModelContract",
    "ModelFile",
    "NetworkBackend",
    "OnnxHeader",
    "Tensor",
    "Tracker",
    "extract_poses",
    "find_model",
    "open_backend",
    "read_model",
]
