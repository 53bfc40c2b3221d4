"""Whether what a capture is given belongs together."""

from __future__ import annotations

import torch

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.clip import END_SLACK
from perfcap.pipeline.images import Images

_NORMALISED = 2.0  # pixels: nobody is so small
_MIXED = 0.5  # of the focal lengths: at 1 a lens may have no inverse
_LENSES = 1e-3, 1e9  # px
_SKEWED = 0.05  # of a rotation's rows; low precision leaves a hundredth


def require_matching(cameras: Camera, detections: Detections, images: Images | None) -> None:
    """Refuse what would be taken frame by frame, or view by view, for what it is not.

    Args:
        cameras: expected as (C,) or (F, C).
        detections: expected as (F, C).
        images: of as many frames and views, or none; decoders count up to five frames more.

    Raises:
        InputError: detections are of several clips, cameras or images of other views or frames
            than the detections, or there are none.
    """
    shape = tuple(detections.joints2d.shape)
    if len(shape) != 4:
        raise InputError(
            f"detections have joints2d {shape}, expected one clip, (F, C, 16, 2); capture one clip "
            "at a time, or use PoseRefiner for batches"
        )
    kind = detections.joints2d.dtype
    if kind not in (torch.float32, torch.float64):
        raise InputError(f"detections have joints2d of {kind}, expected float32 or float64")
    if 0 in shape[:2]:
        raise InputError(
            f"detections have joints2d {shape}: no frame or no view; expected one at least of each"
        )
    _require_pixels(detections)
    _require_cameras("cameras", cameras, detections)
    if images is None:
        return
    _require_cameras("cameras of the images", images.cameras, detections)
    count = len(images.reader)
    if not 0 <= count - shape[0] <= END_SLACK:
        raise InputError(
            f"images are {count} frames, detections {shape[0]}; give those that were detected in "
            "(Images.frames takes a part)"
        )


def _require_pixels(detections: Detections) -> None:
    seen = detections.joints2d[detections.confidence2d > 0]
    if len(seen) and bool((seen.abs() <= _NORMALISED).all()):
        raise InputError(
            f"detections have joints2d of {float(seen.abs().max()):.3g} at most, expected pixels; "
            "multiply normalised joints by the size of the image"
        )


def require_usable(what: str, cameras: Camera, frames: int) -> None:
    """Refuse cameras without a lens, or moving (F, C) but not one a frame; ``what`` names them.

    Raises:
        InputError: a focal length is zero or no number, a rotation is none, or there are more or
            fewer poses.
    """
    parts = (cameras.intrinsics, cameras.rotation, cameras.translation)
    if not all(part.is_floating_point() for part in parts):
        kinds = ", ".join(str(part.dtype) for part in parts)
        raise InputError(
            f"{what} have intrinsics, rotation, translation of {kinds}; expected "
            "floating-point numbers"
        )
    focal = cameras.intrinsics[..., :2, :2].diagonal(dim1=-2, dim2=-1)
    if not bool(((focal.abs() > _LENSES[0]) & (focal.abs() < _LENSES[1])).all()):
        raise InputError(
            f"{what} have focal lengths of {focal.flatten().tolist()[:8]} px, expected numbers "
            "other than zero in intrinsics[..., 0, 0] and [..., 1, 1]"
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
    if cameras.moving and len(cameras.intrinsics) != frames:
        raise InputError(
            f"moving {what} have {len(cameras.intrinsics)} frames but the clip has {frames}; give "
            "as many poses as frames"
        )


def _require_cameras(what: str, cameras: Camera, detections: Detections) -> None:
    frames, views = detections.frame_count, detections.views
    if cameras.views != views:
        raise InputError(
            f"{what} are of {cameras.views} views, detections of {views}; give one camera a view, "
            "in the same order"
        )
    require_usable(what, cameras, frames)
