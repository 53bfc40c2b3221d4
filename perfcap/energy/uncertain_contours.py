"""Contours in views of fixed cameras that do not stand quite where they are said to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.uncertain_views import CAMERAS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import left_jacobian, skew
from perfcap.solve.energy import Linearization
from perfcap.solve.kernels import Kernel

if TYPE_CHECKING:  # segment works on images, which nothing here needs
    from perfcap.segment.correspondence import Correspondences


class UncertainContours(ContourAlignment):
    """``ContourAlignment`` of points of a skinned surface, seen by cameras that motions share.

    A camera turned by w and shifted by s sees ``exp(w) (R x + t) + s``, as in ``UncertainViews``;
    without the block ``CAMERAS`` it stands where it is said to.

    Args:
        points: (F, C * P, 3), those of all views one after the other.
        cameras: C fixed views, (C,).
        correspondences: (F, C, P).
        weight: of the mean over a frame's and view's correspondences.
        kernel: acts on the squared residual, in ``unit``.
        unit: pixels that count as one, a number or (C,).

    Raises:
        InputError: cameras that move, or that are of other views than the correspondences.
    """

    def __init__(
        self,
        points: SkinnedPoints,
        cameras: Camera,
        correspondences: Correspondences,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        if cameras.moving:
            raise InputError("cameras move; small errors are found of fixed cameras only")
        super().__init__(points, cameras, correspondences, weight, kernel, unit)
        self.stated, self.sees = cameras, (*self.sees, CAMERAS)

    def linearize(self, state: Motion) -> Linearization:
        """Closed form in poses and cameras."""
        points = self.points(state)
        residual, rows = self._linearize(points, state)
        _, of_frame, _ = self.points.linearize(state, rows.unsqueeze(-2))
        shared = self._of_cameras(points, rows, state) if CAMERAS in state.shared else None
        return Linearization(residual, of_frame, shared)

    def _standing(self, state: Motion) -> list[Camera]:
        """The camera of each view, where the state has it."""
        own, views = state.shared.get(CAMERAS), self.stated.views
        if own is None:
            return self.views
        if tuple(own.shape) != (6 * views,):
            raise InputError(
                f"the motion shares {CAMERAS} of shape {tuple(own.shape)}, expected "
                f"({6 * views},): 6 a view"
            )
        now = self.stated.nudged(own)
        return [now.select([view]) for view in range(views)]

    def _of_cameras(self, points: Tensor, rows: Tensor, state: Motion) -> Tensor:
        """Derivative in turns and shifts of all views, (F, C * P, 1, 6 C).

        Args:
            points: in the world, (F, C * P, 3).
            rows: derivative of the residual in them, likewise.
            state: that has both.
        """
        views, count = self.stated.views, self.confidence.shape[-1]
        turn, shift = state.shared[CAMERAS].reshape(views, 2, 3).unbind(-2)
        turned = left_jacobian(turn)
        found = rows.new_zeros(*rows.shape[:-1], 1, 6 * views)
        for view, (camera, x) in enumerate(self._by_view(points, state)):
            part = slice(view * count, (view + 1) * count)
            local = camera.to_camera(x)[..., 0, :, :]  # F P 3
            along = rows[..., part, :] @ camera.rotation[0].mT  # in camera axes
            lever = -skew(local - shift[view]) @ turned[view]
            own = torch.cat(((along.unsqueeze(-2) @ lever).squeeze(-2), along), -1)
            found[..., part, 0, 6 * view : 6 * view + 6] = own
        return found
