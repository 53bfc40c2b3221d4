"""A lit, textured picture of a mesh over a background.

Light is added and averaged in linear intensity; images are sRGB. Surfaces are Lambertian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.render.label_map import LabelMap, barycentric_at
from perfcap.render.lighting import DAYLIGHT, Lighting
from perfcap.render.projected_mesh import ProjectedMesh, vertex_normals
from perfcap.render.shadow import Visibility
from perfcap.render.texture import Texture, to_linear, to_srgb

_ROUNDING = 1e-3  # of a share


@dataclass(frozen=True)
class Rendering:
    """A picture: ``image`` (H, W, 3) uint8 sRGB and ``coverage`` (H, W) in [0, 1] of the mesh."""

    image: Tensor
    coverage: Tensor


def render(
    mesh: ProjectedMesh,
    texture: Texture,
    background: Tensor,
    lighting: Lighting = DAYLIGHT,
    reached: Visibility | None = None,
    supersampling: int = 2,
) -> Rendering:
    """Draw a mesh over a background.

    Args:
        mesh: what to draw; its size is the picture's.
        texture: colours of its faces.
        background: (H, W, 3) uint8 sRGB; unchanged wherever the mesh covers nothing.
        lighting: lights of the scene.
        reached: share of them that reaches each vertex; all of it if None.
        supersampling: samples along each side of a pixel, 1 to 8.

    Raises:
        InputError: the background does not have the picture's size, the texture another number of
            faces than the mesh, the share of light another number of vertices, or too many samples.
    """
    _check(mesh, texture, background, supersampling)
    if reached is not None:
        for name, share in (("sun", reached.sun), ("sky", reached.sky)):
            require_shape(share, f"reached {name}", mesh.depth.shape, "(V,), of each vertex")
            if len(share) and not bool((share.detach() - 0.5).abs().max() <= 0.5 + _ROUNDING):
                raise InputError(
                    f"reached {name} is {float(share.min()):.4g} to {float(share.max()):.4g}, "
                    "expected shares from 0 to 1, as visibility gives them"
                )
    gather = _gather_compiled if mesh.depth.device.type == "cpu" else _gather
    light, coverage = gather(
        mesh.enlarged(supersampling), texture, lighting, reached, supersampling
    )
    touched = torch.nonzero(coverage).squeeze(-1)
    image = background.reshape(-1, 3).clone()
    behind = (1 - coverage[touched, None]) * to_linear(image[touched])
    image[touched] = to_srgb(light[touched] + behind)
    return Rendering(image.view(*mesh.size, 3), coverage.view(mesh.size))


def _gather(
    fine: ProjectedMesh, texture: Texture, lighting: Lighting, reached: Visibility | None, step: int
) -> tuple[Tensor, Tensor]:
    """Mean light (P, 3) of the ``step`` x ``step`` samples of each pixel, and coverage (P,)."""
    seen = fine.rasterize()
    row, column = torch.nonzero(seen.mask, as_tuple=True)
    light = shade(seen, fine, texture, lighting, reached)
    height, width, share = fine.size[0] // step, fine.size[1] // step, 1 / step**2
    target = (row // step) * width + column // step
    total = light.new_zeros(height * width, 3).index_add(0, target, light * share)
    return total, torch.bincount(target, minlength=len(total)) * share


def _gather_compiled(
    fine: ProjectedMesh, texture: Texture, lighting: Lighting, reached: Visibility | None, step: int
) -> tuple[Tensor, Tensor]:
    """The same on the CPU, in one compiled pass."""
    from perfcap.render import _shading_numba

    with torch.no_grad():
        area = _doubled_area(fine).float()
        normals = vertex_normals(fine.vertices, fine.faces)
        level = texture.level_of_detail(area.abs())
    height, width = fine.size[0] // step, fine.size[1] // step
    arrived = torch.ones(len(normals), 2)
    if reached is not None:
        arrived = torch.stack([reached.sun, reached.sky], -1)
    mesh = (fine.pixels.double(), fine.depth.double(), fine.faces.long(), normals.float(), area)
    skin = (texture.uv.float(), texture.faces.long(), level.float(), *texture.packed)
    light, coverage = torch.zeros(height, width, 3), torch.zeros(height, width)
    _shading_numba.gather(
        fine.rasterize().triangle.numpy(),
        step,
        tuple(_contiguous(part) for part in mesh),
        tuple(_contiguous(part) for part in skin),
        _contiguous(lighting.table()),
        _contiguous(arrived.float()),
        light.numpy(),
        coverage.numpy(),
    )
    return light.view(-1, 3), coverage.view(-1)


def _contiguous(values: Tensor) -> NDArray[Any]:
    array: NDArray[Any] = values.detach().contiguous().numpy()
    return array


def shade(
    seen: LabelMap,
    mesh: ProjectedMesh,
    texture: Texture,
    lighting: Lighting,
    reached: Visibility | None = None,
) -> Tensor:
    """Linear light (P, 3) that leaves the surface at each pixel of ``seen.mask``, row by row."""
    row, column = torch.nonzero(seen.mask, as_tuple=True)
    face = seen.triangle[row, column].long()
    corners = mesh.faces.long()[face]  # P 3
    point = torch.stack([column, row], -1).to(mesh.pixels)
    weights = barycentric_at(point, mesh.pixels[corners], mesh.depth[corners]).float()
    area = _doubled_area(mesh).float()
    normals = blend(vertex_normals(mesh.vertices, mesh.faces).float()[corners], weights)
    normals = torch.nn.functional.normalize(normals, dim=-1)
    # a positive area in the image is a face seen from behind: cloth is shaded on both sides
    normals = torch.where(area[face, None] > 0, -normals, normals)
    sun, sky = lighting.parts(normals)
    if reached is not None:
        sun = sun * blend(reached.sun.float()[corners, None], weights)
        sky = sky * blend(reached.sky.float()[corners, None], weights)
    uv = blend(texture.uv.float()[texture.faces.long()[face]], weights)
    color = texture.sample(uv, texture.level_of_detail(area.abs())[face])
    return color * (sun + sky + sun.new_tensor(lighting.ambient))


def blend(corners: Tensor, weights: Tensor) -> Tensor:
    """Values (P, D) at points of faces from those at their corners (P, 3, D)."""
    return (weights[:, :, None] * corners).sum(1)


def _doubled_area(mesh: ProjectedMesh) -> Tensor:
    """Twice the signed image area of every face, (T,) px²."""
    a, b, c = mesh.pixels[mesh.faces.long()].unbind(-2)
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def _check(mesh: ProjectedMesh, texture: Texture, background: Tensor, supersampling: int) -> None:
    vertices = (*mesh.depth.shape, 3)
    require_shape(mesh.vertices, "vertices", vertices, "(V, 3), of each depth")
    if background.shape != (*mesh.size, 3) or background.dtype != torch.uint8:
        raise InputError(
            f"background has shape {tuple(background.shape)} and dtype {background.dtype}; "
            f"expected {(*mesh.size, 3)} uint8"
        )
    if len(texture.faces) != len(mesh.faces):
        raise InputError(
            f"texture covers {len(texture.faces)} faces but the mesh has {len(mesh.faces)}; "
            "expected the same faces in the same order"
        )
    if not 1 <= supersampling <= 8:
        raise InputError(f"supersampling is {supersampling}; expected 1 to 8 samples a side")
