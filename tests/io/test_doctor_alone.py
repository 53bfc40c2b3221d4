"""Where several people are followed, no option of one person is advised."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from doctored_views import NAMES, change_view, detections, one, person, rig

from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.doctor import Severity, examine_agreement, examine_inputs
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


@pytest.mark.parametrize("apart", [0.0, 1.2])
def test_another_of_several_people_in_a_view_is_no_error(tmp_path: Path, apart: float) -> None:
    """Of two people who stand apart, who is the most prominent changes from view to view."""
    cameras = rig().cameras
    aside = torch.tensor([0.9, 0.0, 0.3]).double()
    pixels = torch.stack([cameras.project(person() + k * apart * aside) for k in (0, 1)], 2)
    views = {
        name: {"K": k.tolist(), "R": r.tolist(), "t": t.tolist()}
        for name, k, r, t in zip(
            NAMES, cameras.intrinsics, cameras.rotation, cameras.translation, strict=True
        )
    }
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps({"views": views, "width": 1000, "height": 1000, "fps": 30}))
    np.savez(
        tmp_path / "detections.npz",
        joints2d=pixels.numpy(),
        confidence2d=np.full(pixels.shape[:-1], 0.9),
        joint_names=np.array(LANDMARKS),
        view_names=np.array(NAMES),
    )
    found = examine_inputs(path, [tmp_path / "detections.npz"])
    assert not [each for each in found if each.severity is Severity.ERROR]
    other = [each for each in found if "another one of the people in a view" in each.remedy]
    assert bool(other) == (apart > 0)
