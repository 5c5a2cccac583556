"""A normalizer: the middle of the hips is the origin, their mean distance in the sequence is 1."""

from dataclasses import dataclass

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.skeletons import COCO18


@dataclass(frozen=True)
class HipNormalizer:
    """Options are the fields: ``--set hips.minimum=2``.

    Attributes
    ----------
    minimum : float
        Pixels; narrower hips are no scale.
    """

    minimum: float = 1.0

    def normalize(self, pose):
        """(T, 18, 2) coordinates in hip widths."""
        right = pose.keypoints[:, COCO18.index("right_hip")]
        left = pose.keypoints[:, COCO18.index("left_hip")]
        widths = np.linalg.norm(right - left, axis=1)
        if not np.isfinite(widths).any() or np.nanmedian(widths) < self.minimum:
            raise PoseError("the hips are not seen", code="E_POSE_SCALE")
        centre = (right + left) / 2
        return (pose.keypoints - centre[:, None]) / np.nanmedian(widths)
