"""Colours of a volume's Gaussians (Rhodin et al. 2016, appearance estimation).

For trackers that match colours: in every view of some frames each Gaussian has the mean colour of
the pixels that see it, weighed by how much they do. Wrong ones, where the pose was off or somebody
else in front, are dropped one by one, the farthest from the mean first, until half are left.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.volume import GaussianCentres, Volume
from perfcap.geometry.camera import Camera
from perfcap.pipeline.images import Images
from perfcap.render.density import visibilities
from perfcap.render.texture import to_linear

_IMAGES = 24  # that are looked at, spread over the clip
_PIXELS = 3000  # of each, within the body's box
_LEAST = 3.0  # pixels' worth of sight of a Gaussian from which it has a colour
_KEPT = 0.5  # of the candidates


def color_volume(volume: Volume, points: GaussianCentres, motion: Motion, images: Images) -> Volume:
    """The volume with colours; NaN for Gaussians that no image shows.

    Args:
        volume: Gaussians.
        points: their centres.
        motion: (F,), as the images show it.
        images: F frames.
    """
    with torch.no_grad():
        centres = points(motion)
    views = images.cameras.views
    frames = np.unique(np.linspace(0, len(centres) - 1, max(1, _IMAGES // views)).round())
    candidates = []
    for frame in frames.astype(int).tolist():
        cameras = images.cameras.to(centres).frames(slice(frame, frame + 1))
        for view in range(views):
            camera = _one(cameras, view)
            (image,) = images.reader.read_view(view, frame, frame + 1)
            pixels = torch.tensor(image).to(centres.device)
            candidates.append(_seen(volume, camera, centres[frame], pixels))
    colors = trimmed_means(torch.stack(candidates))
    return replace(volume, colors=colors.to(volume.centres))


def trimmed_means(candidates: Tensor, kept: float = _KEPT) -> Tensor:
    """Means (Q, 3) of candidates (K, Q, 3) without the farthest, which are dropped one by one.

    Args:
        candidates: NaN where there is none.
        kept: share of them that is left, at least one.
    """
    there = candidates.isfinite().all(-1)
    target = (kept * there.sum(0)).ceil().clamp(min=1)
    values = torch.where(there[..., None], candidates, 0.0)
    for _ in range(len(candidates)):
        mean = _mean(values, there)
        drop = there.sum(0) > target
        if not bool(drop.any()):
            break
        apart = torch.where(there, (values - mean).norm(dim=-1), -1.0)
        farthest = torch.nn.functional.one_hot(apart.argmax(0), len(candidates)).mT.bool()
        there = there & ~(farthest & drop)
    mean = _mean(values, there)
    return torch.where(there.any(0)[:, None], mean, torch.nan)


def _mean(values: Tensor, there: Tensor) -> Tensor:
    weights = there.to(values)[..., None]
    return (weights * values).sum(0) / weights.sum(0).clamp(min=1)


def _one(cameras: Camera, view: int) -> Camera:
    """A view of cameras (C,) or (1, C) as a fixed one, (1,)."""
    one = cameras.select([view])
    return one.map(lambda each: each[0]) if one.moving else one


def _seen(volume: Volume, camera: Camera, centres: Tensor, image: Tensor) -> Tensor:
    """Mean linear colour of the pixels that see each Gaussian, (Q, 3)."""
    none = centres.new_full((volume.count, 3), torch.nan, dtype=torch.float64)
    pixels = camera.project(centres)[0]
    size = pixels.new_tensor(image.shape[1::-1])
    low = pixels.amin(0).clamp(min=0).floor()
    high = torch.minimum(pixels.amax(0) + 1, size - 1).floor()
    if not bool((high > low).all()) or not bool(pixels.isfinite().all()):
        return none
    step = max(1, math.ceil(float((high - low).prod() / _PIXELS) ** 0.5))
    columns, rows = (torch.arange(int(a), int(b) + 1, step) for a, b in zip(low, high, strict=True))
    y, x = torch.meshgrid(rows, columns, indexing="ij")
    where = torch.stack((x, y), -1).reshape(-1, 2).to(centres.device)
    widths = volume.deviations, volume.densities
    seen, _ = visibilities(camera, centres, *widths, where.to(centres))
    light = to_linear(image[where[:, 1], where[:, 0]]).double()
    weight = seen.double().sum(0)
    colors = (seen.double().mT @ light) / weight.clamp(min=1e-9)[:, None]
    return torch.where((weight * step**2 > _LEAST)[:, None], colors, none)
