"""Whether two sets of cameras, of joints and of images or masks, have the same poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch

from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import matrix_to_rotvec

_TURNED, _AWAY = 0.5, 0.03  # degrees and metres, as a refinement moves cameras at most


def pose_doubts(names: Sequence[str], cameras: Camera, others: Camera, what: str) -> Iterator[str]:
    """A sentence about each view whose two cameras stand elsewhere, or look elsewhere.

    They are of the same views in one world: lenses and sizes of images may differ, poses may not.

    Args:
        names: of the C views.
        cameras: of the joints, (C,) or (F, C).
        others: of the same views and frames, (C,) or (F, C).
        what: the others are of.
    """
    one, other = (
        each.map(torch.Tensor.detach).to(torch.zeros((), dtype=torch.float64))
        for each in (cameras, others)
    )
    turned = matrix_to_rotvec(one.rotation.mT @ other.rotation).norm(dim=-1).rad2deg()
    away = (one.centre - other.centre).norm(dim=-1)
    turned, away = (each.reshape(-1, len(names)).amax(0) for each in (turned, away))
    for name, degrees, metres in zip(names, turned.tolist(), away.tolist(), strict=True):
        if degrees > _TURNED or metres > _AWAY:
            yield (
                f"cameras of {what} of {name}: are up to {degrees:.1f} degrees and {metres:.2g} m "
                "from those of the joints; expected the same poses in one world: the same frames "
                "of a moving camera, the same order of views, world to camera"
            )
