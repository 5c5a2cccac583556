"""Probing and decoding videos: frames with their real timestamps, damage counted."""
