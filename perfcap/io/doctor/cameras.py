"""Checks of cameras on their own (impossible ones among them) and against their videos."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig, match_image
from perfcap.io.doctor.camera_jumps import examine_poses
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.held_poses import examine_held_poses
from perfcap.io.doctor.round_origin import examine_translations

# --- Cameras that no recording was made with, although every number in them is a number -----------

_SAME = 1e-9  # metres, and entries of a rotation: a copy, not a neighbour
_BENT = (0.3, 3.0)  # how far a lens moves the corner of the image towards or from its middle
_ASIDE = 0.5  # how far aside, by its tangential terms, at most


def impossible_cameras(rig: CameraRig) -> list[Finding]:
    """Views that are copies of one another, and lenses that bend the image out of shape."""
    return [*_copies(rig), *_lenses(rig)]


def _copies(rig: CameraRig) -> Iterator[Finding]:
    cameras = rig.cameras
    for one, other in combinations(range(cameras.views), 2):
        turned = cameras.rotation[..., one, :, :] - cameras.rotation[..., other, :, :]
        moved = cameras.translation[..., one, :] - cameras.translation[..., other, :]
        if max(float(turned.abs().max()), float(moved.abs().max())) < _SAME:
            subject = f"{rig.names[one]} and {rig.names[other]}"
            what = "have the same rotation and translation"
            remedy = "give each view its own; depth would come from nowhere"
            yield Finding(Severity.ERROR, subject, what, remedy)


def _lenses(rig: CameraRig) -> Iterator[Finding]:
    cameras = rig.cameras
    if cameras.distortion is None:
        return
    for view, (height, width) in enumerate(cameras.size):
        matrix = cameras.intrinsics[..., view, :, :].reshape(-1, 3, 3)
        k1, k2, p1, p2, k3 = cameras.distortion[..., view, :].reshape(-1, 5).unbind(-1)
        x, y = width / 2 / matrix[:, 0, 0], height / 2 / matrix[:, 1, 1]
        square = x.square() + y.square()
        factor = 1 + square * (k1 + square * (k2 + square * k3))
        worst = float(factor[(factor - 1).abs().argmax()])
        remedy = "check the coefficients and their order: k1, k2, p1, p2, k3"
        if not _BENT[0] < worst < _BENT[1]:
            what = f"its distortion moves the corners of the image to {worst:.3g} of their place"
            yield Finding(Severity.ERROR, rig.names[view], what, remedy)
        aside = 2 * x * y * torch.maximum(p1.abs(), p2.abs()) + 3 * square * (p1.abs() + p2.abs())
        shift = float((aside / square.sqrt()).max())
        if not shift < _ASIDE:
            what = f"its tangential distortion shifts the corners of the image by {shift:.0%}"
            yield Finding(Severity.ERROR, rig.names[view], what, remedy)


# --- Checks of cameras on their own and against their videos --------------------------------------

FAR = 300.0  # m; not even around a stadium. Millimetres are, or the person measures wrong
NEAR_TOGETHER = 0.01  # m
FIELD_OF_VIEW = (3.0, 140.0)  # degrees
ASIDE = 0.3  # of the image's size; calibrations of half the size have it at a quarter
SQUARE = 1.05  # ratio of the focal lengths; pixels of cameras are square to 1 %, of DV to 7


def examine_cameras(
    rig: CameraRig,
    video_sizes: Sequence[tuple[int, int]] | None = None,
    maps: dict[str, Tensor] | None = None,
    first: int = 0,
) -> list[Finding]:
    """Image sizes, units, lenses, and poses that are of no way of a moving camera.

    Args:
        rig: C views.
        video_sizes: (height, width) of their videos, if known.
        maps: from ``read_pixel_map``.
        first: number of the first pose of moving cameras, as users count frames.
    """
    findings = [Finding(Severity.INFO, "cameras", warning) for warning in rig.warnings]
    if video_sizes is not None:
        findings += _sizes(rig, video_sizes, maps)
    for view in range(len(rig.names)):
        findings += _lens(rig, view)
    ways = [*examine_poses(rig, first), *examine_translations(rig), *examine_held_poses(rig)]
    return [*findings, *impossible_cameras(rig), *_units(rig), *ways]


def _sizes(
    rig: CameraRig, video_sizes: Sequence[tuple[int, int]], maps: dict[str, Tensor] | None
) -> list[Finding]:
    if len(video_sizes) != len(rig.names):
        what = f"{len(video_sizes)} videos for {len(rig.names)} cameras"
        remedy = "give one video a camera"
        if rig.cameras.moving and len(rig.names) == 1:
            remedy += "; where COLMAP placed images of several, put those of each into a folder"
        return [Finding(Severity.ERROR, "cameras", what, remedy)]
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
    across, down = intrinsics[0, 0].item(), intrinsics[1, 1].item()
    if not 1 / SQUARE < across / down < SQUARE:
        what = f"focal lengths are {across:.4g} px across and {down:.4g} px down"
        remedy = "check that video and calibration are stretched alike; most pixels are square"
        findings.append(Finding(Severity.WARNING, rig.names[view], what, remedy))
    x, y = intrinsics[:2, 2].tolist()
    if not (ASIDE < x / width < 1 - ASIDE and ASIDE < y / height < 1 - ASIDE):
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
