"""Give predicted 3D joints the bone lengths of an actor."""

from __future__ import annotations

from collections.abc import Collection

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16

# The tree in which bones are laid end to end; the root is the middle of the hips.
_ROOT = -1
PARENTS = (1, _ROOT, 1, 2, 3, 1, 5, 6, _ROOT, 8, 9, 10, _ROOT, 12, 13, 14)
_HIPS = (LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip"))
_ORDER = (8, 12, 1, 0, 2, 5, 3, 6, 9, 13, 4, 7, 10, 14, 11, 15)  # parents first


def mid_hip(landmarks: Tensor) -> Tensor:
    """The root (..., 3) of landmarks (..., 16, 3)."""
    return 0.5 * (landmarks[..., _HIPS[0], :] + landmarks[..., _HIPS[1], :])


def bone_vectors(landmarks: Tensor) -> Tensor:
    """Vector to each landmark from its parent, (..., 16, 3)."""
    extended = torch.cat((landmarks, mid_hip(landmarks).unsqueeze(-2)), -2)
    return landmarks - extended[..., list(PARENTS), :]


def bone_chains() -> Tensor:
    """Which bones lead from the middle of the hips to each landmark, (16, 16), ones and zeros.

    It undoes ``bone_vectors``: chains @ bones are landmarks relative to the middle of the hips.
    """
    chains = torch.eye(len(PARENTS), dtype=torch.float64)
    for joint in _ORDER:
        if PARENTS[joint] != _ROOT:
            chains[joint] += chains[PARENTS[joint]]
    return chains


def retarget(joints3d: Tensor, lengths: Tensor) -> Tensor:
    """Predicted directions with an actor's lengths (Xu et al. 2018: "rescaled to the actor").

    A network predicts an average skeleton; its bone directions carry the pose. Every bone keeps
    its direction and takes its length from the actor, so that no constant disagreement pulls on
    the motion. The result is relative to the middle of the hips.

    Args:
        joints3d: root-relative predictions, (..., 16, 3), any length unit.
        lengths: bone lengths of the actor, (..., 16), metres: norms of ``bone_vectors``.
    """
    return laid_out(bone_vectors(joints3d), lengths)


def laid_out(vectors: Tensor, lengths: Tensor) -> Tensor:
    """Bones (..., 16, 3) of these lengths (..., 16) end to end, from the middle of the hips."""
    norm = vectors.norm(dim=-1, keepdim=True)
    scaled = vectors * (lengths[..., None] / norm.clamp(min=1e-6))
    placed: Tensor = bone_chains().to(scaled) @ scaled
    return placed


# --- Landmarks that a joint set lacks -------------------------------------------------------------

_SHORT = 1e-6  # a vector of no length has no direction
_STRAIGHT = 1e-6  # squared sine of a bend: 0.3 mm at an elbow
_KNEES = (LANDMARKS.index("r_knee"), LANDMARKS.index("l_knee"))  # bend forwards, others backwards
_SHOULDERS = (LANDMARKS.index("r_shoulder"), LANDMARKS.index("l_shoulder"))
_NECK, _CROWN = LANDMARKS.index("neck"), LANDMARKS.index("head_top")


def filled(joints3d: Tensor, lengths: Tensor, missing: Collection[str]) -> Tensor:
    """Poses with the landmarks that a joint set lacks, where bones of these lengths may have them.

    Between joints that are given it bends as far as it must for the next of them to be where it
    is given: laid end to end, bones then lead there. Beyond them limbs go on straight. It says
    nothing about the landmark itself, which is to count for nothing.

    Args:
        joints3d: (..., 16, 3), any length unit; of missing ones anything finite.
        lengths: bone lengths of the actor, (16,), metres: norms of ``bone_vectors``.
        missing: names of landmarks; not of the hips, the shoulders or the neck.
    """
    lost = {LANDMARKS.index(name) for name in missing}
    if not lost:
        return joints3d
    places, root = list(joints3d.unbind(-2)), mid_hip(joints3d)
    lengths = _lengths(joints3d, lengths, lost)
    up = _unit(places[_NECK] - root)
    left = sum(places[pair[1]] - places[pair[0]] for pair in (_HIPS, _SHOULDERS))
    ahead = torch.linalg.cross(torch.as_tensor(left), up)
    for joint in (each for each in _ORDER if each in lost):
        start = places[PARENTS[joint]]
        chain = _to_known(joint, lost)
        if chain:
            reach = lengths[..., joint, None], lengths[..., chain].sum(-1, keepdim=True)
            bend = ahead if joint in _KNEES else -ahead
            places[joint] = start + _bent(places[chain[-1]] - start, bend, *reach)
            continue
        before = PARENTS[PARENTS[joint]]
        along = up if joint == _CROWN else -up
        if joint != _CROWN and PARENTS[joint] not in (*_HIPS, *_SHOULDERS):
            along = _unit(start - places[before])
        places[joint] = start + lengths[..., joint, None] * along
    return torch.stack(places, -2)


def _lengths(joints3d: Tensor, lengths: Tensor, lost: Collection[int]) -> Tensor:
    """Bone lengths of poses, (..., 16): of those that lack an end, of the other side, or the actor.

    Networks know average people, whose bones are in other proportions than the actor's.
    """
    known = [j for j in range(len(PARENTS)) if j not in lost and PARENTS[j] not in lost]
    found = bone_vectors(joints3d).norm(dim=-1).detach()
    share = found[..., known].sum(-1, keepdim=True) / lengths[known].sum()
    own = list((share * lengths).unbind(-1))
    for joint, other in enumerate(LANDMARKS16.mirrored()):
        own[joint] = found[..., other] if other in known else own[joint]
    return torch.stack(own, -1)


def _to_known(joint: int, lost: Collection[int]) -> list[int]:
    """The bones from a lost joint to the first one beyond it that is given; none without one."""
    chain: list[int] = []
    while joint in PARENTS:
        joint = PARENTS.index(joint)
        chain.append(joint)
        if joint not in lost:
            return chain
    return []


def _bent(across: Tensor, bend: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """The middle of two bones of lengths (..., 1) that lead across, (..., 3), towards a side."""
    along = _unit(across)
    away, first = across.norm(dim=-1, keepdim=True).clamp(min=_SHORT), first.clamp(min=_SHORT)
    share = ((away.square() + first.square() - second.square()) / (2 * away * first)).clamp(-1, 1)
    side = _unit(bend - (bend * along).sum(-1, keepdim=True) * along)
    # the floor keeps the derivative of the root small where bones are straight
    middle: Tensor = first * (
        share * along + (1 - share.square()).clamp(min=_STRAIGHT).sqrt() * side
    )
    return middle


def _unit(vector: Tensor) -> Tensor:
    """Vectors of length one, (..., 3); of none, where there is none."""
    unit: Tensor = vector / vector.norm(dim=-1, keepdim=True).clamp(min=_SHORT)
    return unit
