"""Registers the onnxruntime pose backend."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_pose_backends(register: Register) -> None:
    register(
        "onnx",
        "gesture_pose_onnx.backend:OnnxBackend",
        needs=("onnxruntime", "cv2"),
        summary="pose networks in ONNX, run by onnxruntime",
        suffixes=(".onnx",),
    )
