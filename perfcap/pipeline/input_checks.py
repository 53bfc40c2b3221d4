"""Whether what a capture is given is of the right kind and belongs together; else it is refused."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.detect.joint_checks import require_joints
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.camera_checks import require_usable
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
