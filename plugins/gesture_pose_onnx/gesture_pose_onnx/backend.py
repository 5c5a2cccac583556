"""Runs pose networks with onnxruntime: one session, batches of frames, threads set once."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np
import onnxruntime

from gesture_core.errors import ModelError
from gesture_core.pose import NetworkBackend

# What auto chooses from, in order: TensorRT would build its engine for minutes first, and sums of sixteen
# bits are other sums, so that they come after what there always is.
_PROVIDERS = {
    "cuda": "CUDAExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
    "directml": "DmlExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
    "cpu": "CPUExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "openvino-bf16": "OpenVINOExecutionProvider",
}


class OnnxBackend(NetworkBackend):
    """Pose networks in ONNX. Options as `NetworkBackend`."""

    name = "onnx"
    runtime = f"onnxruntime {onnxruntime.__version__}"

    @classmethod
    def devices(cls) -> Mapping[str, Sequence[str]]:
        installed = onnxruntime.get_available_providers()
        return {"provider": [name for name, provider in _PROVIDERS.items() if provider in installed]}

    def open(self, data: bytes) -> None:
        subject = str(self.model.path)
        if self.model.path.suffix.lower() != ".onnx":
            raise ModelError(
                f"onnxruntime reads ONNX, not {self.model.path.suffix}",
                subject=subject,
                remedy="--pose opencv-dnn, or convert it to ONNX",
                code="E_MODEL_FORMAT",
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            provider = _PROVIDERS[self.device]
            told = (provider, self._told())
            self._session = onnxruntime.InferenceSession(data, options, providers=[told])
        except Exception as error:  # onnxruntime's errors have no common base but Exception
            raise ModelError(
                f"onnxruntime cannot load it: {str(error).splitlines()[0]}",
                subject=subject,
                remedy="'gesture models verify', or another model",
                code="E_MODEL_LOAD",
            ) from error
        # It goes on without a provider whose libraries it cannot load, and tells nobody.
        if provider not in self._session.get_providers():
            raise ModelError(
                f"onnxruntime has {self.device}, but cannot load its libraries",
                subject=subject,
                remedy="--set pose.provider=cpu, or the libraries of that provider",
                code="E_PROVIDER",
            )
        self._input = self._session.get_inputs()[0].name

    def _told(self) -> dict[str, str]:
        """What a provider is told besides: OpenVINO does not hear of the session's threads."""
        if not self.device.startswith("openvino"):
            return {}
        told = {"INFERENCE_NUM_THREADS": str(self.threads)} if self.threads else {}
        told["INFERENCE_PRECISION_HINT"] = "bf16" if self.device.endswith("bf16") else "f32"
        return {"load_config": json.dumps({"CPU": told})}

    def run(self, batch: np.ndarray) -> list[np.ndarray]:
        try:
            outputs: list[np.ndarray] = self._session.run(None, {self._input: batch})
        except Exception as error:  # as above
            raise ModelError(
                f"onnxruntime cannot run it on an input of shape {batch.shape}: {str(error).splitlines()[0]}",
                subject=str(self.model.path),
                code="E_MODEL_RUN",
            ) from error
        return outputs
