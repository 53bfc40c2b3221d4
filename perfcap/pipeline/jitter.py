"""How much detections jitter, and what a capture should believe when they do not."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.pipeline.config import PoseConfig

_ORDER = 3  # of the differences: smooth motion leaves little in them
_WHITE = 20**0.5  # deviation of third differences of white noise of deviation one: 1, 3, 3, 1
_NORMAL = 0.6745  # median size of a normal variable of deviation one
_CONFIDENT = 0.2
_JUMP = 15.0  # third difference, in deviations, that no motion makes: a gross error of 5


def relaxed(config: PoseConfig, detections: Detections, pixel_unit: Tensor) -> PoseConfig:
    """The configuration with less preference for smooth and neutral where data need none.

    The weights are stated for detections as networks make them. Cleaner ones (markers, several
    detectors fused, exact projections) would be smoothed away by them: below a jitter of
    ``config.clean`` both weights shrink with its square, as the data's own weight would grow.

    Data with a gross error are not clean: it takes the full weights to bridge. One view without
    3D joints keeps them, because there they alone tell depth.

    Args:
        config: of the pose.
        detections: (F, C, 16).
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
    """
    if detections.views == 1 and detections.joints3d is None:
        return config
    share = jitter(config, detections, pixel_unit) / max(config.clean, 1e-12)
    if not share < 1:  # NaN too: a clip too short to tell
        return config
    keep = max(config.cleanest, share**2)
    return replace(
        config,
        trajectory=replace(config.trajectory, weight=keep * config.trajectory.weight),
        prior=replace(config.prior, weight=keep * config.prior.weight),
    )


def jitter(config: PoseConfig, detections: Detections, pixel_unit: Tensor) -> float:
    """Deviation of the noise that is new in every frame, relative to the expected deviation.

    Third differences over time, robustly; the larger one of 2D and 3D joints. Infinite where a
    joint jumps. NaN where no joint is seen in four frames in a row.
    """
    seen = _together(detections.confidence2d > _CONFIDENT * detections.confidence2d.amax())
    unit = config.reprojection.deviation * pixel_unit
    found = _deviation(detections.joints2d / unit[:, None, None], seen)
    if detections.joints3d is not None:
        deviation = detections.joints3d.new_tensor(config.position.deviation)[:, None]
        trusted = _together(detections.trusted3d)[..., None].expand(seen.shape)
        found = torch.fmax(found, _deviation(detections.joints3d / deviation, trusted))
    return float(found.detach())


def _deviation(values: Tensor, seen: Tensor) -> Tensor:
    """Robust deviation of white noise in values (F, C, J, n), from the runs seen (F - 3, C, J)."""
    if len(values) <= _ORDER:
        return values.new_tensor(torch.nan)
    change = values.diff(n=_ORDER, dim=0)[seen].abs()
    if bool((change > _JUMP).any()):
        return values.new_tensor(torch.inf)
    return change.median() / (_WHITE * _NORMAL)


def _together(seen: Tensor) -> Tensor:
    """Whether a frame and the three after it are all seen, (F - 3, ...)."""
    count = max(len(seen) - _ORDER, 0)
    return torch.stack([seen[k : k + count] for k in range(_ORDER + 1)]).all(0)
