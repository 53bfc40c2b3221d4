"""Where several people are followed, no option of one person is advised."""

from __future__ import annotations

import torch
from doctored_views import change_view, detections, one, rig

from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.doctor import examine_agreement
from perfcap.io.doctor.jumps import examine_jumps


def test_following_everybody_is_advised_to_who_does_not() -> None:
    turn = rotvec_to_matrix(torch.tensor([0.3, 0.14, 0.0], dtype=torch.float64))
    rotation = turn @ rig().cameras.rotation[1]
    broken = change_view(rig(), 1, rotation=rotation)
    assert "--people follows everybody" in one(examine_agreement(broken, detections())).remedy
    several = one(examine_agreement(broken, detections(), alone=False)).remedy
    assert "somebody else, and its video" in several
    assert "--people" not in several


def test_whom_to_follow_is_asked_of_one_person() -> None:
    seen = detections()
    pixels, confidence = seen.joints2d[:, 0].repeat(3, 1, 1), seen.confidence2d[:, 0].repeat(3, 1)
    pixels[len(pixels) // 2 :] += 800
    assert "--box or --person" in one(examine_jumps("left", pixels, confidence)).remedy
    several = one(examine_jumps("left", pixels, confidence, alone=False)).remedy
    assert several.endswith("give a part with --frames")
    assert "--person" not in several
