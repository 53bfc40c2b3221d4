"""Best rigid motion or similarity between matched points (Umeyama 1991).

The rotation maximises ``tr(R^T H)`` with ``H = sum w (y - mean y) (x - mean x)^T``. Its derivative
exists wherever the best rotation is unique, even where singular vectors are not (a cube has three
equal singular values), so it is not taken through the SVD: the SVD finds the rotation, and
differentiable Newton steps from it, which move nothing, carry the derivative.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable
from perfcap.geometry.rotation import quaternion_to_matrix

# Newton steps at the solution: one a derivative order, so first and second derivatives are exact.
STEPS = 2


@dataclass(frozen=True)
class Similarity:
    """The map ``scale * rotation @ x + translation``.

    Attributes:
        scale: (*b), not negative.
        rotation: (*b, 3, 3), proper.
        translation: (*b, 3), metres.
    """

    scale: Tensor
    rotation: Tensor
    translation: Tensor

    def apply(self, points: Tensor) -> Tensor:
        """Move points (*b, N, 3)."""
        turned = points @ self.rotation.mT
        return self.scale[..., None, None] * turned + self.translation.unsqueeze(-2)


def procrustes(
    source: Tensor, target: Tensor, weights: Tensor | None = None, scale: bool = True
) -> Similarity:
    """The similarity of least weighted squared distance from source to target.

    Never a reflection. Input that leaves something open has a finite answer:

    - collinear points (or a mirror image as good as the original): one of the best rotations;
      the derivative is zero along the ones that are equally good;
    - all source or all target points equal, a single point, no weight at all: the identity
      rotation. The scale is one unless the source has an extent and the target has none, where
      it is zero. The centroids coincide; without any weight they are the origin.

    Args:
        source: (*b, N, 3), metres.
        target: (*b, N, 3), metres.
        weights: (*b, N), not negative, one if None. Points of weight zero may hold anything, NaN
            too.
        scale: whether to estimate the scale; it is one otherwise.

    Returns:
        Similarity of batch ``*b``, differentiable in all inputs. A batch element with a
        non-finite point of positive weight is NaN; the others are not affected.
    """
    _check(source, target, weights)
    weights = source.new_ones(source.shape[:-1]) if weights is None else weights.to(source.dtype)
    source, source_mean = _centred(source, weights)
    target, target_mean = _centred(target, weights)
    covariance = (weights.unsqueeze(-1) * target).mT @ source
    rotation = nearest_rotation(covariance)
    factor = torch.ones_like(covariance[..., 0, 0])
    if scale:
        spread = (weights.unsqueeze(-1) * source.square()).sum((-2, -1))
        flat = spread == 0
        match = (rotation * covariance).sum((-2, -1)).clamp(min=0)
        factor = torch.where(flat, factor, match / torch.where(flat, factor, spread))
    moved = (rotation @ source_mean.unsqueeze(-1)).squeeze(-1)
    return Similarity(factor, rotation, target_mean - factor.unsqueeze(-1) * moved)


def rigid_align(source: Tensor, target: Tensor, weights: Tensor | None = None) -> Tensor:
    """Source points (*b, N, 3) after the best rigid motion onto the target (see ``procrustes``)."""
    return procrustes(source, target, weights, scale=False).apply(source)


def similarity_align(source: Tensor, target: Tensor, weights: Tensor | None = None) -> Tensor:
    """Source points (*b, N, 3) after the best similarity onto the target (see ``procrustes``)."""
    return procrustes(source, target, weights).apply(source)


def nearest_rotation(matrix: Tensor) -> Tensor:
    """The rotation (*b, 3, 3) that maximises ``tr(R^T H)`` of a matrix H (*b, 3, 3).

    Unique, and differentiable to second order, unless the two smallest singular values (the last
    one negative if det H < 0) sum to zero; there one of the maximisers, with the derivative of
    the part that is determined. The identity for a zero matrix; NaN for one that is not finite.
    """
    rotation, inverse_curvature = _polar(matrix.detach())
    for _ in range(STEPS):
        local = rotation.mT @ matrix
        turn = (inverse_curvature @ _axial(local - local.mT).unsqueeze(-1)).squeeze(-1)
        rotation = rotation @ _small_rotation(turn)
    return rotation


def _polar(matrix: Tensor) -> tuple[Tensor, Tensor]:
    """Best rotation, and the pseudo-inverse of the curvature ``tr(S) I - S``, S = R^T H."""
    finite = matrix.isfinite().all(-1, keepdim=True).all(-2, keepdim=True)
    left, values, right = torch.linalg.svd(torch.where(finite, matrix, torch.zeros_like(matrix)))
    proper = torch.ones_like(values)
    proper[..., 2] = torch.where((left @ right).det() < 0, -1.0, 1.0).to(values.dtype)
    rotation = (left * proper.unsqueeze(-2)) @ right
    signed = values * proper
    curvature = signed.sum(-1, keepdim=True) - signed
    flat = curvature <= 16 * torch.finfo(values.dtype).eps * values[..., :1]
    inverse = torch.where(flat, torch.zeros_like(curvature), 1 / torch.where(flat, 1, curvature))
    inverse_curvature = (right.mT * inverse.unsqueeze(-2)) @ right
    identity = torch.eye(3, dtype=matrix.dtype, device=matrix.device)
    rotation = torch.where((values[..., 0] == 0)[..., None, None], identity, rotation)
    return torch.where(finite, rotation, torch.full_like(rotation, torch.nan)), inverse_curvature


def _small_rotation(turn: Tensor) -> Tensor:
    """Rotation matrix by about ``turn`` (*b, 3); smooth, and the identity at zero."""
    half = torch.cat((torch.ones_like(turn[..., :1]), 0.5 * turn), -1)
    return quaternion_to_matrix(torch.nn.functional.normalize(half, dim=-1))


def _axial(matrix: Tensor) -> Tensor:
    """The vector v with ``skew(v)`` = A for a skew matrix A (*b, 3, 3)."""
    return torch.stack((matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0]), -1)


def _centred(points: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Points (*b, N, 3) minus their weighted mean, zero where they do not count, and the mean."""
    counts = (weights > 0).unsqueeze(-1)
    points = torch.where(counts, points, torch.zeros_like(points))
    total = weights.sum(-1, keepdim=True)
    share = weights / torch.where(total > 0, total, torch.ones_like(total))
    mean = (share.unsqueeze(-1) * points).sum(-2)
    offsets = torch.where(counts, points - mean.unsqueeze(-2), torch.zeros_like(points))
    # equal points differ from their mean by its rounding: that is no extent
    rounding = 16 * torch.finfo(points.dtype).eps * points.abs().amax((-2, -1), keepdim=True)
    flat = offsets.abs().amax((-2, -1), keepdim=True) <= rounding
    return torch.where(flat, torch.zeros_like(offsets), offsets), mean


def _check(source: Tensor, target: Tensor, weights: Tensor | None) -> None:
    if source.shape != target.shape or source.shape[-1:] != (3,) or source.dim() < 2:
        raise InputError(
            f"source has shape {tuple(source.shape)} and target {tuple(target.shape)}; give "
            "matched points of one shape (*b, N, 3)"
        )
    if source.dtype != target.dtype or source.dtype not in (torch.float32, torch.float64):
        raise InputError(
            f"source is {source.dtype} and target {target.dtype}; give both as float32 or both as "
            "float64"
        )
    if weights is not None and weights.shape != source.shape[:-1]:
        raise InputError(
            f"weights have shape {tuple(weights.shape)} for points {tuple(source.shape)}; give "
            "one weight a point"
        )
    if weights is not None and is_readable(weights) and bool((weights < 0).any()):
        raise InputError(
            f"weights are {float(weights.min()):.3g} at least, expected numbers from 0 on; take "
            "the sigmoid of logits"
        )
