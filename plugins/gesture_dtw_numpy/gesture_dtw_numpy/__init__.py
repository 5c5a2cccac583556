"""Warping-distance kernels on NumPy."""
