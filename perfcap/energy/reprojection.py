"""Pixel distance between projected and detected joints."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.detect.detections import Detections
from perfcap.energy._arguments import (
    known_places,
    require_cameras,
    require_confidence,
    require_moved,
    require_unit,
    seen_by,
)
from perfcap.energy._point_curvature import point_curvature
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import is_plain
from perfcap.geometry.product import multiply_views
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.second_order import SecondOrder


class Reprojection(Energy[Motion]):
    """Confidence-weighted reprojection error in all views (Xu et al. 2018, Eq. 4; MuVS Eq. 3).

    A residual group is one joint in one view: (projected - detected) / unit, 2 entries. The sum
    runs over frames, views and joints; the paper's means belong into ``weight``.

    Args:
        points: N joints, such as ``actor.landmarks``, in the order of the detections.
        cameras: C views, (C,) or (F, C) or (*b, F, C).
        detections: (*b, F, C, N).
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: pixels that count as one, a number or (C,): with a unit in proportion to the size of
            the person in the image, weights and kernels hold for any resolution.

    Raises:
        InputError: a unit or confidences that are none, joints that are no numbers, or cameras that
            are none.
    """

    coupling = Coupling.FRAME
    scale: Tensor

    def __init__(
        self,
        points: Points,
        cameras: Camera,
        detections: Detections,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        super().__init__(weight, kernel)
        require_unit(unit)
        sure = detections.confidence2d
        require_confidence(sure, "confidence2d")
        require_cameras(cameras)
        places = known_places(detections.joints2d, sure, "joints2d")
        detections = replace(detections, joints2d=places)
        self.points, self.sees = points, seen_by(points)
        self.cameras, self.detections = cameras, detections
        self.register_buffer("scale", 1 / torch.as_tensor(unit).to(detections.joints2d))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, C * N, 2)."""
        return self._residual(self.cameras.project(self.points(motion)))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: camera derivative times joint derivative."""
        joints, frame, shared = self.points.linearize(motion)
        require_moved(joints, frame, motion.frame_dim)
        pixels, camera = self.cameras.linearize(joints)  # *b F C J 2 3
        camera = camera * self.scale[..., None, None, None]
        of_frame = multiply_views(camera, frame).flatten(-4, -3)
        of_shared = None if shared is None else multiply_views(camera, shared).flatten(-4, -3)
        return Linearization(self._residual(pixels), of_frame, of_shared)

    def add_to_blocks(self, motion: Motion, curvature: Tensor, gradient: Tensor) -> Tensor | None:
        """Compiled, for detections of the motion's own shape; see ``OffersBlocks``."""
        seen = self.detections
        own = seen.joints2d, seen.confidence2d, self.scale
        fits = seen.confidence2d.shape[:-2] == motion.coordinates().frame.shape[:-1]
        if not (fits and is_plain(curvature, gradient, *own) and is_plain(self.weight)):
            return None
        from perfcap.energy import _reprojection_numba
        from perfcap.solve._robust_numba import as_numbers

        kernel = as_numbers(self.kernel)
        joints, frame, shared = self.points.linearize(motion)
        if kernel is None or shared is not None or not is_plain(joints, frame):
            return None
        require_moved(joints, frame, gradient.shape[-1])
        projected = self.cameras.linearize(joints)
        if not is_plain(*projected) or projected[0].shape[:-1] != seen.confidence2d.shape:
            return None
        strength, blocks = (self.scale, self.weight), (curvature, gradient)
        return _reprojection_numba.add_to_blocks(seen, strength, projected, frame, kernel, blocks)

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form but for the bend of the cameras, which is differentiated twice."""
        linearized = self.points.linearize(motion)
        joints = linearized[0]
        pixels, camera = self.cameras.linearize(joints)
        on_pixels = pull.reshape(pixels.shape) * self.scale[..., None, None]
        on_joints: Tensor = (on_pixels.unsqueeze(-2) @ camera).squeeze(-2).sum(-3)

        curvature = self._bend(joints, on_pixels)
        return point_curvature(self.points, motion, linearized, on_joints, curvature=curvature)

    def _bend(self, joints: Tensor, on_pixels: Tensor) -> Tensor:
        """Second derivative of ``<on_pixels, pixels>`` in each joint, (*b, F, J, 3, 3)."""
        with torch.enable_grad():
            points = joints.detach().requires_grad_()
            value = (on_pixels.detach() * self.cameras.project(points)).sum()
            (slope,) = torch.autograd.grad(value, points, create_graph=True)
            rows = [
                torch.autograd.grad(axis.sum(), points, retain_graph=True)[0]
                for axis in slope.unbind(-1)
            ]
        return torch.stack(rows, -2)

    def _residual(self, pixels: Tensor) -> Residual:
        given = self.detections.joints2d.shape[-4:-1]
        if pixels.shape[-4:-1] != given:
            raise InputError(
                f"detections have (F, C, J) {tuple(given)}, the motion in these cameras "
                f"{tuple(pixels.shape[-4:-1])}; expected the same frames, views and joints"
            )
        error = (pixels - self.detections.joints2d) * self.scale[..., None, None]
        return Residual(error.flatten(-3, -2), self.detections.confidence2d.flatten(-2))
