"""A posed mesh together with its image in one camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import is_readable
from perfcap.render.label_map import Cull, LabelMap, rasterize

_LONGEST = 500.0  # m; a person has more in millimetres


@dataclass(frozen=True)
class ProjectedMesh:
    """A mesh as one camera sees it.

    Attributes:
        vertices: world, (V, 3) m.
        faces: (T, 3), counter-clockwise seen from outside.
        pixels: (V, 2) px, pixel centres at integers.
        depth: along the optical axis, (V,) m.
        size: image height and width, px.
    """

    vertices: Tensor
    faces: Tensor
    pixels: Tensor
    depth: Tensor
    size: tuple[int, int]

    @classmethod
    def seen_by(cls, camera: Camera, vertices: Tensor, faces: Tensor) -> Self:
        """Project world vertices (V, 3) into a camera of one view at one time, batch (1,).

        Raises:
            InputError: the camera has several views or frames, or no image size, or vertices are in
                millimetres.
        """
        if camera.intrinsics.shape[:-2] != (1,) or len(camera.size) != 1:
            raise InputError(
                f"camera has batch {tuple(camera.intrinsics.shape[:-2])} and {len(camera.size)} "
                "image sizes; expected one view at one time with its size; use Camera.select"
            )
        if len(vertices) and is_readable(vertices):
            span = vertices.detach().nan_to_num(0.0, 0.0, 0.0)
            longest = float((span.amax(0) - span.amin(0)).amax())
            if longest > _LONGEST:
                raise InputError(
                    f"vertices span {longest:.4g} from end to end, expected metres: divide "
                    "millimetres by 1000"
                )
        local = camera.to(vertices).to_camera(vertices)[0]
        pixels = camera.to(vertices).project_camera(local[None])[0]
        return cls(vertices, faces, pixels, local[..., 2], camera.size[0])

    def enlarged(self, factor: int) -> Self:
        """The same view in an image with ``factor`` times as many rows and columns."""
        # the image corner stays where it is, and is half a pixel away from the first centre
        pixels = (self.pixels + 0.5) * factor - 0.5
        return replace(self, pixels=pixels, size=(self.size[0] * factor, self.size[1] * factor))

    def rasterize(self, cull: Cull = Cull.NONE) -> LabelMap:
        """Nearest surface at each pixel of the image."""
        return rasterize(self.pixels, self.depth, self.faces, self.size, cull)


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Outward unit normals (V, 3), faces weighted by area; zero for vertices without a face.

    Faces with a vertex that is not finite count for nothing.
    Vertices that are split along texture seams have a normal each, which shows as a crease:
    pass the welded mesh.
    """
    a, b, c = vertices[faces.long()].unbind(-2)
    doubled = torch.linalg.cross(b - a, c - a).nan_to_num(0.0, 0.0, 0.0)
    total = torch.zeros_like(vertices)
    for corner in faces.long().unbind(-1):
        total = total.index_add(0, corner, doubled)
    return torch.nn.functional.normalize(total, dim=-1)
