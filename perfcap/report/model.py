"""What the viewer draws in 3D: the textured mesh, its skin, its bones and its captured surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.template import Template
from perfcap.geometry.rotation import matrix_to_quaternion
from perfcap.io.result import Result
from perfcap.pipeline.surroundings import Surroundings

# --- Vertices of a clip in 16 bits a coordinate, and in a few bytes once deflated -----------------
#
# Coordinates are multiples of a step from the corner of the box that the clip stays in. Neighbours
# in time and in the order of the vertices move alike, so what is stored is the difference in both,
# modulo 2^16, and of it first all low bytes, then all high ones, which are nearly always zero.

STEP = 1e-4  # m: as fine as a step needs to be; coarser only in boxes above 6.5 m
_LEVELS = 2**16 - 1

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Box:
    """The grid that coordinates are rounded to.

    Attributes:
        origin: smallest coordinates of the clip, (3,) m.
        step: m; positions are off by half of it at most, along each axis.
    """

    origin: NDArray[np.float64]
    step: float

    @classmethod
    def around(cls, low: Floats, high: Floats) -> Self:
        """The grid of a clip between two corners, (3,) m."""
        origin = np.asarray(low, np.float64)
        return cls(origin, max(STEP, float((high - origin).max()) / _LEVELS))

    def levels(self, positions: Floats) -> NDArray[np.uint16]:
        """Nearest places on the grid of positions (..., 3) m."""
        return np.rint((positions - self.origin) / self.step).clip(0, _LEVELS).astype(np.uint16)

    def positions(self, levels: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Places on the grid, (..., 3) m."""
        return self.origin + self.step * levels


def difference(levels: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Coded differences, (2, 3, F, V), of levels (F, V, 3).

    For a viewer to read: for each axis, frame and vertex a number n = low + 256 high; the
    difference is n / 2, or -(n + 1) / 2 where n is odd.
    """
    values = levels.transpose(2, 0, 1)  # 3 F V
    change = values.copy()
    change[:, 1:] -= values[:, :-1]
    change[:, :, 1:] -= change[:, :, :-1].copy()
    signed = change.view(np.int16)
    folded = ((signed << 1) ^ (signed >> 15)).view(np.uint16)
    return np.stack([folded & 0xFF, folded >> 8]).astype(np.uint8)


def restore(coded: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """The levels (F, V, 3) of coded differences (2, 3, F, V): the inverse of ``difference``."""
    folded = coded[0].astype(np.uint16) | (coded[1].astype(np.uint16) << 8)
    change = (folded >> 1) ^ (-(folded & 1).astype(np.int16)).view(np.uint16)
    levels = change.cumsum(2, np.uint16).cumsum(1, np.uint16)
    return np.ascontiguousarray(levels.transpose(1, 2, 0))


# --------------------------------------------------------------------------------------------------
# What the viewer draws in 3D: the textured mesh, its skin, its bones and its captured surface.

SURFACE_LIMIT = 6_000_000  # vertices times frames, 20 MB or so in a page
_TEXTURE_SIDE = 2048  # px
_TEXTURE_QUALITY = 88
_SEAM = 1e-4  # m that copies of a vertex along a seam may be apart to count as one
_BLOCK = 16  # frames

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Model:
    """The character in 3D.

    Attributes:
        arrays: for the viewer, by name.
        surface: coded surface, (2, 3, F, U), or None.
        box: the grid of the surface.
        texture: an encoded image and its type, or None.
        notes: what is left out, and why.
    """

    arrays: Arrays
    surface: NDArray[np.uint8] | None = None
    box: Box | None = None
    texture: tuple[bytes, str] | None = None
    notes: tuple[str, ...] = ()


def build_model(result: Result, rows: slice) -> Model:
    """The model of some frames of a result.

    Raises:
        InputError: the captured surface is damaged.
    """
    template = result.template
    welded, representative = template.weld()
    if not _coincide(result, rows, welded, representative):
        welded = representative = np.arange(len(template.vertices))
    arrays = {
        **_mesh(template, welded, representative),
        **_bones(template, representative, result.bone_transforms[rows]),
        "joints": result.joints[rows].astype(np.float32),
    }
    frames = rows.stop - rows.start
    texture = _texture(template)
    if result.surface is None:
        return Model(arrays, texture=texture)
    if frames * len(representative) > SURFACE_LIMIT:
        most = SURFACE_LIMIT // len(representative)
        note = (
            f"The captured surface of {frames} frames is too large for a page, the skinned one is "
            f"shown; perfcap report --frames A:B shows up to {most} frames with their own."
        )
        return Model(arrays, texture=texture, notes=(note,))
    box, coded = _coded(result, rows, representative)
    return Model(arrays, coded, box, texture)


def scene_arrays(around: Surroundings) -> dict[str, Any]:
    """Where up, ahead and the ground are, for JSON: rows of ``axes`` are side, up and ahead."""
    up, ahead = around.up.double(), around.ahead.double()
    side = torch.linalg.cross(up, ahead)
    return {"axes": torch.stack((side, up, ahead)).tolist(), "ground": around.ground}


def _mesh(template: Template, welded: NDArray[Any], representative: NDArray[Any]) -> Arrays:
    uv = template.uv if template.uv is not None else np.zeros((len(welded), 2))
    return {
        "rest": template.vertices[representative].astype(np.float32),
        "welded": welded.astype(np.uint32),
        "faces": template.faces.astype(np.uint32),
        "uv": uv.astype(np.float32),
    }


def _bones(
    template: Template, representative: NDArray[Any], transforms: NDArray[np.float64]
) -> Arrays:
    """Skinning weights, and the motion of those bones that have any, without scale."""
    bones, weights = template.weight_bones[representative], template.weights[representative]
    used = np.unique(bones)
    moved = transforms[:, used]
    return {
        "weights": np.rint(weights * 65535).astype(np.uint16),
        "weight_bones": np.searchsorted(used, bones).astype(np.uint16),
        "rotations": _quaternions(moved[..., :3, :3]),
        "translations": moved[..., :3, 3].astype(np.float32),
    }


def _quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float32]:
    """Unit quaternions wxyz of rotations (..., 3, 3)."""
    found: NDArray[np.float32] = matrix_to_quaternion(torch.tensor(rotations)).float().numpy()
    return found


def _blocks(result: Result, rows: slice) -> Iterator[NDArray[np.float32]]:
    for start in range(rows.start, rows.stop, _BLOCK):
        yield result.vertices(slice(start, min(start + _BLOCK, rows.stop)))


def _coincide(
    result: Result, rows: slice, welded: NDArray[Any], representative: NDArray[Any]
) -> bool:
    """Whether copies of a vertex stay together in the captured surface."""
    if result.surface is None:
        return True
    first = result.vertices(slice(rows.start, rows.start + 1))[0]
    return bool(np.abs(first[representative][welded] - first).max() < _SEAM)


def _coded(
    result: Result, rows: slice, representative: NDArray[Any]
) -> tuple[Box, NDArray[np.uint8]]:
    """The captured surface in two passes over its file: its box, then its levels."""
    corners = [(b.min((0, 1)), b.max((0, 1))) for b in _blocks(result, rows)]
    low, high = np.min([c[0] for c in corners], 0), np.max([c[1] for c in corners], 0)
    box = Box.around(low, high)
    levels = [box.levels(block[:, representative]) for block in _blocks(result, rows)]
    return box, difference(np.concatenate(levels))


def _texture(template: Template) -> tuple[bytes, str] | None:
    """The texture, made smaller where it is large; None where it cannot be decoded."""
    if template.texture is None or template.uv is None:
        return None
    try:
        image = cv2.imdecode(np.frombuffer(template.texture, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # larger than OpenCV is willing to decode
        return None
    if image is None:
        return None
    scale = _TEXTURE_SIDE / max(image.shape[:2])
    if scale < 1:
        size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _TEXTURE_QUALITY])
    return encoded.tobytes(), "image/jpeg"
