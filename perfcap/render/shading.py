"""A lit, textured picture of a mesh over a background.

Light is added and averaged in linear intensity; images are sRGB. Lambertian surfaces under an
ambient light, a sky that grows brighter towards ``up``, and a sun.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.render.label_map import LabelMap, barycentric_at
from perfcap.render.projected_mesh import ProjectedMesh, vertex_normals
from perfcap.render.texture import Texture, to_linear, to_srgb

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Lighting:
    """Light in the world; intensities are linear RGB, and 1 in sum shows a texture as it is.

    Attributes:
        ambient: the same from everywhere.
        sky: on surfaces facing up, half of it on vertical ones, none on those facing down.
        sun: on surfaces facing the sun.
        towards_sun: direction, any length.
        up: direction, any length.
    """

    ambient: Color = (0.22, 0.22, 0.23)
    sky: Color = (0.32, 0.34, 0.38)
    sun: Color = (0.72, 0.68, 0.60)
    towards_sun: Color = (0.5, 1.0, 0.6)
    up: Color = (0.0, 1.0, 0.0)

    def on(self, normals: Tensor) -> Tensor:
        """Irradiance (N, 3) on surfaces of unit normals (N, 3)."""
        facing_up = 0.5 + 0.5 * normals @ unit(self.up, normals)
        facing_sun = (normals @ unit(self.towards_sun, normals)).clamp_min(0)
        ambient, sky, sun = (normals.new_tensor(c) for c in (self.ambient, self.sky, self.sun))
        return ambient + sky * facing_up[:, None] + sun * facing_sun[:, None]


FLAT = Lighting(ambient=(1.0, 1.0, 1.0), sky=(0.0, 0.0, 0.0), sun=(0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Rendering:
    """A picture: ``image`` (H, W, 3) uint8 sRGB and ``coverage`` (H, W) in [0, 1] of the mesh."""

    image: Tensor
    coverage: Tensor


def render(
    mesh: ProjectedMesh,
    texture: Texture,
    background: Tensor,
    lighting: Lighting = Lighting(),
    supersampling: int = 2,
) -> Rendering:
    """Draw a mesh over a background.

    Args:
        mesh: what to draw; its size is the picture's.
        texture: colours of its faces.
        background: (H, W, 3) uint8 sRGB; unchanged wherever the mesh covers nothing.
        lighting: lights of the scene.
        supersampling: samples along each side of a pixel, 1 to 8.

    Raises:
        InputError: the background does not have the picture's size, the texture another number of
            faces than the mesh, or too many samples.
    """
    _check(mesh, texture, background, supersampling)
    fine = mesh.enlarged(supersampling)
    seen = fine.rasterize()
    light = shade(seen, fine, texture, lighting)
    pooled = torch.cat([light, seen.mask[..., None].to(light)], -1).movedim(-1, 0)
    pooled = torch.nn.functional.avg_pool2d(pooled, supersampling).movedim(0, -1)
    coverage = pooled[..., 3]
    blended = pooled[..., :3] + (1 - coverage[..., None]) * to_linear(background)
    image = torch.where(coverage[..., None] > 0, to_srgb(blended), background)
    return Rendering(image, coverage)


def shade(seen: LabelMap, mesh: ProjectedMesh, texture: Texture, lighting: Lighting) -> Tensor:
    """Linear light (H, W, 3) that leaves the surface at each pixel, zero where there is none."""
    row, column = torch.nonzero(seen.mask, as_tuple=True)
    face = seen.triangle[row, column].long()
    corners = mesh.faces.long()[face]  # P 3
    point = torch.stack([column, row], -1).to(mesh.pixels)
    weights = barycentric_at(point, mesh.pixels[corners], mesh.depth[corners]).float()
    area = _doubled_area(mesh)[face]
    normals = blend(vertex_normals(mesh.vertices, mesh.faces).float()[corners], weights)
    normals = torch.nn.functional.normalize(normals, dim=-1)
    # a positive area in the image is a face seen from behind: cloth is shaded on both sides
    normals = torch.where(area[:, None] > 0, -normals, normals)
    uv = blend(texture.uv.float()[texture.faces.long()[face]], weights)
    level = texture.level_of_detail(_doubled_area(mesh).abs().float())[face]
    out = weights.new_zeros(*seen.mask.shape, 3)
    out[row, column] = texture.sample(uv, level) * lighting.on(normals)
    return out


def blend(corners: Tensor, weights: Tensor) -> Tensor:
    """Values (P, D) at points of faces from those at their corners (P, 3, D)."""
    return (weights[:, :, None] * corners).sum(1)


def unit(direction: Color, like: Tensor) -> Tensor:
    """A direction as a unit vector (3,) of a tensor's kind."""
    return torch.nn.functional.normalize(like.new_tensor(direction), dim=0)


def _doubled_area(mesh: ProjectedMesh) -> Tensor:
    """Twice the signed image area of every face, (T,) px²."""
    a, b, c = mesh.pixels[mesh.faces.long()].unbind(-2)
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def _check(mesh: ProjectedMesh, texture: Texture, background: Tensor, supersampling: int) -> None:
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
