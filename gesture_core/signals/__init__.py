"""From keypoints to signals: the chain normalizer, filters, selector."""
