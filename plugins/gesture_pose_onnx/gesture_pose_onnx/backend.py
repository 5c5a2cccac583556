"""Runs pose networks with onnxruntime: one session, batches of frames, threads set once."""

from __future__ import annotations

import numpy as np
import onnxruntime

from gesture_core.errors import ModelError
from gesture_core.pose.layouts import Tensor
from gesture_core.pose.model_file import ModelFile
from gesture_core.pose.network import NetworkBackend
from gesture_core.pose.onnx_header import read_header

_TYPES = {"tensor(float)": "float32", "tensor(uint8)": "uint8", "tensor(int32)": "int32"}


class OnnxBackend(NetworkBackend):
    """Pose networks in ONNX. Options as `NetworkBackend`."""

    name = "onnx"

    def open(self, model: ModelFile) -> None:
        subject = str(model.path)
        if model.path.suffix.lower() != ".onnx":
            raise ModelError(
                f"onnxruntime reads ONNX, not {model.path.suffix}",
                subject=subject,
                remedy="--pose opencv-dnn, or convert it to ONNX",
                code="E_MODEL_FORMAT",
            )
        data = model.read()
        # The bytes that were checked are the bytes that run: the file is not opened again.
        read_header(data, subject)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's errors have no common base but Exception
            raise ModelError(
                f"onnxruntime cannot load it: {str(error).splitlines()[0]}",
                subject=subject,
                remedy="'gesture models verify', or another model",
                code="E_MODEL_LOAD",
            ) from error
        self._input = self._session.get_inputs()[0]

    def run(self, batch: np.ndarray) -> list[np.ndarray]:
        try:
            outputs: list[np.ndarray] = self._session.run(None, {self._input.name: batch})
        except Exception as error:  # as above
            raise ModelError(
                f"onnxruntime cannot run it on an input of shape {batch.shape}: {str(error).splitlines()[0]}",
                subject=str(self.model.path),
                code="E_MODEL_RUN",
            ) from error
        return outputs

    def declared_input(self) -> Tensor | None:
        shape = tuple(n if isinstance(n, int) and n > 0 else None for n in self._input.shape)
        return Tensor(self._input.name, _TYPES.get(self._input.type, self._input.type), shape)

    @property
    def version(self) -> str:
        return f"onnxruntime {onnxruntime.__version__}"
