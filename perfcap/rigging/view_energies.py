"""What calibrated views say about the pose and shape of a body model."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.silhouette_overlap import SilhouetteOverlap
from perfcap.geometry.camera import Camera
from perfcap.geometry.product import multiply_views
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.rigging.shaped_points import ShapedPoints
from perfcap.solve import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel


class LandmarkReprojection(Energy[Motion]):
    """Confidence-weighted reprojection error of landmarks that move with pose and shape.

    The counterpart of ``perfcap.energy.Reprojection`` for body models (MuVS Eq. 3).

    Args:
        landmarks: L of them, in the order of the detections.
        cameras: C views, (C,) or (F, C).
        detections: (F, C, L).
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: pixels that count as one in each view, (C,).
    """

    coupling = Coupling.FRAME
    sees_shared = True
    scale: Tensor

    def __init__(
        self,
        landmarks: ShapedPoints,
        cameras: Camera,
        detections: Detections,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        super().__init__(weight, kernel)
        self.landmarks, self.cameras, self.detections = landmarks, cameras, detections
        self.register_buffer("scale", 1 / torch.as_tensor(unit).to(detections.joints2d))

    def residual(self, motion: Motion) -> Residual:
        """(F, C * L, 2)."""
        return self._residual(self.cameras.project(self.landmarks(motion)))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: camera derivative times landmark derivative."""
        points, frame, shared = self.landmarks.linearize(motion)
        pixels, camera = self.cameras.linearize(points)  # F C L 2 3
        camera = camera * self.scale[..., None, None, None]
        of_frame = multiply_views(camera, frame.contiguous()).flatten(-4, -3)
        of_shared = multiply_views(camera, shared.contiguous()).flatten(-4, -3)
        return Linearization(self._residual(pixels), of_frame, of_shared)

    def _residual(self, pixels: Tensor) -> Residual:
        error = (pixels - self.detections.joints2d) * self.scale[..., None, None]
        return Residual(error.flatten(-3, -2), self.detections.confidence2d.flatten(-2))


class ShapedSilhouette(Energy[Motion]):
    """``SilhouetteOverlap`` of a body whose shape is unknown as well (Rhodin et al. 2016, Sec. 5).

    Args:
        surface: all vertices of the body.
        silhouette: draws them.
        cameras: C views, (C,) or (F, C).
        masks: (F, C, H, W).
        known: which of their pixels count, of a shape that broadcasts to theirs.
        weight: of the energy.
        kernel: acts on the squared norm of a view.
    """

    coupling = Coupling.FRAME
    sees_shared = True

    def __init__(
        self,
        surface: ShapedPoints,
        silhouette: SoftSilhouette,
        cameras: Camera,
        masks: Tensor,
        known: Tensor | None = None,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
    ) -> None:
        super().__init__(weight, kernel)

        def points(corners: Tensor, _: Tensor) -> _Vertices:
            return _Vertices(surface, corners.squeeze(-1))

        self.overlap = SilhouetteOverlap(surface, silhouette, cameras, masks, known, points=points)

    def residual(self, motion: Motion) -> Residual:
        """(F, C, H * W)."""
        return self.overlap.residual(motion)

    def linearize(self, motion: Motion) -> Linearization:
        """As of the overlap, whose columns are those of the frame, then those of the shape."""
        both = self.overlap.linearize(motion)
        frame, shared = both.frame.tensor_split((motion.frame_dim,), -1)
        return Linearization(both.residual, frame, shared)


@dataclass(frozen=True)
class _Vertices:
    """Vertices of the body that differ from frame to frame, (F, N)."""

    surface: ShapedPoints
    index: Tensor

    def linearize(self, motion: Motion) -> tuple[Tensor, Tensor]:
        """Points (F, N, 3) and their derivative in frame and shape, (F, N, 3, D + S)."""
        points, derivative = [], []
        for frame, index in enumerate(self.index):
            one = motion[frame : frame + 1]
            place, of_frame, of_shape = self.surface.at(index.numpy()).linearize(one)
            points.append(place)
            derivative.append(torch.cat((of_frame, of_shape), -1))
        return torch.cat(points), torch.cat(derivative)
