"""Detections a little earlier or later than they were made."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.detect.detections import Detections


def at_clock(detections: Detections, clock: Tensor) -> Detections:
    """Detections of each view so many frames later, on straight lines between frames.

    Args:
        detections: (F, C, 16).
        clock: frames, (C,).

    Returns:
        Detections (F, C, 16); unseen beyond the ends of the clip, and between frames of which one
        does not see a joint. 3D joints are those of the nearest frame.
    """
    frames, views = detections.frame_count, torch.arange(detections.views, device=clock.device)
    place = torch.arange(frames).to(clock)[:, None] + clock  # F C
    inside = (place >= 0) & (place <= frames - 1)
    first = place.floor().clamp(0, max(frames - 2, 0)).long()
    second = (first + 1).clamp(max=frames - 1)
    share = (place - first).to(detections.joints2d)[..., None]
    low, high = (detections.joints2d[index, views] for index in (first, second))
    sure, after = (detections.confidence2d[index, views] for index in (first, second))
    both = torch.minimum(sure, after)
    confidence = torch.where(share == 0, sure, torch.where(share == 1, after, both))
    nearest = place.round().clamp(0, frames - 1).long()
    joints3d, deviation = detections.joints3d, detections.deviation3d
    return replace(
        detections,
        joints2d=low + share[..., None] * (high - low),
        confidence2d=confidence * inside[..., None],
        joints3d=None if joints3d is None else joints3d[nearest, views],
        trusted3d=detections.trusted3d[nearest, views] & inside,
        deviation3d=None if deviation is None else deviation[nearest, views],
    )
