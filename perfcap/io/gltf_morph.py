"""A deforming surface in a skinned glTF file: one morph target a frame.

A viewer adds the weighted targets to the rest pose and skins the sum. A target therefore holds, in
rest space, what the skinning of its frame takes to the captured surface: with the blended matrix
``M = sum_b w_b T_b`` of a vertex at rest in r and captured in x, ``d = M^-1 x - r``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.gltf_buffer import ARRAY_BUFFER, Buffer, Object, index_type
from perfcap.io.written_checks import require_metres

Floats = NDArray[np.float64]

# Layers of an array texture that every WebGL 2 viewer has; such viewers keep one target a layer.
MAX_TARGETS = 256
MAX_TARGET_BYTES = 200 << 20
_STILL = 1e-5  # m; vertices that move less are left where skinning has them
_COLLAPSED = 0.02  # singular value of M, of at most 1, below which a direction is given up


def fits(frames: int, vertices: int) -> bool:
    """Whether so many morph targets make a file that viewers open."""
    return frames <= MAX_TARGETS and 12 * frames * vertices <= MAX_TARGET_BYTES


def add_targets(
    buffer: Buffer, rest: Floats, skin: tuple[NDArray[np.int64], Floats], transforms: Floats,
    surface: Iterable[NDArray[Any]],
) -> tuple[list[Object], Floats]:  # fmt: skip
    """Append one morph target a frame.

    Args:
        buffer: to append to.
        rest: vertices of the rest pose, (V, 3) m.
        skin: bones and weights of each vertex, (V, K) each.
        transforms: rest-to-posed transforms of the bones, (F, B, 4, 4).
        surface: blocks of captured vertices, world, (f, V, 3) m; F in all.

    Returns:
        The ``targets`` of a primitive, and how far half of the vertices move from the skin in each
        frame, (F,), shares of the height at rest.

    Raises:
        InputError: another number of frames or vertices, or vertices that are not finite.
    """
    frames = _frames(surface, rest.shape)
    targets: list[Object] = []
    apart = []
    for matrices, vertices in zip(transforms, frames, strict=False):
        offset = displacement(rest, blended(*skin, matrices), vertices)
        apart.append(float(np.median(np.linalg.norm(offset, axis=-1))))
        targets.append({"POSITION": _add_target(buffer, offset)})
    if len(targets) != len(transforms) or next(frames, None) is not None:
        raise InputError(
            f"surface has {'more' if len(targets) == len(transforms) else len(targets)} frames, "
            f"expected those of the motion, {len(transforms)}"
        )
    return targets, np.array(apart) / float(np.ptp(rest, axis=0).max())


def blended(bones: NDArray[np.int64], weights: Floats, transforms: Floats) -> Floats:
    """Linear blend skinning matrices of the vertices in one frame, (V, 3, 4).

    Args:
        bones: (V, K).
        weights: (V, K).
        transforms: rest-to-posed, (B, 4, 4).
    """
    table = transforms[:, :3].reshape(-1, 12)
    mixed: Floats = np.einsum("vk,vkd->vd", weights, table[bones])
    return mixed.reshape(-1, 3, 4)


def displacement(rest: Floats, matrices: Floats, posed: NDArray[Any]) -> Floats:
    """What to add to a rest pose (V, 3) so that matrices (V, 3, 4) take it to ``posed`` (V, 3), m.

    Where bones turned half round against one another flatten space, the flattened directions stay
    where skinning has them: no finite displacement reaches out of them.
    """
    linear, shift = matrices[:, :, :3], matrices[:, :, 3]
    missing = posed - shift - np.einsum("vij,vj->vi", linear, rest)
    # the least singular value is no less than the determinant, as the others are at most one
    flat = np.linalg.det(linear) < _COLLAPSED
    safe = np.where(flat[:, None, None], np.eye(3), linear)
    solved: Floats = np.linalg.solve(safe, missing[..., None])[..., 0]
    inverse = np.linalg.pinv(linear[flat], rcond=_COLLAPSED)
    solved[flat] = np.einsum("vij,vj->vi", inverse, missing[flat])
    return solved


def one_hot(frames: int) -> Floats:
    """Weights of the targets at the key of each frame, target by target, (F * F, 1)."""
    return np.eye(frames).reshape(-1, 1)


def _frames(surface: Iterable[NDArray[Any]], shape: tuple[int, ...]) -> Iterator[NDArray[Any]]:
    for block in surface:
        if block.ndim != 3 or block.shape[1:] != shape:
            raise InputError(f"surface has frames of shape {block.shape[1:]}, expected {shape}")
        if not np.isfinite(block).all():
            raise InputError("surface has vertices that are not finite")
        require_metres(block, "surface")
        yield from block


def _add_target(buffer: Buffer, offset: Floats) -> int:
    """Append a target; only vertices that move are stored where that is smaller."""
    kept = np.flatnonzero(np.abs(offset).max(1) > _STILL)
    if not len(kept):
        kept = np.zeros(1, np.int64)  # sparse data must not be empty
    index_size = 2 if index_type(len(offset)) == "u2" else 4
    if len(kept) * (12 + index_size) < 12 * len(offset):
        return buffer.add_sparse(offset, "f4", kept)
    return buffer.add(offset, "f4", ARRAY_BUFFER, bounds=True)
