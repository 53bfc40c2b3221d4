"""Distance between the joints and the 3D joints that a network predicts from one image."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel


class JointPosition(Energy[Motion]):
    """3D joint alignment with a free translation a frame (Xu et al. 2018, Eq. 5 and 6).

    Predictions are relative to the root and in camera axes; they are rotated into the world, and
    the unknown translation t_f is eliminated in closed form: its optimum is the weighted mean of
    (joint - prediction), so both sides are centred over the joints. With ``unit`` (J,) the
    weights of that mean are ``1 / unit^2``, which keeps the elimination exact; joints that are
    predicted well (the hips, near the root) then place the prediction.

    A residual group is one joint in one view, 3 entries, in ``unit``. Predictions must have the
    actor's bone lengths (see ``retarget``); frames that are not trusted are left out (Eq. 6).

    Args:
        actor: gives the joints.
        cameras: C views; only their rotation matters.
        detections: with ``joints3d`` (*b, F, C, 16, 3) m and ``trusted3d`` (*b, F, C).
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one, a number or (16,).
    """

    coupling = Coupling.FRAME
    sees_shared = True
    target: Tensor
    scale: Tensor
    share: Tensor
    confidence: Tensor

    def __init__(
        self,
        actor: Actor,
        cameras: Camera,
        detections: Detections,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        super().__init__(weight, kernel)
        if detections.joints3d is None:
            raise ValueError("JointPosition needs detections with joints3d; these have none")
        self.actor = actor
        points = detections.joints3d
        count = points.shape[-2]
        scale = (1 / torch.as_tensor(unit).to(points)).expand(count)
        self.register_buffer("scale", scale)
        self.register_buffer("share", scale.square() / scale.square().sum())
        world = points @ cameras.rotation  # R^T d for every row vector d
        self.register_buffer("target", self._centre(world))
        trusted = detections.trusted3d.to(points)
        self.register_buffer("confidence", trusted[..., None].expand(points.shape[:-1]).flatten(-2))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, C * 16, 3)."""
        return self._residual(self.actor.joints(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: centred joint derivatives, the same for every view."""
        joints, frame, shared = self.actor.skeleton.linearize(motion)
        views = self.target.shape[-3]
        return Linearization(
            self._residual(joints),
            self._repeat(frame, views),
            None if shared is None else self._repeat(shared, views),
        )

    def _residual(self, joints: Tensor) -> Residual:
        error = self._centre(joints).unsqueeze(-3) - self.target  # *b F C J 3
        return Residual(error.flatten(-3, -2), self.confidence)

    def _centre(self, points: Tensor) -> Tensor:
        """Points or derivatives (..., J, n) minus their weighted mean, in ``unit``."""
        return (points - (self.share @ points).unsqueeze(-2)) * self.scale[:, None]

    def _repeat(self, jacobian: Tensor, views: int) -> Tensor:
        """Centre a Jacobian (*b, F, J, 3, D) over joints and repeat it for the views."""
        centred = self._centre(jacobian.flatten(-2)).reshape(jacobian.shape)
        expanded = centred.unsqueeze(-4).expand(*centred.shape[:-3], views, *centred.shape[-3:])
        return expanded.flatten(-4, -3)
