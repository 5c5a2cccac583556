"""Registers the OpenCV DNN pose backend."""

from gesture_core.plugin.hooks import Register, hookimpl


@hookimpl
def register_pose_backends(register: Register) -> None:
    register(
        "opencv-dnn",
        "gesture_pose_opencv.backend:OpenCvBackend",
        needs=("cv2",),
        summary="pose networks in ONNX, TensorFlow (Lite) or Caffe, run by OpenCV",
        suffixes=(".onnx", ".tflite", ".pb", ".caffemodel"),
    )
