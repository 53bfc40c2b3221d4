"""Where a rigid set of points must stand to project onto given pixels."""

from __future__ import annotations

import torch
from torch import Tensor


def translation_from_plane(
    points: Tensor, plane: Tensor, weights: Tensor, rounds: int = 6
) -> tuple[Tensor, Tensor]:
    """Translation that brings points, known up to it, onto their images.

    With x = (X + t_x) / (Z + t_z) the problem is linear in t: t_x - x t_z = x Z - X. It is
    solved by iteratively reweighted least squares (Cauchy weights on the image error), since
    detections contain outliers.

    Args:
        points: in camera axes, (*b, N, 3), metres.
        plane: undistorted image coordinates (x/z, y/z), (*b, N, 2).
        weights: confidence, (*b, N).
        rounds: of reweighting.

    Returns:
        translation: (*b, 3); NaN where fewer than two points have weight.
        error: weighted mean image error at the result, (*b,), in units of ``plane``.
    """
    ones, zeros = torch.ones_like(plane[..., 0]), torch.zeros_like(plane[..., 0])
    rows = torch.stack(
        (
            torch.stack((ones, zeros, -plane[..., 0]), -1),
            torch.stack((zeros, ones, -plane[..., 1]), -1),
        ),
        -2,
    )  # *b N 2 3
    right = plane * points[..., 2:] - points[..., :2]
    robust = weights
    for _ in range(rounds):
        gram = torch.einsum("...n,...nri,...nrj->...ij", robust, rows, rows)
        moment = torch.einsum("...n,...nri,...nr->...i", robust, rows, right)
        translation = torch.linalg.solve_ex(gram, moment)[0]
        error = _image_error(points + translation.unsqueeze(-2), plane)
        typical = _weighted_median(error, weights).unsqueeze(-1)
        robust = weights / (1 + (error / (2 * typical).clamp(min=1e-6)).square())
    mean = (weights * error).sum(-1) / weights.sum(-1).clamp(min=1e-12)
    seen = (weights > 0).sum(-1, keepdim=True) >= 2
    return torch.where(seen, translation, torch.nan), mean


def _image_error(points: Tensor, plane: Tensor) -> Tensor:
    projected = points[..., :2] / points[..., 2:].clamp(min=1e-3)
    error: Tensor = (projected - plane).norm(dim=-1)
    return error


def _weighted_median(values: Tensor, weights: Tensor) -> Tensor:
    """Weighted median over the last axis: half the weight lies at or below it."""
    order = values.argsort(-1)
    cumulative = weights.gather(-1, order).cumsum(-1)
    index = (cumulative < 0.5 * cumulative[..., -1:]).sum(-1, keepdim=True)
    chosen = order.gather(-1, index.clamp(max=values.shape[-1] - 1))
    return values.gather(-1, chosen).squeeze(-1)
