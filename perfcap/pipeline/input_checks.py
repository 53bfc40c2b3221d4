"""Whether what a capture is given is of the right kind and belongs together; else it is refused."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig
from perfcap.io.clip import END_SLACK
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.images import Images
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.stage import Stage

# --- Arguments of the right kind, by name and with what to give -----------------------------------

_KINDS: dict[str, tuple[type, str]] = {
    "actor": (Actor, "load_actor makes one of a name or a file"),
    "cameras": (Camera, "read_cameras gives a CameraRig, whose cameras are one"),
    "detections": (Detections, "read_detections gives them and notes, Detections.from_joints both"),
    "config": (
        CaptureConfig,
        "MONOPERFCAP is one, and perfcap.pipeline.PRESETS has others by name",
    ),
    "until": (Stage, "such as Stage.TRACK_MOTION"),
    "images": (Images, "Images(clip, cameras) makes them of a Clip"),
    "checkpoint": (Checkpoint, "it keeps work in a folder"),
}
_LEFT_OUT = ("config", "until", "images", "checkpoint")


def require_kinds(**given: object) -> None:
    """Refuse arguments of ``capture`` that are something else.

    Raises:
        InputError: one is; those that may be left out may be None.
    """
    for name, value in given.items():
        kind, hint = _KINDS[name]
        if not isinstance(value, kind) and not (value is None and name in _LEFT_OUT):
            raise _another(name, value, kind.__name__, hint)


def require_flags(**given: object) -> None:
    """Refuse what is neither true nor false: a word would be true.

    Raises:
        InputError: one is.
    """
    for name, value in given.items():
        if not isinstance(value, bool):
            raise InputError(f"{name} is {value!r:.80}, expected True or False")


def require_cameras(cameras: object) -> None:
    """Refuse a rig where its cameras are expected, and what is no sequence of them.

    Raises:
        InputError: they are something else.
    """
    several = cameras if isinstance(cameras, list | tuple) else [cameras]
    for each in several:
        if not isinstance(each, Camera):
            raise _another("cameras", each, "Camera, or a list of them", _KINDS["cameras"][1])


def _another(name: str, value: object, kind: str, hint: str) -> InputError:
    found = "a CameraRig" if isinstance(value, CameraRig) else f"a {type(value).__name__}"
    return InputError(f"{name}: got {found}, expected {kind}: {hint}")


# --- Joints, cameras and images that belong together ----------------------------------------------

_NORMALISED = 2.0  # pixels: nobody is so small
_MIXED = 0.5  # of the focal lengths: at 1 a lens may have no inverse
_LENSES = 1e-3, 1e9  # px
_LAST_ROW = 1e-4
_ROUNDING = 1e-3
_WORLD = 1000.0  # m, from the origin
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
    require_joints(detections)
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


def require_joints(detections: Detections) -> None:
    """Refuse 2D joints that are no pixels; those that are not finite count as unseen.

    Raises:
        InputError: all joints lie within two pixels, or a confidence is below 0 or above 1.
    """
    require_shares(detections.confidence2d)
    seen = detections.joints2d[detections.confidence2d > 0]
    if len(seen) and bool((seen.abs() <= _NORMALISED).all()):
        raise InputError(
            f"detections have joints2d of {float(seen.abs().max()):.3g} at most, expected pixels; "
            "multiply normalised joints by the size of the image"
        )


def require_shares(confidence: Tensor) -> None:
    """Refuse confidences of any shape that are not from 0 to 1; some may be no numbers.

    Raises:
        InputError: they are not.
    """
    if bool(((confidence < -_ROUNDING) | (confidence > 1 + _ROUNDING)).any()):
        found = confidence[~confidence.isnan()]
        raise InputError(
            f"confidences are {float(found.min()):.3g} to {float(found.max()):.3g}, expected 0 to "
            "1: divide percents by 100, and take the sigmoid of logits"
        )


def require_usable(what: str, cameras: Camera, frames: int) -> None:
    """Refuse cameras without a lens, or moving (F, C) but not one a frame; ``what`` names them.

    Raises:
        InputError: a focal length is not above zero, the last row of intrinsics is not 0 0 1, a
            number is not finite, a translation is beyond a kilometre, a rotation is none, there are
            more or fewer poses, or image sizes that are not one pair a view.
    """
    _require_sizes(what, cameras)
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
    if cameras.moving and len(cameras.intrinsics) != frames:
        raise InputError(
            f"moving {what} have {len(cameras.intrinsics)} frames but the clip has {frames}; give "
            "as many poses as frames"
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


def _require_cameras(what: str, cameras: Camera, detections: Detections) -> None:
    frames, views = detections.frame_count, detections.views
    if cameras.views != views:
        raise InputError(
            f"{what} are of {cameras.views} views, detections of {views}; give one camera a view, "
            "in the same order"
        )
    require_usable(what, cameras, frames)


def require_trust(trust: Tensor | None, masks: Tensor) -> None:
    """Refuse what is no weight of the pixels of masks (F, C, H, W); None is one.

    Raises:
        InputError: another shape, above 1, or 0 everywhere.
    """
    if trust is None:
        return
    if not isinstance(trust, Tensor):
        raise InputError(f"trust is a {type(trust).__name__}, expected a tensor such as the masks")
    try:
        trust.expand(masks.shape)
    except RuntimeError:
        raise InputError(
            f"trust has shape {tuple(trust.shape)}; expected one that broadcasts to that of the "
            f"masks, {tuple(masks.shape)}"
        ) from None
    if not bool((trust.detach() != 0).any()):
        raise InputError(
            "trust is 0 everywhere, so that no mask counts; expected 1 for a sure pixel"
        )
    most = float(trust.detach().max()) if trust.numel() else 0.0
    if trust.is_floating_point() and most > 1:
        raise InputError(f"trust is up to {most:.4g}; expected 0 to 1, the weight of a pixel")
