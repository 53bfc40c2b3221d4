"""Whether joints called left and right are: feet point ahead, and hips lie under the shoulders."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding, Severity

AHEAD = 0.2  # cosine between what sides and feet call ahead, below which a frame says nothing
_FEWEST = 5  # frames that say something
_MOST = 0.75  # share of them
_REMEDY = (
    "left and right are the person's own: exchange the names; a calibration whose world is a "
    "mirror image looks the same"
)


def examine_sides(subject: str, points: Tensor) -> list[Finding]:
    """Left and right of joints in space, exchanged in all views or in a 3D pose, leave no trace.

    But then toes point backwards; and where arms or legs alone are exchanged, the hips' sides are
    opposite to the shoulders'.

    Args:
        subject: of the finding.
        points: landmarks (F, 16, 3) in right-handed axes, NaN where unknown.
    """
    at = dict(zip(LANDMARKS, points.unbind(1), strict=True))
    hips, shoulders = at["l_hip"] - at["r_hip"], at["l_shoulder"] - at["r_shoulder"]
    up = at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"])
    feet = [at[f"{side}_toe"] - at[f"{side}_ankle"] for side in "lr"]
    toes = 0.5 * (feet[0] + feet[1])
    if _against(_cosine(hips, shoulders)):
        legs = _against(_cosine(torch.linalg.cross(hips, up), toes))
        what = f"left and right of the {'legs' if legs else 'arms'} look exchanged in every frame"
        return [Finding(Severity.ERROR, subject, what, _REMEDY)]
    if _against(_cosine(torch.linalg.cross(hips, up), toes)):
        what = "left and right look exchanged: the feet point backwards"
        return [Finding(Severity.ERROR, subject, what, _REMEDY)]
    return []


def _cosine(first: Tensor, second: Tensor) -> Tensor:
    """Of the frames (F,) that know both directions."""
    cosine = torch.nn.functional.cosine_similarity(first, second, dim=-1)
    return cosine[cosine.isfinite()]


def _against(cosine: Tensor) -> bool:
    """Whether nearly all frames that say something say the opposite."""
    clear = cosine[cosine.abs() > AHEAD]
    return len(clear) >= _FEWEST and float((clear < 0).double().mean()) > _MOST
