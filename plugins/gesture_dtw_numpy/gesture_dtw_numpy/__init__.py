"""Distance kernels on NumPy: the exact one that runs anywhere, and FastDTW."""
