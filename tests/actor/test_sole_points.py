"""Points under the feet: where they lie, and that they move with the foot."""

import torch
from synthetic import actor, random_motion

from perfcap.actor.sole_points import sole_skeleton
from perfcap.io.actor import load_actor


def test_soles_of_a_shipped_actor() -> None:
    person = load_actor("sam")
    soles = sole_skeleton(person).rest_landmarks[-8:].reshape(2, 4, 3)
    left, right = soles
    lowest = float(person.vertices[:, 1].min())
    assert (soles[..., 1] - lowest).abs().max() < 0.01
    assert (left[:, 0] > 0).all() and (right[:, 0] < 0).all()
    heel, inner, outer, tip = left
    assert 0.2 < float(tip[2] - heel[2]) < 0.35  # metres, a shoe's length
    assert heel[0] > inner[0] and outer[0] > inner[0] + 0.05
    torch.testing.assert_close(left * left.new_tensor([-1, 1, 1]), right, atol=0.01, rtol=0)


def test_points_are_rigid_with_the_ankle() -> None:
    person = actor()
    skeleton, motion = sole_skeleton(person), random_motion(person.skeleton, 4)
    points = skeleton(motion).landmarks
    torch.testing.assert_close(points[:, :16], person.joints(motion))
    rest = skeleton.rest_landmarks[-8:-4]
    moved = points[:, -8:-4]
    torch.testing.assert_close(
        torch.cdist(moved, moved), torch.cdist(rest, rest).expand(4, 4, 4), atol=1e-6, rtol=0
    )
