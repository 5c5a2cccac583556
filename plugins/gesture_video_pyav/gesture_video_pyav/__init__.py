"""Video reader on PyAV (FFmpeg)."""
