"""Markers on the skin or the clothes: where a captured surface has them (Liu et al. 2013, Fig. 16).

A marker is fixed to the template once, by the triangle nearest to it, its place in the triangle
and its height over it, and then carried along by the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.metrics.missing import check_metres

_FARTHEST = 500.0  # mm: no clothes are so wide
_BLOCK = 8  # markers compared with all triangles at once


@dataclass(frozen=True)
class MarkerSites:
    """Where M markers sit on a template.

    Attributes:
        corners: vertices of each marker's triangle, (M, 3).
        weights: barycentric coordinates in the triangle, (M, 3), sums one.
        height: over the triangle along its normal, (M,), metres.
    """

    corners: Tensor
    weights: Tensor
    height: Tensor


@dataclass(frozen=True)
class MarkerError:
    """Distance of markers from where they were measured, each (*b), mm.

    Attributes:
        mean: over all markers and frames that were measured.
        deviation: standard deviation of the same.
        missing: markers that were not measured, over all frames.
    """

    mean: Tensor
    deviation: Tensor
    missing: Tensor


def attach_markers(vertices: Tensor, faces: Tensor, markers: Tensor) -> MarkerSites:
    """Fix markers (M, 3) to the nearest points of a surface (V, 3) in the same pose.

    Args:
        vertices: (V, 3), metres.
        faces: (T, 3).
        markers: (M, 3), metres.

    Raises:
        InputError: shapes, a marker that is not finite, or markers that are not on the surface.
    """
    if markers.dim() != 2 or markers.shape[-1] != 3 or not markers.isfinite().all():
        raise InputError(f"markers are {tuple(markers.shape)}, expected finite (M, 3) in metres")
    triangles = vertices[faces]
    sites = [_nearest(part, triangles) for part in torch.split(markers, _BLOCK)]
    triangle, weights = (torch.cat(parts) for parts in zip(*sites, strict=True))
    corners = triangles[triangle]
    foot = (weights.unsqueeze(-1) * corners).sum(-2)
    apart = 1e3 * (markers - foot).norm(dim=-1)
    if len(apart) and float(apart.median()) > _FARTHEST:
        raise InputError(
            f"markers are {float(apart.median()):.4g} mm off the surface; expected metres, and the "
            "surface in the pose and the world in which they were measured"
        )
    height = ((markers - foot) * _normals(corners)).sum(-1)
    return MarkerSites(faces[triangle], weights, height)


def marker_positions(sites: MarkerSites, vertices: Tensor) -> Tensor:
    """Where a surface in motion (*b, F, V, 3) has its markers, (*b, F, M, 3), metres."""
    corners = vertices[..., sites.corners, :]  # *b F M 3 3
    foot = (sites.weights.unsqueeze(-1) * corners).sum(-2)
    placed: Tensor = foot + sites.height.unsqueeze(-1) * _normals(corners)
    return placed


def marker_error(found: Tensor, measured: Tensor) -> MarkerError:
    """Distance of markers (*b, F, M, 3) from the measured ones, metres; NaN was not measured.

    Raises:
        InputError: the shapes differ, or markers are in another unit.
    """
    if found.shape != measured.shape or found.shape[-1:] != (3,) or found.dim() < 3:
        raise InputError(
            f"markers have shape {tuple(found.shape)} and were measured as "
            f"{tuple(measured.shape)}; give both as (*b, F, M, 3)"
        )
    check_metres(found=_filled(found), measured=_filled(measured))
    apart = 1e3 * (found - measured).norm(dim=-1)
    valid = apart.isfinite()
    count = valid.sum((-2, -1))
    mean = torch.where(valid, apart, 0).sum((-2, -1)) / count
    square = torch.where(valid, apart - mean[..., None, None], 0).square().sum((-2, -1))
    return MarkerError(mean, (square / count).sqrt(), (~valid).sum((-2, -1)))


def _filled(markers: Tensor) -> Tensor:
    """Markers (*b, F, M, 3), missing ones in the middle of the frame's others: none spans more."""
    known = torch.where(markers.isfinite().all(-1, keepdim=True), markers, torch.nan)
    return torch.where(known.isnan(), known.nanmean(-2, keepdim=True), known)


def _nearest(points: Tensor, triangles: Tensor) -> tuple[Tensor, Tensor]:
    """Nearest triangle (N,) of points (N, 3), and the barycentric place of the nearest point."""
    places = _closest(points[:, None], triangles[None])  # N T 3
    feet = (places.unsqueeze(-1) * triangles).sum(-2)
    best = (feet - points[:, None]).square().sum(-1).argmin(-1)
    return best, places[torch.arange(len(points)), best]


def _closest(points: Tensor, triangles: Tensor) -> Tensor:
    """Barycentric coordinates (N, T, 3) of the points of triangles nearest to points (N, 1, 3)."""
    a, b, c = triangles.unbind(-2)
    inside = _plane_place(points - a, b - a, c - a)
    places = [inside]
    for start, end, first, second in ((a, b, 0, 1), (b, c, 1, 2), (c, a, 2, 0)):
        along = end - start
        length = along.square().sum(-1)
        share = ((points - start) * along).sum(-1) / torch.where(length > 0, length, 1)
        share = share.clamp(0, 1)
        place = torch.zeros_like(inside)
        place[..., first], place[..., second] = 1 - share, share
        places.append(place)
    choices = torch.stack(places)  # 4 N T 3
    apart = ((choices.unsqueeze(-1) * triangles).sum(-2) - points).square().sum(-1)
    apart[0] = torch.where((inside >= 0).all(-1), apart[0], torch.inf)
    best = apart.argmin(0)[None, ..., None].expand(1, *inside.shape)
    return choices.gather(0, best)[0]


def _plane_place(offset: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """Barycentric coordinates of the foot in a triangle's plane; outside for one without area."""
    aa, ab, bb = ((u * v).sum(-1) for u, v in ((first, first), (first, second), (second, second)))
    pa, pb = (offset * first).sum(-1), (offset * second).sum(-1)
    area = aa * bb - ab * ab
    scale = torch.where(area > 0, area, 1)
    v, w = (bb * pa - ab * pb) / scale, (aa * pb - ab * pa) / scale
    place = torch.stack((1 - v - w, v, w), -1)
    return torch.where((area > 0).unsqueeze(-1), place, -1)


def _normals(corners: Tensor) -> Tensor:
    """Unit normals of triangles (..., 3, 3); zero for one without area."""
    a, b, c = corners.unbind(-2)
    return torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1)
