"""A network looks at a person whose joints are known: its manifest may be wrong, or they may be."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.crop import Crop, Frame, body_box
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16, map_to_landmarks
from perfcap.detect.look import CropNetwork, Look, look_at

Floats = NDArray[np.float64]

NEAR = 0.1
"""Of the larger extent of a person's joints: joints within this are where they are known to be."""

JUDGED = [n for n, name in enumerate(LANDMARKS) if "toe" not in name and name[1] == "_"]
"""Landmarks that have a side and are in nearly all joint sets."""

OPPOSITE = list(LANDMARKS16.mirrored())
"""Order that gives each landmark the place of the other side's."""


def look_at_known(
    network: CropNetwork, frame: Frame, joints: Floats
) -> tuple[Floats, Floats] | None:
    """Landmarks (16, 2) that a network sees around known ones, pixels, and its confidence (16,).

    Args:
        network: looks at a crop.
        frame: (H, W, 3), RGB.
        joints: known landmarks (16, 2), pixels; NaN where unknown.

    Returns:
        None where too few are known for a crop.
    """
    look = look_around(network, frame, joints)
    if look is None:
        return None
    points, sure = map_to_landmarks(look.joints2d, look.confidence, network.joint_set)
    return points.double().numpy(), sure.double().numpy()


def look_around(network: CropNetwork, frame: Frame, joints: Floats) -> Look | None:
    """All that a network sees in the crop around known landmarks, as of ``look_at_known``."""
    known = torch.from_numpy(np.isfinite(joints).all(-1)).float()
    box = body_box(torch.from_numpy(np.nan_to_num(joints)), known, 0.5)
    if box is None:
        return None
    spec = network.manifest.input
    return look_at(network, frame, [Crop.around(box, spec.size, spec.padding)])[0]
