"""Which triangles of an actor belong to which limb."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.actor import Actor

TRUNK = 0
_ARM = ("shoulder", "elbow", "wrist")
_LIMBS = (("l", True), ("r", True), ("l", False), ("r", False))  # side, arm; numbered from 1


def limb_of_triangles(actor: Actor) -> NDArray[np.int64]:
    """Trunk and head 0, left and right arm 1 and 2, left and right leg 3 and 4, by triangle, (T,).

    A vertex belongs to the limb of the joint that moves it most, a triangle to that of two of its
    vertices; where all three differ, to the one numbered in between.
    """
    heaviest = actor.skin.rows()[2].cpu().numpy()
    of_joint = np.array([_limb(joint) for joint in actor.skeleton.rig.joints])
    corners = of_joint[heaviest][actor.template.faces]
    limbs: NDArray[np.int64] = np.sort(corners, 1)[:, 1]
    return limbs


def _limb(joint: str) -> int:
    side, _, name = joint.partition("_")
    limb = (side, name in _ARM)
    return _LIMBS.index(limb) + 1 if name and limb in _LIMBS else TRUNK
