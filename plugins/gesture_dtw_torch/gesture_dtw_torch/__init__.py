"""Warping-distance kernel on Torch."""
