"""Whether 3D joints that say where a person is fit their images, and those of other views."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import torch
from torch import Tensor

from perfcap.detect.detections import Detections, extents
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.geometry.triangulation import triangulate
from perfcap.io.doctor.detections import CONFIDENT
from perfcap.io.doctor.finding import ranges
from perfcap.pipeline.input_doubts import agreement_doubts
from perfcap.pipeline.pose_estimate import ClipEstimate

_AT_ROOT, _IN_FRONT = 0.2, 0.2  # m from a camera: hips that are none's place, and joints' depth
_FEWEST_JOINTS, _FEWEST = 6, 3  # of a frame, and frames
# 57 views of ten recorded people whose joints are 0 to 10 cm off have medians of 0.976 to 1.04 and
# quarters of 0.91 and 1.08, and lie 0.02 of the size beside; distances are off by 0.013 at most
_LARGER, _BESIDE = (0.92, 1.08), 0.08
_WAVERS, _QUARTERS = (0.86, 1.16), (0.25, 0.5, 0.75)
_FARTHER = 0.04
_APART, _LASTING = 0.2, 8  # m from the mean of views, twice what errors of 10 cm leave; frames
_LEAST, _NOISE, _SECOND = 0.06, 2.0, math.sqrt(6.0)  # m, times jitter, and that of differences
_FITS, _BETTER = 0.3, 0.4  # m from the mean of views, and of that as they are given
_CROSSING = 0.35  # sine of the angle between lines of sight that meet in a place
_REMEDY = (
    "give 2D joints as well and leave placed=False, so that images say where the person is; else "
    "check unit and focal length of what placed them"
)


def placed_doubts(clip: ClipEstimate) -> tuple[str, ...]:
    """Sentences about 3D joints that are placed in front of their cameras, with 2D ones or none."""
    kind = torch.zeros((), dtype=torch.float64)
    cameras = clip.cameras.map(Tensor.detach).to(kind)
    detections = clip.detections.map(Tensor.detach).to(kind)
    local, certain = detections.joints3d, clip.certain.detach().to(kind)
    assert local is not None
    certain = torch.where(local.isfinite().all(-1), certain, 0)
    if _median(mid_hip(local).norm(dim=-1)) < _AT_ROOT:
        return ()
    apart = _apart(cameras, local, certain)
    frames = (apart > _APART).nonzero().flatten().tolist()
    told: list[str] = []
    if _median(torch.where(certain > 0, local[..., 2], torch.nan)) > _IN_FRONT:
        certain = torch.where(local[..., 2] > _IN_FRONT, certain, 0)
        shown = cameras.project_camera(local.nan_to_num())
        told += _beside_pixels(shown, certain, detections)
        # by less, errors of the joints look like mistakes of the cameras
        more = min(max(_LEAST, _NOISE * _jitter(local, certain)), _APART)
        if int((apart > more).sum()) >= _LASTING and not clip.has_pixels:
            seen = replace(detections, joints2d=shown, confidence2d=certain)
            told += [*_exchanged(cameras, local, certain)] or agreement_doubts(cameras, seen)
        told = told or [*_farther(cameras, local, shown, certain)]
    if len(frames) >= _LASTING and not told:
        told += [
            f"views place the 3D joints {float(2 * apart[frames].median()):.2g} m apart in frames "
            f"{ranges(frames)}; check that they are of one person, in the axes of each camera"
        ]
    return tuple(told)


def _beside_pixels(shown: Tensor, certain: Tensor, detections: Detections) -> Iterator[str]:
    """Views in whose images 3D joints (F, C, 16, 2) lie beside the 2D ones, or are larger."""
    both = (certain > 0) & (detections.confidence2d > CONFIDENT)
    enough = both.sum(-1) >= _FEWEST_JOINTS
    count = both.sum(-1, keepdim=True).clamp(min=1)[..., None]
    middles, sizes = [], []
    for points in (shown, detections.joints2d):
        points = torch.where(both[..., None], points, 0)
        middle = points.sum(-2, keepdim=True) / count
        away = torch.where(both[..., None], points - middle, 0)
        middles.append(middle[..., 0, :])
        sizes.append(away.square().sum((-2, -1)).sqrt())
    whole = extents(
        torch.where(both[..., None], detections.joints2d, middles[1][..., None, :])
    ).clamp(min=1e-6)
    beside = (middles[0] - middles[1]).norm(dim=-1) / whole
    larger = sizes[0] / sizes[1].clamp(min=1e-6)
    for view in range(shown.shape[1]):
        there = enough[:, view]
        if int(there.sum()) < _FEWEST:
            continue
        off = float(beside[there, view].median())
        least, usual, most = larger[there, view].quantile(larger.new_tensor(_QUARTERS)).tolist()
        fits = _LARGER[0] < usual < _LARGER[1] and _WAVERS[0] < least and most < _WAVERS[1]
        if off > _BESIDE or not fits:
            yield (
                f"view {view}: in the image the placed 3D joints lie {off:.0%} of the person's "
                f"size beside the 2D joints and are {least:.2f} to {most:.2f} times as large; "
                "check that both are of the images, the lens and the distance of this camera, or "
                "leave placed=False"
            )


def _apart(cameras: Camera, local: Tensor, certain: Tensor) -> Tensor:
    """Median distance (m) of joints of the views from their mean in the world, (F,)."""
    places = (local - cameras.translation.unsqueeze(-2)) @ cameras.rotation
    places = torch.where(certain[..., None] > 0, places, torch.nan)
    off = (places - places.nanmean(1, keepdim=True)).norm(dim=-1)
    median: Tensor = off.flatten(1).nanmedian(-1).values
    return median


def _jitter(local: Tensor, certain: Tensor) -> float:
    """Errors of joints (F, C, 16, 3) that change from frame to frame, metres, 0 if unknown."""
    known = torch.where(certain[..., None] > 0, local, torch.nan)
    steps = known.diff(n=2, dim=0).norm(dim=-1) if len(known) > 2 else known.new_zeros(1)
    return float((steps / _SECOND).nanmedian().nan_to_num(0.0))


def _exchanged(cameras: Camera, local: Tensor, certain: Tensor) -> Iterator[str]:
    """Two views whose 3D joints are each other's: lines of sight alone may fit other mistakes."""
    left = {}
    for one, other in combinations(range(cameras.views), 2):
        order = [{one: other, other: one}.get(view, view) for view in range(cameras.views)]
        left[one, other] = _median(_apart(cameras, local[:, order], certain[:, order]))
    pair = min(left, key=left.__getitem__)
    if left[pair] < min(_FITS, _BETTER * _median(_apart(cameras, local, certain))):
        yield (
            f"view {pair[0]} and view {pair[1]}: their 3D joints look exchanged; give those of "
            "each view in the order of the cameras"
        )


def _median(values: Tensor) -> float:
    return float(values.nanmedian())


def _farther(cameras: Camera, local: Tensor, shown: Tensor, certain: Tensor) -> Iterator[str]:
    """Views whose 3D joints are not as far away as where lines of sight of all views meet."""
    points, _ = triangulate(cameras, cameras.to_plane(shown), certain)
    met = (points.unsqueeze(1) - cameras.centre.unsqueeze(-2)).norm(dim=-1)  # F C 16
    ratio = torch.where(certain > 0, local.norm(dim=-1) / met, torch.nan)
    ratio = torch.where(_crossing(cameras, points, certain)[:, None], ratio, torch.nan)
    frames = ratio.nanmedian(-1).values  # F C
    for view, each in enumerate(frames.unbind(1)):
        each = each[each.isfinite()]
        if len(each) < _FEWEST:
            continue
        usual, off = float(each.median()), float((each - 1).abs().median())
        if off > _FARTHER:
            lasting = abs(usual - 1) > 0.5 * off
            far = f"{usual:.2f} times as far away as" if lasting else f"{off:.0%} beside"
            yield (
                f"view {view}: its placed 3D joints are {far} where lines of sight of the views "
                f"meet; {_REMEDY}"
            )


def _crossing(cameras: Camera, points: Tensor, certain: Tensor) -> Tensor:
    """Joints (F, 16) at which two lines of sight meet at an angle; along parallel ones nothing
    says how far away they are.
    """
    rays = torch.nn.functional.normalize(
        points.unsqueeze(1) - cameras.centre.unsqueeze(-2), dim=-1
    )  # F C 16 3
    cosine = torch.einsum("fcjd,fejd->fjce", rays, rays).abs()
    seen = (certain > 0).transpose(1, 2)
    pairs = seen[..., None] & seen[..., None, :]
    crossing: Tensor = (pairs & (cosine.square() < 1 - _CROSSING**2)).flatten(-2).any(-1)
    return crossing
