"""A surface drawn onto silhouettes that keeps its differential coordinates (Liu 2013, Sec. 4.2).

Minimises ``sum |L (V - V_p)|^2 + alpha sum |P_c V_i - x_i|^2`` (Eq. 10), pixel by pixel and round
by round: pairs are searched anew after each solve. The second sum is linear (Eq. 11): a vertex lies
on the ray through x_i, weighed so that one pixel counts as one where the vertex was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, splu

from perfcap.actor.template import Template
from perfcap.geometry.camera import NEAR, Camera
from perfcap.geometry.laplacian import laplacian
from perfcap.pipeline.surface_config import ContourConfig
from perfcap.segment import Matches, Matching
from perfcap.setting_checks import Settings, require_metres, require_sizes

Floats = NDArray[np.float64]
Pairs = Callable[[Floats], Sequence[Matches]]  # of a surface (V, 3) with its silhouettes, ``[C]``

_SLACK = 1e-9  # of the mean stiffness, so that nothing is free where the reach is infinite
_TOLERANCE = 1e-3  # of a solve; the next round searches other pairs anyway
_MOST = 60  # steps of a solve


@dataclass(frozen=True)
class LaplacianConfig(Settings):
    """How a surface gives way to silhouettes.

    Attributes:
        rounds: searches of pairs, with a solve each (LIU-10).
        alpha: weight of a pair (LIU-10).
        pixel: percent of the person's height that counts as one pixel.
        edge: m; at edges of this length the first sum is that of Eq. 10 in ``unit``.
        unit: m.
        slides: whether points may slide along contours, as in Xu et al. 2018; not in Eq. 11.
        reach: m; a surface that moves so far as a whole costs as much as one pixel in all pairs.
            Eq. 10 has no such term.
        carried: share of the refined surface that the next frame begins with (LIU-11).
        contour: pairs of contours.
    """

    rounds: int = 8
    alpha: float = 0.5
    pixel: float = 0.2
    edge: float = 0.01
    unit: float = 0.001
    slides: bool = True
    reach: float = 0.02
    carried: float = 0.1
    contour: ContourConfig = field(
        default_factory=lambda: ContourConfig(matching=Matching(support=(0.3, 0.6)))
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_sizes(self, "pixel")
        require_metres(self, "edge", "unit", "reach")


class LaplacianSurface:
    """The mesh of a template, ready to be drawn onto silhouettes.

    Args:
        template: whose mesh; vertices that a seam has split move as one.
        config: weights.
    """

    def __init__(self, template: Template, config: LaplacianConfig) -> None:
        self.config = config
        self.weld, first = template.weld()
        places, faces = template.vertices[first], self.weld[template.faces]
        faces = faces[(faces != np.roll(faces, 1, 1)).all(1)]
        matrix, area = laplacian(places, faces)
        self.bending = bending(matrix, area, (config.edge / config.unit) ** 2)
        self.area = area / area.sum()

    def refine(
        self, posed: Floats, pairs: Pairs, cameras: Camera, heights: Sequence[float]
    ) -> Floats:
        """The surface (V, 3) of one frame that meets silhouettes, from a posed one.

        Args:
            posed: (V, 3) m, whose shape is kept.
            pairs: what a surface has in common with the silhouettes.
            cameras: C views of the frame, (1, C) or (C,).
            heights: of the upright person in every view, px.
        """
        surface, shift, factor = posed, np.zeros((len(self.area), 3)), None
        for _ in range(self.config.rounds):
            rows = [
                self._rays(surface, found, cameras.select([view]), height)
                for view, (found, height) in enumerate(zip(pairs(surface), heights, strict=True))
            ]
            rays = [each for each in rows if each is not None]
            shift, factor = self._solve(posed, rays, shift, factor)
            surface = posed + shift[self.weld]
        return surface

    def _rays(self, surface: Floats, found: Matches, camera: Camera, height: float) -> _Rays | None:
        """Pairs of one view as linear equations in the places of vertices."""
        if not len(found):
            return None
        points = np.einsum("ps,psk->pk", found.weights, surface[found.vertices])
        at = torch.from_numpy(points)
        pixels, slopes = camera.linearize(at)
        local = camera.to_camera(at).reshape(-1, 3)
        pixel = 0.01 * self.config.pixel * height
        weight = self.config.alpha / pixel**2 * found.confidence * (local[:, 2] > NEAR).numpy()
        slope = slopes.reshape(-1, 2, 3).numpy()
        missing = found.target - pixels.reshape(-1, 2).numpy()
        if self.config.slides:
            slope = np.einsum("pr,prk->pk", found.normal, slope)[:, None]
            missing = np.einsum("pr,pr->p", found.normal, missing)[:, None]
        vertices = self.weld[found.vertices]
        return _Rays(vertices, found.weights, points, slope, missing, weight)

    def _solve(
        self, posed: Floats, rays: Sequence[_Rays], start: Floats, factor: SuperLU | None
    ) -> tuple[Floats, SuperLU | None]:
        """Shifts (U, 3) of the welded vertices, by conjugate gradients from those before.

        What pairs hold on average hardly changes between rounds: the factor of the first one
        preconditions all of them.
        """
        size = len(self.area)
        if not rays:
            return np.zeros((size, 3)), factor
        parts = [each.normal(posed, self.weld, size) for each in rays]
        pull = np.sum([part.right for part in parts], 0)
        blocks = [part.matrix for part in parts]
        pairs = sum(len(each.weight) for each in rays)
        tether = self.config.alpha * pairs / self.config.reach**2 * self.area
        slack = _SLACK * float(self.bending.diagonal().mean())
        bend = csr_array(self.bending + diags_array(tether + slack))
        if factor is None:
            held = np.sum([part.held for part in parts], 0)
            factor = splu(
                csc_array(bend + diags_array(held)),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        known = factor

        def curved(shift: Floats) -> Floats:
            whole: Floats = (bend @ shift.reshape(size, 3)).ravel()
            for block in blocks:
                whole = whole + block.T @ (block @ shift)
            return whole

        shape = (3 * size, 3 * size)
        solved, _ = cg(
            LinearOperator(shape, curved, dtype=np.float64), pull.ravel(), start.ravel(),
            rtol=_TOLERANCE, maxiter=_MOST,
            M=LinearOperator(
                shape, lambda x: known.solve(x.reshape(size, 3)).ravel(), dtype=np.float64
            ),
        )  # fmt: skip
        shift: Floats = solved.reshape(size, 3)
        return shift, known


def bending(matrix: csr_array, area: Floats, stiffness: float) -> csr_array:
    """Quadratic form of the integral of squared differential coordinates, (U, U).

    Args:
        matrix: conductances of a mesh, (U, U).
        area: of its vertices, (U,), square metres.
        stiffness: factor, per square metre.
    """
    return csr_array(stiffness * (matrix @ diags_array(1 / area) @ matrix))


@dataclass(frozen=True, eq=False)
class _Normal:
    """Rows of equations, their right-hand side in normal form, and what they hold on average."""

    matrix: csr_array
    right: Floats
    held: Floats


@dataclass(frozen=True, eq=False)
class _Rays:
    """Pairs of one view: welded vertices (P, 2) and their shares, and the projection around them.

    Attributes:
        vertices: (P, 2).
        shares: (P, 2).
        points: (P, 3) m.
        slopes: px a metre, (P, R, 3), along R directions of the image: its axes, or a normal.
        missing: px, (P, R).
        weight: per square pixel, (P,).
    """

    vertices: NDArray[np.int64]
    shares: Floats
    points: Floats
    slopes: Floats
    missing: Floats
    weight: Floats

    def normal(self, posed: Floats, weld: NDArray[np.int64], size: int) -> _Normal:
        """In shifts from a posed surface: ``slope (point + shift - here) = missing``."""
        root = np.sqrt(self.weight)[:, None]
        rows = root[..., None] * self.slopes  # P R 3
        first = np.zeros(size, np.int64)
        first[weld] = np.arange(len(weld))
        start = np.einsum("ps,psk->pk", self.shares, posed[first[self.vertices]])
        wanted = root * self.missing + np.einsum("prk,pk->pr", rows, self.points - start)
        values = self.shares[:, None, :, None] * rows[:, :, None, :]  # P R S 3
        count, axes = rows.shape[:2]
        row = np.broadcast_to(np.arange(axes * count).reshape(count, axes, 1, 1), values.shape)
        column = np.broadcast_to(3 * self.vertices[:, None, :, None] + np.arange(3), values.shape)
        matrix = csr_array(
            coo_array((values.ravel(), (row.ravel(), column.ravel())), (axes * count, 3 * size))
        )
        right = (matrix.T @ wanted.ravel()).reshape(size, 3)
        strength = (rows**2).sum((1, 2)) / 3
        held = np.bincount(
            self.vertices.ravel(), (strength[:, None] * self.shares**2).ravel(), size
        )
        return _Normal(matrix, right, held.astype(np.float64))
