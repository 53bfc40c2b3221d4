"""Who moves whom."""

import numpy as np

from perfcap.actor.bone_owners import bone_owners


def test_bones_move_with_what_is_above_them() -> None:
    # root - pelvis(joint 0) - belly - chest(joint 1) - collar - arm(joint 2) - finger
    parents = [-1, 0, 1, 2, 3, 4, 5]
    places = np.zeros((7, 3))
    assert bone_owners(parents, places, {1: 0, 3: 1, 5: 2}, [-1, 0, 1]) == (0, 0, 0, 1, 1, 2, 2)


def test_a_loose_clavicle_moves_with_the_chest() -> None:
    parents = [-1, 0, -1, 2]  # pelvis - chest, and collar - arm
    assert bone_owners(parents, np.zeros((4, 3)), {0: 0, 1: 1, 3: 2}, [-1, 0, 1]) == (0, 1, 1, 2)


def test_a_loose_bone_moves_with_the_nearest_joint() -> None:
    places = np.array([[0.0, 0, 0], [0, 1, 0], [0, 0.9, 0]])
    assert bone_owners([-1, 0, -1], places, {0: 0, 1: 1}, [-1, 0]) == (0, 1, 1)
