"""Pose backend on OpenCV's DNN module."""
