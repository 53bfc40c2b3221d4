"""How much light reaches a person's skin and the ground beneath.

Both are found with the z-buffer. From each of a few directions of a light, a vertex is lit if
nothing lies in front of it, and a spot of the ground is dark if the mesh, flattened onto the
ground along the direction, covers it. Averages over directions give soft shadows that are sharp
where a foot touches the ground and fade with height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera, look_at
from perfcap.render.label_map import rasterize
from perfcap.render.lighting import Lighting, unit
from perfcap.render.projected_mesh import ProjectedMesh, vertex_normals
from perfcap.render.texture import to_linear, to_srgb
from perfcap.setting_checks import require_count, require_number

SUN_SPREAD = math.radians(2.5)  # half angle; ten times the sun's, as if behind thin haze
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
MAP = 224  # px, side of the picture taken from a light; 1 cm a pixel for a person
COARSER = 2  # image pixels along a pixel of a ground shadow, which is soft anyway
LOWEST = 0.15  # sine of the lowest light's elevation: lower light throws endless shadows
CLEARANCE = 0.02  # of the mesh's radius: surfaces nearer than this do not shade one another


@dataclass(frozen=True)
class Visibility:
    """Share of each light that reaches a vertex, in [0, 1]: ``sun`` (V,) and ``sky`` (V,)."""

    sun: Tensor
    sky: Tensor


def visibility(
    vertices: Tensor, faces: Tensor, lighting: Lighting, sun: int = 3, sky: int = 36
) -> Visibility:
    """How much of sun and sky each vertex sees past the rest of the mesh.

    Args:
        vertices: world, (V, 3) m.
        faces: (T, 3).
        lighting: directions of the lights.
        sun: directions taken within the sun.
        sky: directions taken all around.

    Raises:
        InputError: a vertex is not finite, or there are no directions.
    """
    require_count(sun, "sun")
    require_count(sky, "sky")
    if not bool(torch.isfinite(vertices).all()):
        raise InputError("vertices are not all finite; expected metres; leave this frame unlit")
    towards_sun = cone(unit(lighting.towards_sun, vertices), SUN_SPREAD, sun)
    around = cone(unit(lighting.up, vertices), math.pi, sky)
    facing = (vertex_normals(vertices, faces) @ around.T).clamp_min(0)  # V K
    seen = torch.stack([_lit(vertices, faces, direction) for direction in around], -1)
    open_sky = (facing * seen).sum(-1) / facing.sum(-1).clamp_min(1e-6)
    lit = torch.stack([_lit(vertices, faces, direction) for direction in towards_sun])
    return Visibility(lit.mean(0), open_sky)


def shade_ground(
    image: Tensor,
    camera: Camera,
    vertices: Tensor,
    faces: Tensor,
    lighting: Lighting,
    ground: float = 0.0,
    sun: int = 10,
    sky: int = 32,
) -> Tensor:
    """Darken a picture of empty ground where a mesh above it takes the light.

    Args:
        image: (H, W, 3) uint8 sRGB, fully lit; every pixel is taken to show the ground.
        camera: of one view at one time, batch (1,).
        vertices: world, (V, 3) m.
        faces: (T, 3).
        lighting: lights of the scene.
        ground: height of the ground plane along ``lighting.up``, m.
        sun: directions taken within the sun.
        sky: directions taken from all of the sky.

    Raises:
        InputError: the image does not have the camera's size, the ground is above all of the mesh,
            or there are no directions.
    """
    require_count(sun, "sun")
    require_count(sky, "sky")
    require_number(ground, "ground")
    if image.shape != (*camera.size[0], 3) or image.dtype != torch.uint8:
        raise InputError(
            f"image has shape {tuple(image.shape)} and dtype {image.dtype}; "
            f"expected {(*camera.size[0], 3)} uint8, the size of the camera"
        )
    up = unit(lighting.up, vertices)
    towards_sun = cone(unit(lighting.towards_sun, vertices), SUN_SPREAD, sun)
    overhead = cosine_hemisphere(up, sky)
    highest = float((vertices @ up).max()) if len(vertices) else math.inf
    if highest < ground:
        raise InputError(
            f"ground is at {ground:.4g} m along the light's up, the mesh ends at {highest:.4g} m "
            "below it; expected metres, of a ground under the mesh"
        )
    sun_taken = _covered(camera, vertices, faces, towards_sun, up, ground)
    sky_taken = _covered(camera, vertices, faces, overhead, up, ground)
    row, column = torch.nonzero(sun_taken + sky_taken, as_tuple=True)
    sun_light, sky_light = lighting.parts(up[None].float())
    taken = sun_taken[row, column, None] * sun_light + sky_taken[row, column, None] * sky_light
    left = 1 - taken / lighting.on(up[None].float())
    darker = image.clone()
    darker[row, column] = to_srgb(to_linear(image[row, column]) * left)
    return darker


def cone(axis: Tensor, half_angle: float, count: int) -> Tensor:
    """Unit vectors (K, 3) spread evenly within an angle of a unit axis (3,); pi is the sphere."""
    rank = torch.arange(count, dtype=axis.dtype, device=axis.device) + 0.5
    return _around(axis, 1 - (1 - math.cos(half_angle)) * rank / count)


def cosine_hemisphere(axis: Tensor, count: int) -> Tensor:
    """Unit vectors (K, 3) on one side of a unit axis (3,), dense in proportion to their cosine."""
    rank = torch.arange(count, dtype=axis.dtype, device=axis.device) + 0.5
    return _around(axis, (1 - rank / count).sqrt())


def _around(axis: Tensor, cosines: Tensor) -> Tensor:
    """Directions at given cosines to an axis, turned by the golden angle from one to the next."""
    least = torch.nn.functional.one_hot(axis.abs().argmin(), 3).to(axis)
    first = torch.nn.functional.normalize(torch.linalg.cross(axis, least), dim=0)
    second = torch.linalg.cross(axis, first)
    turn = GOLDEN_ANGLE * torch.arange(len(cosines), dtype=axis.dtype, device=axis.device)
    sines = (1 - cosines.square()).clamp_min(0).sqrt()
    ring = turn.cos()[:, None] * first + turn.sin()[:, None] * second
    directions: Tensor = cosines[:, None] * axis + sines[:, None] * ring
    return directions


def _lit(vertices: Tensor, faces: Tensor, direction: Tensor) -> Tensor:
    """1 for vertices that are first seen from a direction (3,), 0 behind others, (V,)."""
    middle = (vertices.amin(0) + vertices.amax(0)) / 2
    radius = (vertices - middle).norm(dim=-1).amax().clamp_min(1e-6)
    # far enough for a nearly parallel view
    eye = middle + 30 * radius * direction
    across = torch.nn.functional.one_hot(direction.abs().argmin(), 3).to(direction)
    rotation, translation = look_at(eye, middle, across)
    local = vertices @ rotation.T + translation
    focal = 0.48 * MAP * 30
    pixels = focal * local[:, :2] / local[:, 2:] + (MAP - 1) / 2
    nearest = rasterize(pixels, local[:, 2], faces, (MAP, MAP)).depth
    column, row = pixels.round().long().clamp(0, MAP - 1).unbind(-1)
    lit: Tensor = local[:, 2] < nearest[row, column] + CLEARANCE * radius
    return lit.to(vertices)


def _covered(
    camera: Camera, vertices: Tensor, faces: Tensor, directions: Tensor, up: Tensor, ground: float
) -> Tensor:
    """Share (H, W) of directions from which the mesh covers the ground."""
    height = ((vertices @ up) - ground).clamp_min(0)
    small = (-(-camera.size[0][0] // COARSER), -(-camera.size[0][1] // COARSER))
    total = torch.zeros(small, device=vertices.device)
    for direction in directions:
        slope = direction / (direction @ up).clamp_min(LOWEST)
        mesh = ProjectedMesh.seen_by(camera, vertices - height[:, None] * slope, faces)
        pixels = (mesh.pixels + 0.5) / COARSER - 0.5
        total += rasterize(pixels, mesh.depth, faces, small).mask
    return _upsampled(total / len(directions), camera.size[0])


def _upsampled(shadow: Tensor, size: tuple[int, int]) -> Tensor:
    """A small map at full size, without the steps between its few directions."""
    sigma = max(size) / COARSER / 400
    smooth = cv2.GaussianBlur(shadow.cpu().numpy(), (0, 0), max(sigma, 0.7))
    full = cv2.resize(smooth, None, fx=COARSER, fy=COARSER, interpolation=cv2.INTER_LINEAR)
    return torch.from_numpy(full[: size[0], : size[1]]).to(shadow)
