"""Distance between the joints and the 3D joints that a network predicts from one image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.detect.detections import Detections
from perfcap.detect.retarget import bone_chains, bone_vectors
from perfcap.energy._arguments import (
    known_places,
    require_cameras,
    require_frames,
    require_moved,
    require_unit,
    seen_by,
)
from perfcap.energy._point_curvature import point_curvature
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import is_plain
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.second_order import SecondOrder

if TYPE_CHECKING:
    from perfcap.energy._joint_position_numba import Known

SHORTEST = 1e-9  # a bone of no length has no direction


class JointPosition(Energy[Motion]):
    """3D joint alignment with a free translation a frame (Xu et al. 2018, Eq. 5 and 6).

    Predictions are relative to the root and in camera axes. Only the directions of their bones
    count: a network predicts an average skeleton (the paper rescales it to the actor). They are
    laid end to end, each as long as in the pose. Lengths taken from the rest pose instead would
    be wrong where a joint lies between the ends of a bone: from the middle of the hips to the
    neck a bent back is up to ten centimetres shorter than a straight one.

    The unknown translation t_f is eliminated in closed form: its optimum is the weighted mean of
    (joint - prediction), so differences are centred over the joints. With ``unit`` (J,) the
    weights of that mean are ``1 / unit^2``, which keeps the elimination exact; joints that are
    predicted well (the hips, near the root) then place the prediction.

    A residual group is one joint in one view, 3 entries, in ``unit``. Frames that are not trusted
    are left out (Eq. 6).

    Args:
        points: the 16 landmarks, such as ``actor.landmarks``.
        cameras: C views; only their rotation matters.
        detections: with ``joints3d`` (*b, F, C, 16, 3), in any unit of length, and
            ``trusted3d`` (*b, F, C).
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one, a number or (16,).
    """

    coupling = Coupling.FRAME
    direction: Tensor
    bones: Tensor
    chain: Tensor
    scale: Tensor
    share: Tensor
    confidence: Tensor

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
        if detections.joints3d is None:
            raise ValueError("JointPosition needs detections with joints3d; these have none")
        if detections.views != cameras.views:
            raise InputError(
                f"detections are of {detections.views} views, cameras of {cameras.views}; give one "
                "camera a view, in the same order"
            )
        require_cameras(cameras)
        self.points, self.sees = points, seen_by(points)
        trusted = detections.trusted3d.to(detections.joints3d)
        confidence = trusted[..., None].expand(detections.joints3d.shape[:-1])
        predicted = known_places(detections.joints3d, confidence, "joints3d")
        count = predicted.shape[-2]
        scale = (1 / torch.as_tensor(unit).to(predicted)).expand(count)
        self.register_buffer("scale", scale)
        self.register_buffer("share", scale.square() / scale.square().sum())
        bones = bone_vectors(predicted) @ cameras.rotation  # R^T b for every row vector b
        length = bones.norm(dim=-1, keepdim=True).clamp(min=SHORTEST)
        self.register_buffer("direction", bones / length)
        self.register_buffer("bones", bone_vectors(torch.eye(count).to(predicted)))
        self.register_buffer("chain", bone_chains().to(predicted))
        self.register_buffer("confidence", confidence.flatten(-2))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, C * 16, 3)."""
        return self._residual(self.points(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form: centred joint derivatives, the same for every view."""
        joints, frame, shared = self.points.linearize(motion)
        require_moved(joints, frame, motion.frame_dim)
        return Linearization(
            self._residual(joints),
            self._derivative(joints, frame),
            None if shared is None else self._derivative(joints, shared),
        )

    def add_to_blocks(self, motion: Motion, curvature: Tensor, gradient: Tensor) -> Tensor | None:
        """Compiled, for predictions of the motion's own shape; see ``OffersBlocks``."""
        own = self.direction, self.bones, self.chain, self.share, self.scale, self.confidence
        fits = self.direction.shape[:-3] == motion.angles.shape[:-1]
        if not (fits and is_plain(curvature, gradient, *own) and is_plain(self.weight)):
            return None
        from perfcap.energy import _joint_position_numba
        from perfcap.solve._robust_numba import as_numbers

        kernel = as_numbers(self.kernel)
        joints, frame, shared = self.points.linearize(motion)
        self._require_joints(joints)
        if kernel is None or shared is not None or not is_plain(joints, frame):
            return None
        require_moved(joints, frame, gradient.shape[-1])
        strength, blocks = (self.confidence, self.weight), (curvature, gradient)
        return _joint_position_numba.add_to_blocks(
            self._known(), strength, joints, frame, kernel, blocks
        )

    def second_order(self, motion: Motion, pull: Tensor) -> SecondOrder:
        """Closed form: only the lengths of bones are not linear in the joints."""
        linearized = self.points.linearize(motion)
        joints, frame, shared = linearized
        scaled = (
            pull.reshape(*joints.shape[:-2], -1, *joints.shape[-2:]) * self.scale[:, None]
        )  # *b F C J 3
        centred = scaled - self.share[:, None] * scaled.sum(-2, keepdim=True)
        on_lengths = -((self.chain.mT @ centred) * self.direction).sum((-3, -1))  # *b F J
        bones = bone_vectors(joints)
        length = bones.norm(dim=-1, keepdim=True).clamp(min=SHORTEST)
        along = bones / length
        on_joints = centred.sum(-3) + self.bones.mT @ (on_lengths.unsqueeze(-1) * along)
        across = torch.eye(3).to(bones) - along.unsqueeze(-1) * along.unsqueeze(-2)
        curvature = (on_lengths.unsqueeze(-1) / length).unsqueeze(-1) * across
        moved = _bone_derivative(frame), None if shared is None else _bone_derivative(shared)
        return point_curvature(self.points, motion, linearized, on_joints, moved, curvature)

    def _residual(self, joints: Tensor) -> Residual:
        self._require_joints(joints)
        if self._compiled_for(joints):
            from perfcap.energy import _joint_position_numba

            return Residual(_joint_position_numba.residual(self._known(), joints), self.confidence)
        length = bone_vectors(joints).norm(dim=-1)[..., None, :, None]  # *b F 1 J 1
        predicted = self.chain @ (length * self.direction)  # *b F C J 3
        error = self._centre(joints.unsqueeze(-3) - predicted)
        return Residual(error.flatten(-3, -2), self.confidence)

    def _require_joints(self, joints: Tensor) -> None:
        """Compiled loops believe the shapes they are given."""
        require_frames(self, self.direction.shape[-4], joints.shape[-3])
        if joints.shape[-2] != self.direction.shape[-2]:
            raise InputError(
                f"points are {joints.shape[-2]}, detections have {self.direction.shape[-2]} "
                "joints; give actor.landmarks"
            )

    def _derivative(self, joints: Tensor, jacobian: Tensor) -> Tensor:
        """Of the residual, (*b, F, C * 16, 3, D), from that of the joints, (*b, F, 16, 3, D)."""
        require_moved(joints, jacobian)
        if self._compiled_for(joints) and is_plain(joints, jacobian):
            from perfcap.energy import _joint_position_numba

            return _joint_position_numba.derivative(self._known(), joints, jacobian)
        bones = bone_vectors(joints)
        along = bones / bones.norm(dim=-1, keepdim=True).clamp(min=SHORTEST)
        turned = _bone_derivative(jacobian)
        length = (along[..., None] * turned).sum(-2)[..., None, :, None, :]  # *b F 1 J 1 D
        lengthened = (length * self.direction[..., None]).flatten(-2)  # *b F C J 3D
        moved = jacobian.flatten(-2).unsqueeze(-3) - self.chain @ lengthened
        views, size = moved.shape[-3], jacobian.shape[-4:]
        return self._centre(moved).reshape(*moved.shape[:-3], views * size[1], *size[2:])

    def _known(self) -> Known:
        """For compiled loops."""
        from perfcap.energy import _joint_position_numba

        constants = self.bones, self.chain, self.share, self.scale
        return _joint_position_numba.Known.of(self.direction, constants, SHORTEST)

    def _compiled_for(self, joints: Tensor) -> bool:
        """Whether only numbers are asked for, of as many frames as there are predictions."""
        return self.direction.shape[:-3] == joints.shape[:-2] and is_plain(
            joints, self.direction, self.scale
        )

    def _centre(self, points: Tensor) -> Tensor:
        """Points or derivatives (..., J, n) minus their weighted mean, in ``unit``."""
        return (points - (self.share @ points).unsqueeze(-2)) * self.scale[:, None]


def _bone_derivative(jacobian: Tensor) -> Tensor:
    """Derivative of the bones from that of the joints, both (*b, F, J, 3, D)."""
    return bone_vectors(jacobian.flatten(-2)).reshape(jacobian.shape)
