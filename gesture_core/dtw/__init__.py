"""Warping distances: the specification, the float64 reference, batches, bands, search and paths."""
