"""Distance between the contour of the model and that of the silhouette, along its normals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from perfcap.energy._arguments import require_cameras, require_confidence, require_unit
from perfcap.errors import InputError
from perfcap.geometry.camera import NEAR, Camera
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.sparse import BlockLinearization

if TYPE_CHECKING:  # segment works on images, which nothing here needs
    from perfcap.segment.correspondence import Correspondences


class ContourAlignment(Energy[Any]):
    """Contour points slide along the contour they belong to (Xu et al. 2018, Eq. 11 and 17).

    One class for both equations: what a pose and what a deformation moves are points. A residual
    group is one correspondence in one view: ``normal . (projection - target) / unit``, 1 entry.
    It is zero where the point is behind the camera.

    The energy of a frame is the sum over views of ``weight`` times the mean over correspondences,
    so weights do not grow with the density of contour points. The number that is divided by is
    taken over all frames of a batch element (and all views that see anything): in a window, a
    frame with few correspondences counts for less instead of every one of them for more; frames
    solved as batch elements of their own have exactly the mean of the paper. Confidence is
    inside the kernel, and no part of that number: contours that are trusted less pull less.

    Args:
        points: (*b, F, C * P, 3), those of all views one after the other, as a function of a state:
            ``SkinnedPoints`` or ``EmbeddedPoints``, or another module with their
            ``linearize(state, directions)`` or ``linearize_blocks(state, directions)``.
        cameras: C views, (C,) or (F, C) or (*b, F, C).
        correspondences: (*b, F, C, P).
        weight: of the mean, a number or (*b,).
        kernel: acts on the squared residual, in ``unit``.
        unit: pixels that count as one, a number or (C,).

    Raises:
        InputError: cameras and correspondences differ in their number of views.
    """

    coupling = Coupling.FRAME
    points: Any
    target: Tensor
    normal: Tensor
    confidence: Tensor

    def __init__(
        self,
        points: nn.Module,
        cameras: Camera,
        correspondences: Correspondences,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        confidence = correspondences.confidence
        counts = confidence > 0
        if confidence.shape[-2] != cameras.views:
            raise InputError(
                f"correspondences are of {confidence.shape[-2]} views but there are "
                f"{cameras.views} cameras; give one for each"
            )
        require_confidence(confidence)
        require_cameras(cameras)
        super().__init__(weight / _usual_count(counts), kernel)
        require_unit(unit)
        self.points, self.sees = points, getattr(points, "sees", ())
        self.views = [cameras.select([view]) for view in range(cameras.views)]
        scale = (1 / torch.as_tensor(unit).to(confidence))[..., None, None]
        self.register_buffer("confidence", confidence)
        # what has no confidence may be any number, and so may what has no meaning
        none = confidence.new_zeros(())
        self.register_buffer("target", correspondences.target.where(counts[..., None], none))
        normal = scale * correspondences.normal
        self.register_buffer("normal", normal.where(counts[..., None], none))

    def residual(self, state: Any) -> Residual:
        """(*b, F, C * P, 1)."""
        seen = [
            (camera, camera.to_camera(x)) for camera, x in self._by_view(self.points(state), state)
        ]
        pixels = torch.cat([camera.project_camera(local) for camera, local in seen], -3)
        return self._residual(pixels, torch.cat([local for _, local in seen], -3))

    def linearize(self, state: Any) -> Linearization:
        """Closed form where the points have one: derivative of the camera times theirs."""
        if not hasattr(self.points, "linearize"):
            return super().linearize(state)
        residual, rows = self._linearize(self.points(state), state)
        _, of_frame, of_shared = self.points.linearize(state, rows.unsqueeze(-2))
        return Linearization(residual, of_frame, of_shared)

    def linearize_blocks(self, state: Any) -> BlockLinearization:
        """Closed form for points that each see a few blocks of a frame's unknowns."""
        residual, rows = self._linearize(self.points(state), state)
        _, blocks, jacobian = self.points.linearize_blocks(state, rows.unsqueeze(-2))
        return BlockLinearization(residual, blocks, jacobian)

    def _standing(self, state: Any) -> list[Camera]:
        """The camera of each view."""
        return self.views

    def _by_view(self, points: Tensor, state: Any) -> list[tuple[Camera, Tensor]]:
        """The points of each view, (*b, F, P, 3), with its camera."""
        frames, each, count = self.confidence.shape[-3:]
        if points.shape[-3:-1] != (frames, each * count):
            raise InputError(
                f"points have shape {tuple(points.shape)}, correspondences (F, C, P) "
                f"{(frames, each, count)}; expected (*b, F, C P, 3) of the same frames"
            )
        views = points.reshape(*points.shape[:-2], *self.confidence.shape[-2:], 3).unbind(-3)
        return list(zip(self._standing(state), views, strict=True))

    def _linearize(self, points: Tensor, state: Any) -> tuple[Residual, Tensor]:
        """Residual, and its derivative in the points, (*b, F, C * P, 3)."""
        seen = self._by_view(points, state)
        pixels, slopes = zip(*(camera.linearize(x) for camera, x in seen), strict=True)
        local = torch.cat([camera.to_camera(x) for camera, x in seen], -3)
        slope, normal = torch.cat(slopes, -4), self.normal.unsqueeze(-2)  # *b F C P 2 3
        rows = normal[..., 0] * slope[..., 0, :] + normal[..., 1] * slope[..., 1, :]
        rows = rows.where(_in_front(local).unsqueeze(-1), rows.new_zeros(()))
        return self._residual(torch.cat(pixels, -3), local), rows.flatten(-3, -2)

    def _residual(self, pixels: Tensor, local: Tensor) -> Residual:
        """Of pixels (*b, F, C, P, 2) and the same points in camera axes, (*b, F, C, P, 3)."""
        along = (self.normal * (pixels - self.target)).sum(-1)
        along = along.where(_in_front(local), along.new_zeros(()))
        return Residual(along.flatten(-2).unsqueeze(-1), self.confidence.flatten(-2))


def _in_front(local: Tensor) -> Tensor:
    """Whether points in camera axes (..., 3) have a projection, (...)."""
    return local[..., 2] > NEAR


def _usual_count(counts: Tensor) -> Tensor:
    """Mean number of correspondences, (*b,), over the frames and views that have any."""
    each = counts.sum(-1)
    views = (each > 0).sum((-2, -1)).clamp(min=1)
    return (each.sum((-2, -1)) / views.double()).clamp(min=1)
