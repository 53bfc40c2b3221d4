"""One of two cameras that was turned after it was calibrated."""

from collections.abc import Sequence

import pytest
import torch
from doctored_views import change_view, detections, one, rig, with_joints

from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_agreement
from perfcap.io.doctor.evidence import Scene
from perfcap.io.doctor.turned_camera import turned_camera

PAIR = [0, 1]


def knocked(degrees: Sequence[float]) -> CameraRig:
    """Two cameras, the first of which looks elsewhere, by a rotation vector in its axes."""
    good = rig().select(PAIR)
    turn = rotvec_to_matrix(torch.tensor(degrees).double().deg2rad())
    camera = good.cameras
    rotation, place = turn @ camera.rotation[0], turn @ camera.translation[0]
    return change_view(good, 0, rotation=rotation, translation=place)


@pytest.mark.parametrize("degrees", [(3.0, 0.0, 0.0), (-3.0, 2.0, 1.0)])
def test_one_of_two_cameras_is_turned(degrees: Sequence[float]) -> None:
    """So far it was late, of another size, or in other axes."""
    finding = one(examine_agreement(knocked(degrees), detections().select(PAIR)))
    assert "is turned by" in finding.what and finding.severity is Severity.ERROR
    assert finding.subject == "cameras" and finding.views == (0, 1)


def test_the_turn_is_found() -> None:
    scene = Scene(knocked((3.0, 0.0, 0.0)).cameras, detections(noise=1.0).select(PAIR))
    found = turned_camera(scene)
    assert found is not None and 2.5 < found.degrees < 3.5
    again = turned_camera(found.undo(scene))
    assert again is not None and again.degrees < 0.3


def test_other_mistakes_are_no_turn() -> None:
    seen, good = detections().select(PAIR), rig().select(PAIR)
    assert examine_agreement(good, seen) == []
    twice = with_joints(seen, lambda joints: joints[:, 0].mul_(2))
    finding = one(examine_agreement(good, twice))
    assert finding.subject == "cam1" and "2 times the calibration's size" in finding.what
