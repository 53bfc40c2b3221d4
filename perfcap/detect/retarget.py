"""Give predicted 3D joints the bone lengths of an actor."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS

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
