"""Which joint moves each of a rig's bones, and which bones are clavicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

CLAVICLE = 0.04, 0.35  # m: from where one begins to the shoulder


def bone_owners(
    parents: Sequence[int],
    places: NDArray[np.float64],
    own: Mapping[int, int],
    joint_parents: Sequence[int],
) -> tuple[int, ...]:
    """Index of the joint each bone moves with, (B,).

    A bone that is no joint moves with its nearest ancestor that is one. Where there is none, it
    may hold joints, as the clavicle of a loose arm does, and moves with what they hang on; a loose
    bone that holds nothing moves with the nearest joint.

    Args:
        parents: of the bones, -1 for roots, parents first, (B,).
        places: rest positions of the bones, (B, 3).
        own: joint by bone, for the bones that are joints.
        joint_parents: of the skeleton, -1 for its root, (J,).
    """
    owner: list[int] = []
    for bone, parent in enumerate(parents):
        owner.append(own.get(bone, owner[parent] if parent >= 0 else -1))
    held = _held(parents, own)
    for bone, joint in enumerate(owner):
        if joint < 0 and bone in held:
            owner[bone] = max(joint_parents[held[bone]], 0)
        elif joint < 0:
            apart = {j: float(np.linalg.norm(places[b] - places[bone])) for b, j in own.items()}
            owner[bone] = min(apart, key=lambda j: apart[j], default=0)
    return tuple(owner)


def clavicle_bones(
    parents: Sequence[int], places: NDArray[np.float64], joints: Mapping[str, int]
) -> dict[str, int]:
    """Bones between the chest and an upper arm that carry nothing else, the first of each side.

    Args:
        parents: of the bones, -1 for roots, parents first, (B,).
        places: rest positions of the bones, (B, 3) metres, y up, left at +x.
        joints: bone by joint; of none there are no clavicles.

    Returns:
        Bones by ``l_clavicle`` and ``r_clavicle``: both or none. None where one would not reach
        sideways, or is too short or too long to be one.
    """
    found = {}
    for side, sign in (("l", 1.0), ("r", -1.0)):
        if f"{side}_shoulder" not in joints:
            return {}
        arm = {f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")}
        others = {bone for name, bone in joints.items() if name not in arm}
        held = {above for bone in others for above in (bone, *_above(parents, bone))}
        chain = []
        for bone in _above(parents, joints[f"{side}_shoulder"]):
            if bone in held:
                break
            chain.append(bone)
        if not chain or chain[-1] < 0 or parents[chain[-1]] < 0:
            return {}
        reach = places[joints[f"{side}_shoulder"]] - places[chain[-1]]
        length = float(np.linalg.norm(reach))
        if not CLAVICLE[0] < length < CLAVICLE[1] or sign * reach[0] < 0.5 * length:
            return {}
        found[f"{side}_clavicle"] = chain[-1]
    return found


def _above(parents: Sequence[int], bone: int) -> list[int]:
    """Ancestors of a bone, nearest first."""
    chain = []
    while (bone := parents[bone]) >= 0:
        chain.append(bone)
    return chain


def _held(parents: Sequence[int], own: Mapping[int, int]) -> dict[int, int]:
    """The joint nearest to the skeleton's root among those that hang on each bone."""
    first = dict(own)
    for bone in range(len(parents) - 1, -1, -1):
        parent = parents[bone]
        if bone in first and parent >= 0 and parent not in own:
            first[parent] = min(first[bone], first.get(parent, first[bone]))
    return first
