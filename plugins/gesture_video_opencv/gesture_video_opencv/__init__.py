"""Video reader on OpenCV."""
