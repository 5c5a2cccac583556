"""Readers of ready-made keypoint files."""
