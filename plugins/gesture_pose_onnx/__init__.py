"""Pose backend on onnxruntime."""
