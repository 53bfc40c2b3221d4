"""One person as MMPose writes them, and what builds on it: keypoints and scores apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from perfcap.errors import InputError
from perfcap.io.detections.track import Array


def parse_instance(path: object, instance: Any) -> Array:
    """Keypoints and scores of a person, (J, 3).

    Raises:
        InputError: there are none, or not as many of each.
    """
    where = f"{path}: an instance"
    if not isinstance(instance, dict) or "keypoints" not in instance:
        raise InputError(f"{where} has no keypoints; expected keypoints and keypoint_scores")
    try:
        points = np.asarray(instance["keypoints"], np.float64)
        scores = np.asarray(instance.get("keypoint_scores", ()), np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where} has keypoints that are not numbers") from error
    if points.ndim != 2 or points.shape[1] != 2 or scores.shape != points.shape[:1]:
        raise InputError(
            f"{where} has keypoints {points.shape} and keypoint_scores {scores.shape}, expected "
            "(J, 2) and (J,)"
        )
    return np.concatenate((points, scores[:, None]), 1)
