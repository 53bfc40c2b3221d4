"""Cameras and joints that are given in Python, where no file or video says more."""

from __future__ import annotations

from dataclasses import replace

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.agreement import examine_agreement
from perfcap.io.doctor.cameras import examine_cameras
from perfcap.io.doctor.detections import examine_detections
from perfcap.io.doctor.finding import Finding


def examine_given(
    cameras: Camera, detections: Detections, *, faint: bool = True, successive: bool = True
) -> tuple[Finding, ...]:
    """Mistakes in units, axes, lenses, views and frames that numbers show.

    Args:
        cameras: C views, (C,) or (F, C); the middle of an image without a size is taken to be
            where its lens looks.
        detections: (F, C).
        faint: whether to tell that all confidences are next to nothing.
        successive: whether frames follow one another, not picked from a clip.
    """
    rig, seen = given_rig(cameras, detections)
    return (
        *examine_cameras(rig),
        *examine_detections(rig, seen, coverage=False, faint=faint, successive=successive),
        *examine_agreement(rig, seen, successive=successive),
    )


def examine_images(cameras: Camera, detections: Detections) -> tuple[Finding, ...]:
    """What joints of many images show together, where each alone shows too little.

    Units, lenses and sizes of images show in each.

    Args:
        cameras: C views, (C,) of all images, or (F, C).
        detections: (F, C), in any order.
    """
    rig, seen = given_rig(cameras, detections)
    known = {"faint": False, "detected": True, "successive": False}
    return (
        *examine_detections(rig, seen, coverage=False, **known),
        *examine_agreement(rig, seen, successive=False),
    )


def given_rig(cameras: Camera, detections: Detections) -> tuple[CameraRig, Detections]:
    """Views with numbers for names, and what they see, without gradients."""
    known = cameras.map(lambda part: part.detach().double().cpu())
    seen = detections.to(known.intrinsics).map(lambda part: part.detach())
    middles = known.intrinsics[..., :2, 2].reshape(-1, known.views, 2)[0]
    sizes = tuple((round(2 * y) + 1, round(2 * x) + 1) for x, y in middles.tolist())
    names = tuple(f"view {view}" for view in range(known.views))
    return CameraRig(names, replace(known, size=known.size or sizes)), seen
