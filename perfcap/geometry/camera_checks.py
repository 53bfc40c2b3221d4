"""Whether cameras are some; else they are refused."""

from __future__ import annotations

import torch

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

_MIXED = 0.5  # of the focal lengths: at 1 a lens may have no inverse
_LENSES = 1e-3, 1e9  # px
_LAST_ROW = 1e-4
_WORLD = 1000.0  # m, from the origin
_SKEWED = 0.05  # of a rotation's rows; low precision leaves a hundredth


def require_usable(what: str, cameras: Camera, frames: int) -> None:
    """Refuse cameras without a lens, or moving (F, C) but not one a frame; ``what`` names them.

    Raises:
        InputError: a focal length is not above zero, the last row of intrinsics is not 0 0 1, a
            number is not finite, a translation is beyond a kilometre, a rotation is none, there are
            more or fewer poses, or image sizes that are not one pair a view.
    """
    _require_sizes(what, cameras)
    require_lenses(what, cameras)
    if cameras.moving and len(cameras.intrinsics) != frames:
        raise InputError(
            f"moving {what} have {len(cameras.intrinsics)} frames but the clip has {frames}; give "
            "as many poses as frames"
        )


def require_lenses(what: str, cameras: Camera) -> None:
    """Refuse cameras (..., C) without a lens or a pose; ``what`` names them.

    Raises:
        InputError: a focal length is not above zero, the last row of intrinsics is not 0 0 1, a
            number is not finite, a translation is beyond a kilometre, or a rotation is none.
    """
    parts = (cameras.intrinsics, cameras.rotation, cameras.translation)
    if not all(part.is_floating_point() for part in parts):
        kinds = ", ".join(str(part.dtype) for part in parts)
        raise InputError(
            f"{what} have intrinsics, rotation, translation of {kinds}; expected "
            "floating-point numbers"
        )
    last = cameras.intrinsics[..., 2, :].detach().double()
    if not bool(((last - last.new_tensor([0.0, 0.0, 1.0])).abs() < _LAST_ROW).all()):
        raise InputError(
            f"{what} have intrinsics with a last row of {last.reshape(-1, 3)[0].tolist()}, "
            "expected 0 0 1: divide them by intrinsics[..., 2, 2], and look whether they are "
            "transposed"
        )
    focal = cameras.intrinsics[..., :2, :2].diagonal(dim1=-2, dim2=-1)
    if not bool(((focal > _LENSES[0]) & (focal < _LENSES[1])).all()):
        raise InputError(
            f"{what} have focal lengths of {focal.flatten().tolist()[:8]} px, expected numbers "
            "above zero in intrinsics[..., 0, 0] and [..., 1, 1], of cameras that look along +z"
        )
    given = (cameras.intrinsics, cameras.translation, cameras.distortion)
    if not all(bool(part.isfinite().all()) for part in given if part is not None):
        raise InputError(
            f"{what} have numbers that are not finite in intrinsics, translation or distortion; "
            "calibrate again, or leave these views out"
        )
    farthest = float(cameras.translation.detach().abs().max())
    if farthest > _WORLD:
        raise InputError(
            f"{what} have translations of up to {farthest:.3g}, expected metres from an origin "
            "near the person: divide millimetres by 1000"
        )
    lens = cameras.intrinsics[..., :2, :2].detach().double()
    skew = torch.stack((lens[..., 0, 1], lens[..., 1, 0])).abs().amax(0)
    least = lens.diagonal(dim1=-2, dim2=-1).abs().amin(-1)
    if not bool((skew <= _MIXED * least).all()):
        numbers = lens.flatten().tolist()[:4]
        raise InputError(
            f"{what} have intrinsics[..., :2, :2] that mix x and y ({numbers}); expected "
            "focal lengths on the diagonal, and a skew of 0"
        )
    turns = cameras.rotation.detach().double()
    skewed = (turns @ turns.mT - torch.eye(3).to(turns)).abs().amax()
    if not bool((skewed < _SKEWED) & (torch.linalg.det(turns) > 0).all()):
        raise InputError(
            f"{what} have a rotation that is none (rows off a right angle or unit length by up to "
            f"{float(skewed):.2g}, or a mirror image); expected world to camera, OpenCV axes"
        )


def _require_sizes(what: str, cameras: Camera) -> None:
    pairs = isinstance(cameras.size, tuple | list) and all(
        isinstance(each, tuple | list) and len(each) == 2 for each in cameras.size
    )
    if not pairs or len(cameras.size) not in (0, cameras.views):
        raise InputError(
            f"{what} have image sizes {cameras.size!r:.80} for {cameras.views} views; expected "
            "(height, width) of each, ((720, 1280), ...), or ()"
        )
