"""Discovery, keypoint store, journal, workers, resume."""
