"""Left and right of joints that two views alone place, where some are elsewhere in one of them."""

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Finding, Severity, examine_agreement

MIRRORED = list(LANDMARKS16.mirrored())
HIPS, SHOULDERS = (
    [LANDMARKS.index(f"{side}_{name}") for side in "lr"] for name in ("hip", "shoulder")
)
TAKE = make_take(24, views=2, lifted=False)
SHOWN = list(range(2, 22, 3))  # frames in which hips are seen


def hips_now_and_then() -> Detections:
    """Hips, without which nothing is ahead, are seen in seven of 24 frames."""
    sure = TAKE.detections.confidence2d.clone()
    hidden = [frame for frame in range(24) if frame not in SHOWN]
    sure[torch.tensor(hidden)[:, None], :, torch.tensor(HIPS)] = 0
    return replace(TAKE.detections, confidence2d=sure)


def examined(detections: Detections) -> list[Finding]:
    return examine_agreement(CameraRig(("left", "right"), TAKE.cameras), detections)


def mirrored(detections: Detections) -> Detections:
    return replace(
        detections,
        joints2d=detections.joints2d[:, :, MIRRORED],
        confidence2d=detections.confidence2d[:, :, MIRRORED],
    )


def test_joints_that_one_of_two_views_has_elsewhere_prove_nothing() -> None:
    """A detector takes one shoulder for the other in just those frames, in one view."""
    right = hips_now_and_then()
    pixels = right.joints2d.clone()
    for frame in SHOWN:
        pixels[frame, 0, SHOULDERS] = right.joints2d[frame, 0, SHOULDERS[::-1]]
    (found,) = examined(replace(right, joints2d=pixels))
    assert found.severity is Severity.WARNING and not found.views, "nothing is doubted for it"
    assert f"in {len(SHOWN)} of {len(SHOWN)} frames that show it, of 24" in found.what
    assert "may be exchanged: hips and shoulders have left and right opposite ways" in found.what


@pytest.mark.parametrize("exchanged", [False, True])
def test_hips_whose_width_is_another_each_time_prove_nothing(exchanged: bool) -> None:
    """Views that face each other hardly know it; both agree on where these hips are."""
    right = hips_now_and_then()
    points = TAKE.actor.joints(TAKE.truth)[:, HIPS]
    middle = points.mean(1, keepdim=True)
    width = torch.ones(24, 1, 1, dtype=points.dtype)
    width[SHOWN[::2]] = 0.3
    pixels = right.joints2d.clone()
    pixels[:, :, HIPS] = TAKE.cameras.project(middle + width * (points - middle)).to(pixels)
    seen = replace(right, joints2d=pixels)
    found = examined(mirrored(seen) if exchanged else seen)
    words = [each.what for each in found if each.severity is Severity.WARNING]
    assert len(found) == len(words) == exchanged
    assert all(f"the feet point backwards in {len(SHOWN)} of" in each for each in words)


def test_joints_that_are_exchanged_in_both_are_refused() -> None:
    right = hips_now_and_then()
    assert not examined(right)
    (found,) = examined(mirrored(right))
    assert found.severity is Severity.ERROR and found.views == (0, 1)
    assert found.what == "left and right look exchanged: the feet point backwards"
