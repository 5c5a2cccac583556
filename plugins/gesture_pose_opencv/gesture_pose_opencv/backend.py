"""Runs pose networks with OpenCV's DNN module: ONNX, TensorFlow (Lite), Caffe where OpenCV still reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from gesture_core.errors import ModelError
from gesture_core.pose import NetworkBackend, read_model

_PROTOTXT_LIMIT = 1 << 20


_TARGETS = {
    "cuda": (cv2.dnn.DNN_BACKEND_CUDA, cv2.dnn.DNN_TARGET_CUDA),
    "cpu": (cv2.dnn.DNN_BACKEND_OPENCV, cv2.dnn.DNN_TARGET_CPU),
    "cuda-fp16": (cv2.dnn.DNN_BACKEND_CUDA, cv2.dnn.DNN_TARGET_CUDA_FP16),
    "opencl": (cv2.dnn.DNN_BACKEND_OPENCV, cv2.dnn.DNN_TARGET_OPENCL),
    "opencl-fp16": (cv2.dnn.DNN_BACKEND_OPENCV, cv2.dnn.DNN_TARGET_OPENCL_FP16),
    "vulkan": (cv2.dnn.DNN_BACKEND_VKCOM, cv2.dnn.DNN_TARGET_VULKAN),
}
"""What OpenCV calls them; auto takes the first that its build has."""


class OpenCvBackend(NetworkBackend):
    """Pose networks in ONNX, TensorFlow, TensorFlow Lite or Caffe. Options as `NetworkBackend`."""

    name = "opencv-dnn"
    runtime = f"opencv {cv2.__version__}"

    @classmethod
    def devices(cls) -> Mapping[str, Sequence[str]]:
        return {
            "target": [
                name
                for name, (backend, target) in _TARGETS.items()
                if target in cv2.dnn.getAvailableTargets(backend)
            ]
        }

    def open(self, data: bytes) -> None:
        content = np.frombuffer(data, np.uint8)
        try:
            match self.model.path.suffix.lower():
                case ".onnx":
                    self._net = cv2.dnn.readNetFromONNX(content)
                case ".tflite":
                    self._net = cv2.dnn.readNetFromTFLite(content)
                case ".pb":
                    self._net = cv2.dnn.readNetFromTensorflow(content)
                case _:
                    self._net = self._caffe(content)
        except cv2.error as error:
            raise self._refused("load it", error) from error
        backend, target = _TARGETS[self.device]
        self._net.setPreferableBackend(backend)
        self._net.setPreferableTarget(target)
        if self.threads:
            cv2.setNumThreads(self.threads)
        # OpenCV lists outputs in an order of its own; that of the file tells x from y.
        declared = [tensor.name for tensor in self.declared(data)[1]]
        found = self._net.getUnconnectedOutLayersNames()
        self._outputs = declared if set(declared) == set(found) else found
        if self.model.path.suffix.lower() == ".tflite":  # as the exporter numbered them
            self._outputs = sorted(found)

    def run(self, batch: np.ndarray) -> list[np.ndarray]:
        try:
            self._net.setInput(batch)
            return list(self._net.forward(self._outputs))
        except cv2.error as error:
            raise self._refused(f"run it on an input of shape {batch.shape}", error) from error

    def _caffe(self, weights: np.ndarray) -> cv2.dnn.Net:
        # OpenCV 5 took the Caffe importer out; 4 keeps it.
        if not hasattr(cv2.dnn, "readNetFromCaffe"):
            raise ModelError(
                f"OpenCV {cv2.__version__} no longer reads Caffe",
                subject=str(self.model.path),
                remedy="convert the network to ONNX, or install opencv-python-headless<5",
                code="E_MODEL_FORMAT",
            )
        prototxt = self.model.prototxt
        if not prototxt.is_file():
            raise ModelError(
                "Caffe weights need their description beside them",
                subject=str(self.model.path),
                remedy=f"put the network's .prototxt at {prototxt.name}",
                code="E_MODEL_MISSING",
            )
        text = read_model(prototxt, _PROTOTXT_LIMIT)
        return cv2.dnn.readNetFromCaffe(np.frombuffer(text, np.uint8), weights)

    def _refused(self, what: str, error: cv2.error) -> ModelError:
        # OpenCV repeats itself over several lines; the first of them say what it is.
        reason = " ".join((error.err or str(error)).split())
        return ModelError(
            f"OpenCV {cv2.__version__} cannot {what}: {reason[:200]}",
            subject=str(self.model.path),
            remedy="--pose onnx for an ONNX file, or another model",
            code="E_MODEL_LOAD",
        )
