"""Checks of cameras on their own and against their videos."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig, match_image
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.impossible import impossible_cameras

FAR = 100.0  # m; cameras of one capture are never this far apart, millimetres always are
NEAR_TOGETHER = 0.01  # m
FIELD_OF_VIEW = (3.0, 140.0)  # degrees


def examine_cameras(
    rig: CameraRig,
    video_sizes: Sequence[tuple[int, int]] | None = None,
    maps: dict[str, Tensor] | None = None,
) -> list[Finding]:
    """Image sizes, units, lenses.

    Args:
        rig: C views.
        video_sizes: (height, width) of their videos, if known.
        maps: from ``read_pixel_map``.
    """
    findings = [Finding(Severity.INFO, "cameras", warning) for warning in rig.warnings]
    if video_sizes is not None:
        findings += _sizes(rig, video_sizes, maps)
    for view in range(len(rig.names)):
        findings += _lens(rig, view)
    return [*findings, *impossible_cameras(rig), *_units(rig)]


def _sizes(
    rig: CameraRig, video_sizes: Sequence[tuple[int, int]], maps: dict[str, Tensor] | None
) -> list[Finding]:
    if len(video_sizes) != len(rig.names):
        what = f"{len(video_sizes)} videos for {len(rig.names)} cameras"
        return [Finding(Severity.ERROR, "cameras", what, "give one video a camera")]
    findings = []
    for view, size in enumerate(video_sizes):
        try:
            match_image(rig.select([view]), [size], maps)
        except InputError as error:
            what, _, remedy = str(error).removeprefix(f"view {rig.names[view]}: ").partition("; ")
            findings.append(Finding(Severity.ERROR, rig.names[view], what, remedy))
    return findings


def _lens(rig: CameraRig, view: int) -> list[Finding]:
    """Focal length and principal point against the image."""
    intrinsics = rig.cameras.intrinsics[..., view, :, :].reshape(-1, 3, 3)[0]
    height, width = rig.cameras.size[view]
    findings = []
    angle = math.degrees(2 * math.atan(width / 2 / float(intrinsics[0, 0])))
    if not FIELD_OF_VIEW[0] < angle < FIELD_OF_VIEW[1]:
        what = f"focal length {intrinsics[0, 0]:.4g} px is a field of view of {angle:.1f} degrees"
        remedy = "the focal length must be in pixels of this image size, not millimetres"
        findings.append(Finding(Severity.ERROR, rig.names[view], what, remedy))
    x, y = intrinsics[:2, 2].tolist()
    if not (0.2 * width < x < 0.8 * width and 0.2 * height < y < 0.8 * height):
        what = f"principal point ({x:.0f}, {y:.0f}) is far from the middle of {width}x{height}"
        remedy = "check that calibration and video have the same size, orientation and crop"
        findings.append(Finding(Severity.WARNING, rig.names[view], what, remedy))
    return findings


def _units(rig: CameraRig) -> list[Finding]:
    centres = rig.cameras.centre
    centres = centres.reshape(-1, *centres.shape[-2:])[0]  # C 3
    if len(centres) < 2:
        distance = float(rig.cameras.translation.norm(dim=-1).max())
        if distance > FAR:
            what = f"translation is {distance:.0f} m long, which looks like millimetres"
            return [Finding(Severity.WARNING, "cameras", what, "convert translations to metres")]
        return []
    apart = torch.pdist(centres)
    if float(apart.max()) > FAR:
        what = f"stand up to {apart.max():.0f} m apart, which looks like millimetres"
        return [Finding(Severity.ERROR, "cameras", what, "convert translations to metres")]
    if float(apart.min()) < NEAR_TOGETHER:
        pairs = torch.combinations(torch.arange(len(centres)))  # in the order of pdist
        subject = " and ".join(rig.names[int(view)] for view in pairs[apart.argmin()])
        what = f"stand at the same place ({apart.min() * 1000:.1f} mm apart)"
        remedy = "check that extrinsics differ and are in metres; depth cannot come from such views"
        return [Finding(Severity.WARNING, subject, what, remedy)]
    return []
