"""How much of each pixel does a surface cover, differentiably? Soft silhouettes of meshes.

The outline of the silhouette is found exactly: contour edges of the projected mesh, cut where they
cross, as far as there is background on one side. A pixel's coverage is a smooth function of its
signed distance to the outline; it is exactly 0 and 1 from half a band away on, where it equals the
fill of the triangles. The derivative of a pixel goes to the ends of the outline edge that is
nearest to it. Occlusion is thus exact too: what lies inside the silhouette moves nothing.

Away from the outline a soft silhouette has no gradient. Where the image of a surface and a mask do
not overlap, correspondences between their contours pull; this does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.render._coverage import Borders, Coverage, cover
from perfcap.render.label_map import require_image_size

LARGEST_BAND = 64.0  # px


@dataclass(frozen=True)
class CoverageDerivative:
    """The derivative of coverage, which is sparse, as N records.

    Pixel p sees the point that is the share t of the way from vertex a to vertex b. When that
    point moves by v, coverage of p changes by ``gradient . v``. A pixel that sees two outline
    edges cross has two records, whose changes add up.

    Attributes:
        pixel: index into the flattened images (*b, H, W), (N,).
        vertices: a and b, (N, 2); of welded vertices the first copy.
        share: t, (N,).
        gradient: 1/px, (N, 2).
    """

    pixel: Tensor
    vertices: Tensor
    share: Tensor
    gradient: Tensor


class SoftSilhouette(nn.Module):
    """Coverage of pixels by a projected mesh, with a gradient to where its vertices project.

    Coverage is ``s * s * (3 - 2 * s)`` of ``s = 0.5 + 0.5 * distance / band``, clamped to 0 and 1,
    where distance is signed and positive inside; about a logistic function of ``3 * distance /
    band``, but one that ends. Whatever meshes do wrong is harmless: open, not manifold, partly
    behind the camera (such triangles are left out, as in ``rasterize``), seen from inside. Time
    grows with the square of the contour edges in a row of pixels: meshes so noisy that most of
    their triangles are folds should be smoothed or decimated first.

    Args:
        faces: triangles, (T, 3), of V vertices.
        size: image height and width, px.
        band: half the width of the band about the outline, px.
        weld: one place of each vertex, (V,) from 0 to U, for meshes whose vertices were split at
            texture seams (``Template.weld()[0]``); the copies at a place are averaged. It makes
            shared edges shared: without it results are equal while copies stay together, but take
            longer, and only one of the copies gets the gradient.

    Raises:
        InputError: faces or weld are no indices, the image or the band is too large.
    """

    faces: Tensor
    face_edges: Tensor
    edge_ends: Tensor
    weld: Tensor | None
    share: Tensor | None
    representative: Tensor | None

    def __init__(
        self,
        faces: Tensor,
        size: tuple[int, int],
        band: float = 2.0,
        weld: Tensor | None = None,
    ) -> None:
        super().__init__()
        _check(faces, size, band, weld)
        self.size, self.band = (int(size[0]), int(size[1])), float(band)
        weld = None if weld is None else weld.detach().long()
        faces = faces.detach().long() if weld is None else weld[faces.long()]
        # triangles that are left without three corners have no border
        faces = faces[(faces != faces.roll(1, -1)).all(-1)].contiguous()
        sides = torch.stack([faces, faces.roll(-1, 1)], -1).sort(-1).values
        ends, edges = torch.unique(sides.view(-1, 2), dim=0, return_inverse=True)
        self._keep("faces", faces)
        self._keep("face_edges", edges.view(-1, 3))
        self._keep("edge_ends", ends.contiguous())
        self._keep("weld", weld)
        copies = None if weld is None else torch.bincount(weld)
        self._keep("share", None if copies is None else (1 / copies.double())[weld])
        self._keep("representative", None if weld is None else _first_copies(weld))
        self.places = len(copies) if copies is not None else int(ends.max()) + 1 if len(ends) else 0

    def forward(self, pixels: Tensor, depth: Tensor) -> Tensor:
        """Coverage of every pixel in every frame, view, or whatever the batch is.

        Args:
            pixels: projected vertices, (*b, V, 2) px, pixel centres at integers.
            depth: along the optical axis, (*b, V) m; only says what is in front of the camera.

        Returns:
            (*b, H, W) in [0, 1], of the dtype of ``pixels``. On the CPU compiled kernels draw one
            image after the other on one thread; elsewhere their torch twin draws all at once.
            Works with ``torch.func.grad``, ``vjp``, ``jvp``, ``jacrev`` and ``jacfwd``; instead of
            ``vmap`` give a batch. There is no second derivative.

        Raises:
            InputError: shapes that do not fit each other or the faces.
            RuntimeError: a gradient of a gradient, or ``vmap``, is asked for.
        """
        self._check_input(pixels, depth)
        mesh = self.borders(depth.shape[-1])
        coverage: Tensor
        coverage, *_ = Coverage.apply(pixels, depth.detach(), mesh)  # type: ignore[no-untyped-call]
        return coverage

    def seen_by(self, cameras: Camera, vertices: Tensor) -> Tensor:
        """Coverage (*b, F, C, H, W) of world vertices (*b, F, V, 3) in metres, in C views.

        Differentiable in the vertices and in the cameras.

        Raises:
            InputError: a view has another size; views without a size are taken to have this one.
        """
        require_size(cameras, self.size)
        local = cameras.to_camera(vertices)
        coverage: Tensor = self(cameras.project_camera(local), local[..., 2])
        return coverage

    def linearize(self, pixels: Tensor, depth: Tensor) -> tuple[Tensor, CoverageDerivative]:
        """Coverage (*b, H, W) and its derivative, outside of any graph; arguments as of a call."""
        self._check_input(pixels, depth)
        vertices = depth.shape[-1]
        mesh = self.borders(vertices)
        flat = pixels.detach().reshape(-1, vertices, 2), depth.detach().reshape(-1, vertices)
        coverage, records = cover(mesh, *flat)
        pixel, ends = records.names[:, 0], records.names[:, 1:]
        ends = ends % max(mesh.places, 1)  # they are counted on from image to image
        if self.representative is not None:
            ends = self.representative[ends]
        share, gradient = records.values.to(coverage).tensor_split((1,), -1)
        derivative = CoverageDerivative(pixel, ends, share[:, 0], gradient)
        return coverage.view(*depth.shape[:-1], *self.size), derivative

    def borders(self, vertices: int) -> Borders:
        """What the kernels need to know of a mesh of that many vertices."""
        return Borders(
            self.faces,
            self.face_edges,
            self.edge_ends,
            self.weld,
            self.share,
            vertices if self.weld is None else self.places,
            self.size,
            self.band,
        )

    def _keep(self, name: str, values: Tensor | None) -> None:
        self.register_buffer(name, values, persistent=False)

    def _check_input(self, pixels: Tensor, depth: Tensor) -> None:
        if pixels.shape != (*depth.shape, 2) or not pixels.is_floating_point():
            raise InputError(
                f"pixels has shape {tuple(pixels.shape)} and dtype {pixels.dtype} but depth has "
                f"shape {tuple(depth.shape)}; expected floats (*b, V, 2) and (*b, V)"
            )
        vertices = depth.shape[-1]
        if self.weld is None and vertices < self.places:
            raise InputError(
                f"pixels has {vertices} vertices but faces name vertex {self.places - 1}; "
                "give the vertices of the faces"
            )
        if self.weld is not None and vertices != len(self.weld):
            raise InputError(
                f"pixels has {vertices} vertices but weld has {len(self.weld)}; give the vertices "
                "that weld was made for"
            )


def _first_copies(weld: Tensor) -> Tensor:
    """First vertex at each place, (U,); that of a place without any means nothing."""
    every = torch.arange(len(weld), device=weld.device)
    first = torch.full((int(weld.max()) + 1,), len(weld), device=weld.device)
    return first.scatter_reduce(0, weld, every, "amin")


def require_size(cameras: Camera, size: tuple[int, int]) -> None:
    """Raise an InputError unless every view that has a size has this one."""
    other = {tuple(view) for view in cameras.size} - {tuple(size)}
    if other:
        raise InputError(
            f"cameras have views of {sorted(other)} px (height, width) but the silhouette is drawn "
            f"in {tuple(size)}; make one silhouette for the views of each size"
        )


def _check(faces: Tensor, size: tuple[int, int], band: float, weld: Tensor | None) -> None:
    if faces.ndim != 2 or faces.shape[-1] != 3 or faces.is_floating_point():
        raise InputError(
            f"faces has shape {tuple(faces.shape)} and dtype {faces.dtype}; "
            "expected integers (T, 3)"
        )
    if len(faces) and int(faces.min()) < 0:
        raise InputError(f"faces names vertex {int(faces.min())}; expected indices from 0 on")
    require_image_size(size)
    if not 0 < band <= LARGEST_BAND:
        raise InputError(f"band is {band}; expected up to {LARGEST_BAND:g} pixels, above zero")
    if weld is not None:
        _check_weld(faces, weld)


def _check_weld(faces: Tensor, weld: Tensor) -> None:
    if weld.ndim != 1 or weld.is_floating_point() or not len(weld) or int(weld.min()) < 0:
        raise InputError(
            f"weld has shape {tuple(weld.shape)} and dtype {weld.dtype}; "
            "expected a place from 0 on for each vertex, integers (V,)"
        )
    if len(faces) and int(faces.max()) >= len(weld):
        raise InputError(
            f"faces names vertex {int(faces.max())} but weld has {len(weld)}; "
            "expected one entry for every vertex"
        )
