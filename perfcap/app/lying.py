"""People who lie: what is measured along the trunk, as if they stood, says nothing of a floor."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import normalize

from perfcap.app.truth import FoundJoints, Truth, match_frames
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip

OF_THE_FLOOR = ("foot_skate_mm", "frames_foot_skate", "penetration_mm")
_LONGER = 1.5  # people who lie are so much longer than high
_AGREE, _ALONG, _ACROSS = 0.9, 0.4, 0.7  # of cameras' up, of the trunk along it, along rows


def lying_doubt(found: FoundJoints, truth: Truth) -> str | None:
    """Why nothing is known of the floor under a person; None where the trunk stands in the images.

    Cameras that look down or up along the trunk say nothing.
    """
    sequence = truth.sequence
    if sequence.joints3d is None or sequence.rig is None:
        return None
    rows = match_frames(found.frames, truth, str(found.path))[1]
    joints = sequence.joints3d[rows]
    trunk = joints[:, LANDMARKS.index("neck")] - mid_hip(joints)
    rotation = sequence.rig.cameras.rotation.to(trunk)  # world to camera, of views or frames too
    views = rotation.reshape(-1, *rotation.shape[-3:]).mean(0)
    right, up = views[:, 0], -views[:, 1].mean(0)
    axis = normalize(normalize(trunk, dim=-1).nanmean(0), dim=0)
    if not axis.isfinite().all() or float(up.norm()) < _AGREE:
        return None
    if float((axis @ up).abs()) > _ALONG or float((right @ axis).abs().max()) < _ACROSS:
        return None
    along, above = (_extent(joints @ way) for way in (axis, normalize(up, dim=0)))
    if not along > _LONGER * above:
        return None
    return (
        f"{sequence.folder}: the trunk of the person lies across the images of the truth's "
        "cameras; as the floor is taken to be square to it, how far feet slide and how deep they "
        "go is left out"
    )


def _extent(places: Tensor) -> float:
    """Median over frames of how far joints (F, 16) along an axis are apart, m."""
    known = places.isfinite()
    high = places.where(known, -torch.inf).amax(-1)
    low = places.where(known, torch.inf).amin(-1)
    return float((high - low)[known.any(-1)].median())
