"""Warping-distance kernel on JAX."""
