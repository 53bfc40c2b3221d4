"""How large people are in images, however they or the cameras are turned."""

from __future__ import annotations

import torch
from torch import Tensor


def end_to_end(joints: Tensor, seen: Tensor) -> Tensor:
    """The longest distance between two joints that are seen, (*b); 0 where fewer than two are.

    Of somebody who stands it is about their height in the image, and it is the same of those who
    lie and of cameras on their sides. No gradient passes.

    Args:
        joints: (*b, J, D); anything where they are not seen.
        seen: (*b, J), bool.
    """
    joints = joints.detach()
    longest = joints.new_zeros(seen.shape[:-1])
    for joint in range(1, seen.shape[-1]):  # all pairs at once take 16 times the memory
        away = (joints[..., :joint, :] - joints[..., joint, None, :]).norm(dim=-1)
        both = seen[..., :joint] & seen[..., joint, None]
        longest = torch.maximum(longest, away.where(both, 0.0).amax(-1))
    return longest
