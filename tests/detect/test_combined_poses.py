"""3D poses of several networks that look at one person: whose are used, and in which axes."""

import torch
from made_up_eyes import PLACES, Eyes

from perfcap.detect.combine import Seen, combined
from perfcap.detect.crop import Crop
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16, JointSet, find_joint_set
from perfcap.detect.look import Look
from perfcap.geometry.camera import Camera

POSE = torch.randn(16, 3, generator=torch.Generator().manual_seed(0))
NO_TOES = find_joint_set("H36M-17")


def network(joint_set: JointSet = LANDMARKS16, crop_axes: bool = False) -> Eyes:
    eyes = Eyes("none", joint_set)
    eyes.manifest.output.crop_axes = crop_axes
    return eyes


def look(joint_set: JointSet, pose: bool) -> Look:
    """Of a person left of the middle of an image of 320 pixels."""
    points = torch.stack(
        [
            PLACES[LANDMARKS.index(name)] if name in LANDMARKS else PLACES.mean(0)
            for name in joint_set.joints
        ]
    )
    joints = torch.randn(len(joint_set), 3, generator=torch.Generator().manual_seed(1))
    crop = Crop.around((20, 70, 80, 170), (64, 64))
    return Look(
        crop,
        100 * points + torch.tensor([50.0, 70.0]),
        torch.ones(len(joint_set)),
        (POSE if joint_set is LANDMARKS16 else joints) if pose else None,
        None,
    )


def camera() -> Camera:
    lens = torch.tensor([[[100.0, 0, 160], [0, 100, 120], [0, 0, 1]]])
    return Camera(lens, torch.eye(3)[None], torch.zeros(1, 3))


def test_poses_in_the_axes_of_a_crop_are_turned_whoever_gives_them() -> None:
    turning = network(crop_axes=True)
    first = [Seen(look(LANDMARKS16, True), ())] * 3
    alone = combined(first, turning, camera(), (), True).joints3d
    helped = [Seen(look(LANDMARKS16, False), (look(LANDMARKS16, True),))] * 3
    plain = combined(helped, network(), camera(), (network(),), True).joints3d
    turned = combined(helped, network(), camera(), (turning,), True).joints3d
    assert alone is not None and turned is not None and plain is not None
    torch.testing.assert_close(turned, alone)
    assert (turned - plain).norm(dim=-1).max() > 0.1


def test_poses_without_all_landmarks_leave_others_theirs() -> None:
    """COCO's and H36M's joints have no toes: their poses are not used."""
    seen = [Seen(look(NO_TOES, True), (look(LANDMARKS16, True),))] * 3
    found = combined(seen, network(NO_TOES), camera(), (network(),), True)
    assert found.trusted3d.all()
    assert not combined(seen, network(NO_TOES), camera(), (), True).trusted3d.any()
    # nor does a helper without toes stand before one that has them
    order = (look(NO_TOES, True), look(LANDMARKS16, True))
    seen = [Seen(look(LANDMARKS16, False), order)] * 3
    both = network(NO_TOES), network()
    assert combined(seen, network(), camera(), both, True).trusted3d.all()
