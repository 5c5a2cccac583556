"""Runs pose networks with OpenCV's DNN module: ONNX, TensorFlow, and Caffe where OpenCV still reads it."""

from __future__ import annotations

import cv2
import numpy as np

from gesture_core.errors import ModelError
from gesture_core.pose.layouts import Tensor
from gesture_core.pose.model_file import ModelFile, read_bounded
from gesture_core.pose.network import NetworkBackend
from gesture_core.pose.onnx_header import read_header

_PROTOTXT_LIMIT = 1 << 20


class OpenCvBackend(NetworkBackend):
    """Pose networks in ONNX, TensorFlow or Caffe. Options as `NetworkBackend`."""

    name = "opencv-dnn"

    def open(self, model: ModelFile) -> None:
        self._declared: Tensor | None = None
        declared: tuple[str, ...] = ()
        suffix = model.path.suffix.lower()
        data = model.read()
        try:
            if suffix == ".onnx":
                header = read_header(data, str(model.path))
                self._declared = header.inputs[0] if header.inputs else None
                declared = tuple(tensor.name for tensor in header.outputs)
                self._net = cv2.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))
            elif suffix == ".pb":
                self._net = cv2.dnn.readNetFromTensorflow(np.frombuffer(data, np.uint8))
            else:
                self._net = _caffe(model, data)
        except cv2.error as error:
            raise _refused(model, "load it", error) from error
        if self.threads:
            cv2.setNumThreads(self.threads)
        # OpenCV lists outputs in an order of its own; that of the file tells x from y.
        found = self._net.getUnconnectedOutLayersNames()
        self._outputs = declared if set(declared) == set(found) else found

    def run(self, batch: np.ndarray) -> list[np.ndarray]:
        try:
            self._net.setInput(batch)
            return list(self._net.forward(self._outputs))
        except cv2.error as error:
            raise _refused(self.model, f"run it on an input of shape {batch.shape}", error) from error

    def declared_input(self) -> Tensor | None:
        return self._declared

    @property
    def version(self) -> str:
        return f"opencv {cv2.__version__}"


def _caffe(model: ModelFile, weights: bytes) -> cv2.dnn.Net:
    # OpenCV 5 took the Caffe importer out; 4 keeps it.
    if not hasattr(cv2.dnn, "readNetFromCaffe"):
        raise ModelError(
            f"OpenCV {cv2.__version__} no longer reads Caffe",
            subject=str(model.path),
            remedy="convert the network to ONNX, or install opencv-python-headless<5",
            code="E_MODEL_FORMAT",
        )
    if not model.prototxt.is_file():
        raise ModelError(
            "Caffe weights need their description beside them",
            subject=str(model.path),
            remedy=f"put the network's .prototxt at {model.prototxt.name}",
            code="E_MODEL_MISSING",
        )
    text = read_bounded(model.prototxt, _PROTOTXT_LIMIT)
    return cv2.dnn.readNetFromCaffe(np.frombuffer(text, np.uint8), np.frombuffer(weights, np.uint8))


def _refused(model: ModelFile, what: str, error: cv2.error) -> ModelError:
    # OpenCV repeats itself over several lines; the first of them say what it is.
    reason = " ".join((error.err or str(error)).split())
    return ModelError(
        f"OpenCV {cv2.__version__} cannot {what}: {reason[:200]}",
        subject=str(model.path),
        remedy="--pose onnx for an ONNX file, or another model",
        code="E_MODEL_LOAD",
    )
