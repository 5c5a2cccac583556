"""Pictures of results: evaluations, explanations of a decision, keypoints over a video."""
