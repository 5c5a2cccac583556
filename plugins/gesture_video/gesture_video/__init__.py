"""The built-in video readers: PyAV, and OpenCV where PyAV is not installed."""
