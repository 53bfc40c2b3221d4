"""What the viewer draws in 3D: the textured mesh, its skin, its bones and its captured surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.template import Template
from perfcap.geometry.rotation import matrix_to_quaternion
from perfcap.io.result import Result
from perfcap.pipeline.surroundings import Surroundings
from perfcap.report.quantize import Box, difference

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
