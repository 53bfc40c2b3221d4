"""Skinning: carry a template's vertices along with its bones.

Both blends take rest-to-posed transforms of bones, world from template, and loop over frames in
small chunks: besides the result (and, where derivatives are asked for, what they need) memory does
not grow with the number of frames, and small arrays stay in cache.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from perfcap.actor.skin_weights import SkinWeights
from perfcap.errors import InputError
from perfcap.geometry.dual_quaternion import DualQuaternion, sign_to

CHUNK = 8  # frames at once; measured best from 1 to 50 at 13 000 vertices


def linear_blend(
    vertices: Tensor,
    weights: Tensor | SkinWeights,
    rotation: Tensor,
    translation: Tensor,
    weight_index: Tensor | None = None,
) -> Tensor:
    """Linear blend skinning: each vertex moves with the weighted mean of its bones' matrices.

    Args:
        vertices: template, (V, 3), or one for each pose, (*b, V, 3), metres.
        weights: dense (V, B); sparse (V, K) with ``weight_index``; or, to prepare them once for
            many calls, ``SkinWeights``.
        rotation: rest to posed, (*b, B, 3, 3).
        translation: rest to posed, (*b, B, 3), metres.
        weight_index: bone of each sparse weight, (V, K).

    Returns:
        Posed vertices (*b, V, 3), differentiable in vertices, rotation and translation.
    """
    weights = _prepared(weights, weight_index)
    _check(vertices, weights, rotation, translation)
    table = torch.cat((rotation, translation.unsqueeze(-1)), -1).flatten(-2)  # *b B 12

    def pose(table: Tensor, vertices: Tensor) -> Tensor:
        sums = _spread(weights, table[..., weights.bones, :])  # 12 f V
        matrix = sums.reshape(3, 4, *sums.shape[1:])
        moved: Tensor = (matrix[:, :3] * vertices.movedim(-1, 0)).sum(1) + matrix[:, 3]
        return moved.movedim(0, -1)

    return _by_chunks(pose, table, vertices, weights.vertices)


def dual_quaternion_blend(
    vertices: Tensor,
    weights: Tensor | SkinWeights,
    rotation: Tensor,
    translation: Tensor,
    weight_index: Tensor | None = None,
    inverse: bool = False,
) -> Tensor:
    """Dual quaternion skinning (Kavan et al. 2007; Xu et al. 2018, Sec. 4): keeps volume in twists.

    Quaternions take the sign of the vertex's heaviest bone, so the result does not depend on
    theirs. Arguments and result are those of ``linear_blend``; rotations must be proper. Each
    vertex moves rigidly, so that the way back is known, too: with ``inverse``, ``vertices`` are
    posed and the result is at rest.
    """
    weights = _prepared(weights, weight_index)
    _check(vertices, weights, rotation, translation)
    motion = DualQuaternion.from_rigid(rotation, translation)
    table = torch.cat((motion.real, motion.dual), -1)  # *b B 8

    def pose(table: Tensor, vertices: Tensor) -> Tensor:
        rows = table[..., weights.bones, :]
        sign = sign_to(table[..., weights.pivots, :4], rows[..., :4])
        blended = _spread(weights, sign.unsqueeze(-1) * rows)
        return _move(_conjugate(blended) if inverse else blended, vertices)

    return _by_chunks(pose, table, vertices, weights.vertices)


def _conjugate(blended: Tensor) -> Tensor:
    """The way back of rigid motions (8, f, V), as far as the dual part is one: see ``_move``."""
    sign = blended.new_tensor([1.0, -1.0, -1.0, -1.0] * 2)
    return blended * sign[:, None, None]


def _move(blended: Tensor, vertices: Tensor) -> Tensor:
    """Move vertices (f, V, 3) by dual quaternions (8, f, V) that are not yet of unit length.

    With unit real part (w, a) and dual part (u, e) a point x goes to
    ``x + 2 (a × s + w e - u a)``, ``s = a × x + w x + e``; coordinate by coordinate, because
    contiguous planes are what a processor is fast at.
    """
    unit = blended / blended[:4].square().sum(0).sqrt()
    w, a, b, c, u, e, f, g = unit.unbind(0)
    x, y, z = vertices.unbind(-1)
    p = torch.addcmul(e, b, z).addcmul(c, y, value=-1).addcmul(w, x)
    q = torch.addcmul(f, c, x).addcmul(a, z, value=-1).addcmul(w, y)
    r = torch.addcmul(g, a, y).addcmul(b, x, value=-1).addcmul(w, z)
    dx = (b * r).addcmul(c, q, value=-1).addcmul(w, e).addcmul(u, a, value=-1)
    dy = (c * p).addcmul(a, r, value=-1).addcmul(w, f).addcmul(u, b, value=-1)
    dz = (a * q).addcmul(b, p, value=-1).addcmul(w, g).addcmul(u, c, value=-1)
    return vertices + 2 * torch.stack((dx, dy, dz), -1)


def _spread(weights: SkinWeights, rows: Tensor) -> Tensor:
    """Weighted sums (D, f, V) of the rows (f, P, D) of each frame's table."""
    columns = rows.movedim(-2, 0).flatten(1)  # P f*D
    sums: Tensor = weights(columns)  # V f*D
    split = sums.reshape(len(sums), rows.shape[0], rows.shape[-1])
    return split.permute(2, 1, 0).contiguous()


def _by_chunks(
    pose: Callable[[Tensor, Tensor], Tensor], table: Tensor, vertices: Tensor, count: int
) -> Tensor:
    """Pose chunk after chunk of frames: table (*b, B, D), vertices (V, 3) or (*b, V, 3)."""
    batch = table.shape[:-2]
    tables = table.reshape(-1, *table.shape[-2:])
    if vertices.dim() == 2:
        parts = [pose(part, vertices[None]) for part in torch.split(tables, CHUNK)]
    else:
        meshes = vertices.expand(*batch, count, 3).reshape(-1, count, 3)
        pairs = zip(torch.split(tables, CHUNK), torch.split(meshes, CHUNK), strict=True)
        parts = [pose(part, mesh) for part, mesh in pairs]
    return torch.cat(parts).reshape(*batch, count, 3)


def _prepared(weights: Tensor | SkinWeights, weight_index: Tensor | None) -> SkinWeights:
    if isinstance(weights, SkinWeights):
        return weights
    return SkinWeights(weights, weight_index)


def _check(vertices: Tensor, weights: SkinWeights, rotation: Tensor, translation: Tensor) -> None:
    if vertices.shape[-2:] != (weights.vertices, 3):
        raise InputError(
            f"vertices have shape {tuple(vertices.shape)} but there are weights for "
            f"{weights.vertices}; give (V, 3)"
        )
    if rotation.shape != (*translation.shape, 3) or translation.shape[-1] != 3:
        raise InputError(
            f"rotation has shape {tuple(rotation.shape)} and translation "
            f"{tuple(translation.shape)}; give (*b, B, 3, 3) and (*b, B, 3)"
        )
    if rotation.shape[-3] < weights.least_bones:
        raise InputError(
            f"weights name bone {weights.least_bones - 1} but there are transforms of "
            f"{rotation.shape[-3]} bones; give one for each"
        )
