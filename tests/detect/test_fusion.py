"""Several networks' landmarks as one person's."""

import torch

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.pose_fusion import TRUST, Landmarks, exchanged, fuse, sides_differ

SIZE = torch.tensor([100.0, 100.0, 100.0])
ORDER = list(LANDMARKS16.mirrored())


def body(confidence: float) -> Landmarks:
    generator = torch.Generator().manual_seed(3)
    points = 100 * torch.rand(3, 16, 2, generator=generator)
    return Landmarks(points, torch.full((3, 16), confidence))


def test_what_one_network_lacks_comes_from_another() -> None:
    first, other = body(0.8), body(0.4)
    toes = [LANDMARKS.index(name) for name in ("r_toe", "l_toe")]
    first.confidence[:, toes] = 0
    lost = Landmarks(first.joints2d.clone(), first.confidence)
    lost.joints2d[:, toes] = 0
    found = fuse(lost, [other], SIZE)
    torch.testing.assert_close(found.joints2d, other.joints2d)
    torch.testing.assert_close(found.confidence[:, toes], torch.full((3, 2), TRUST * 0.4))
    assert (found.confidence[:, 2:8] == 0.8).all()


def test_near_places_are_averaged_and_far_ones_taken_from_the_surer() -> None:
    first, other = body(0.5), body(0.25 / TRUST)
    other.joints2d[:, 4] += torch.tensor([3.0, 0.0]) * 0.9  # within 3 % of the size
    other.joints2d[:, 7] += 30.0
    other.joints2d[:, 10] += 30.0
    other.confidence[:, 10] = 0.9
    moved = fuse(first, [other], SIZE).joints2d - first.joints2d
    torch.testing.assert_close(moved[:, 4], torch.tensor([[0.9, 0.0]]).expand(3, 2))
    assert (moved[:, 7] == 0).all()
    torch.testing.assert_close(moved[:, 10], torch.full((3, 2), 30.0))


def test_sides_are_those_of_the_first_network() -> None:
    first, other = body(0.6), body(0.3)
    other.joints2d[1] = other.joints2d[1, ORDER]
    assert exchanged(other, first, SIZE).tolist() == [False, True, False]
    torch.testing.assert_close(fuse(first, [other], SIZE).joints2d, first.joints2d)


def test_networks_that_differ_in_sides_throughout_are_told_apart() -> None:
    first = body(0.6)
    first = Landmarks(first.joints2d.repeat(4, 1, 1), first.confidence.repeat(4, 1))
    size = torch.full((12,), 100.0)
    other = Landmarks(first.joints2d[:, ORDER], first.confidence)
    assert sides_differ(other, first, size) and not sides_differ(first, first, size)
    other.joints2d[:4] = first.joints2d[:4]  # a person who turns away in the others
    assert not sides_differ(other, first, size)
    few = [Landmarks(each.joints2d[:9], each.confidence[:9]) for each in (other, first)]
    assert not sides_differ(*few, size[:9])


def test_a_network_that_saw_nobody_changes_nothing() -> None:
    first = body(0.6)
    nothing = Landmarks(torch.zeros(3, 16, 2), torch.zeros(3, 16))
    found = fuse(first, [nothing, nothing], SIZE)
    assert torch.equal(found.joints2d, first.joints2d)
    assert torch.equal(found.confidence, first.confidence)
