"""Warping-distance kernel on Numba."""
