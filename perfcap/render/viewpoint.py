"""Cameras placed by hand."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.errors import InputError


def look_at(eye: Tensor, target: Tensor, up: Tensor) -> tuple[Tensor, Tensor]:
    """World-to-camera motion of a camera at ``eye`` that looks at ``target``.

    Camera axes are OpenCV's: x right, y down, z forward; ``up`` appears upwards in the image.

    Args:
        eye: optical centre in the world, (*b, 3) m.
        target: point that is seen in the middle of the image, (*b, 3) m.
        up: any vector not along the line of sight, (*b, 3); the three shapes broadcast.

    Returns:
        Rotation (*b, 3, 3) and translation (*b, 3) that take world points to camera axes.

    Raises:
        InputError: eye and target coincide, or up is along the line of sight.
    """
    eye, target, up = torch.broadcast_tensors(eye, target, up)  # type: ignore[no-untyped-call]
    forward = target - eye
    right = torch.linalg.cross(forward, up)
    # relative to the lengths, so that neither far targets nor short up vectors pass unnoticed
    lean = right.norm(dim=-1) / (forward.norm(dim=-1) * up.norm(dim=-1))
    if not bool((lean > 1e-6).all()):
        raise InputError(
            "up is along the line of sight, or eye and target coincide; expected an up vector "
            "across the view and two different points"
        )
    forward = torch.nn.functional.normalize(forward, dim=-1)
    right = torch.nn.functional.normalize(right, dim=-1)
    down = torch.linalg.cross(forward, right)
    rotation = torch.stack([right, down, forward], -2)
    return rotation, -(rotation @ eye[..., None]).squeeze(-1)
