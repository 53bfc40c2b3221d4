"""Points in the world from their images in several views; a rigid set of points from one."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.geometry.camera import NEAR, Camera
from perfcap.setting_checks import require_count, require_size

# Determinant of the normalised normal matrix below which rays count as parallel: two rays that
# meet at less than about a sixth of a degree.
PARALLEL = 1e-5


def triangulate(
    camera: Camera, plane: Tensor, weights: Tensor, rounds: int = 6, scale: float = 0.01
) -> tuple[Tensor, Tensor]:
    """Robust weighted linear triangulation (Hartley and Sturm 1997, Sec. 5.1 and 5.2).

    With camera coordinates Y = R X + t, each view gives the equations (R_1 - x R_3) X = x t_3 - t_1
    and (R_2 - y R_3) X = y t_3 - t_2. Dividing them by the depth found in the round before makes
    their residual the image error; Cauchy weights on it let a wrong view lose its say.

    Args:
        camera: C views, (C,) or (F, C).
        plane: undistorted image coordinates (``camera.to_plane``), (*b, F, C, N, 2).
        weights: confidence, (*b, F, C, N); 0 where a view does not see the point, whose place
            there may be NaN.
        rounds: of reweighting; 0 is the plain weighted linear solution.
        scale: image error, in units of ``plane`` (pixels over focal length), at which a view
            counts half.

    Returns:
        points: (*b, F, N, 3), metres.
        residual: weighted root-mean-square image error, (*b, F, N), in units of ``plane``, with
            the weights given. Both are NaN where fewer than two views see a point or their rays
            are parallel.

    Raises:
        InputError: rounds that are no count, or a scale that is not above zero.
    """
    require_count(rounds, "rounds", least=0)
    require_size(scale, "scale")
    counts = weights > 0
    weights = torch.where(counts, weights, 0)
    plane = torch.where(counts[..., None], plane, 0)  # what is not seen may be any number
    middle = camera.centre.mean(-2)  # the world's origin may be far away: solve about the cameras
    offset = camera.translation + (camera.rotation @ middle[..., None, :, None]).squeeze(-1)
    rotation = camera.rotation.unsqueeze(-3)  # *b C 1 3 3
    rows = rotation[..., :2, :] - plane.unsqueeze(-1) * rotation[..., 2:, :]  # *b C N 2 3
    right = plane * offset[..., None, 2:] - offset[..., None, :2]  # *b C N 2
    seen = counts.sum(-2) >= 2
    equations = _by_point(rows, right)
    robust = weights
    for i in range(rounds + 1):
        points, well = _solve(equations, robust)
        depth = _depth(camera.rotation, offset, points)
        error = _squared_error(rows, right, points, depth)
        if i < rounds:
            robust = weights / depth.square() / (1 + error / scale**2)
    total = weights.sum(-2).clamp(min=1e-12)
    # the floor keeps the derivative of the root finite where all rays meet
    residual = ((weights * error).sum(-2) / total).clamp(min=1e-24).sqrt()
    valid = seen & well
    return (
        torch.where(valid[..., None], points + middle.unsqueeze(-2), torch.nan),
        torch.where(valid, residual, torch.nan),
    )


def _by_point(rows: Tensor, right: Tensor) -> Tensor:
    """Equations of all views, their right sides last, one matrix a point: (*b, N, 2 C, 4)."""
    return torch.cat((rows, right.unsqueeze(-1)), -1).movedim(-4, -3).flatten(-3, -2)


def _solve(equations: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted least squares a point, (*b, N, 3), and whether its rays cross, (*b, N)."""
    share = weights.mT.repeat_interleave(2, -1).unsqueeze(-1)  # *b N 2C 1
    normal = (share * equations[..., :3]).mT @ equations  # *b N 3 4
    gram, moment = normal[..., :3], normal[..., 3]
    size = gram.diagonal(dim1=-2, dim2=-1).mean(-1).clamp(min=1e-30)
    a, b, c = (gram / size[..., None, None]).unbind(-2)
    well = (torch.linalg.cross(a, b) * c).sum(-1) > PARALLEL  # the determinant
    eye = torch.eye(3).to(gram)
    safe = torch.where(well[..., None, None], gram, eye)
    return torch.linalg.solve_ex(safe, moment)[0], well


def _depth(rotation: Tensor, offset: Tensor, points: Tensor) -> Tensor:
    """Depth of points (*b, N, 3) in each view, (*b, C, N), kept in front of the camera."""
    depth = (points.unsqueeze(-3) @ rotation[..., 2, :, None]).squeeze(-1)
    return (depth + offset[..., 2:]).clamp(min=NEAR)


def _squared_error(rows: Tensor, right: Tensor, points: Tensor, depth: Tensor) -> Tensor:
    """Squared image error of points in each view, (*b, C, N)."""
    algebraic = (rows @ points[..., None, :, :, None]).squeeze(-1) - right
    return algebraic.square().sum(-1) / depth.square()


# --- Where a rigid set of points must stand to project onto given pixels --------------------------


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
