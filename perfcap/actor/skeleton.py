"""Articulated kinematics in closed form."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from perfcap.actor import _kinematics_torch
from perfcap.actor.kinematic_tree import KinematicTree, Pose
from perfcap.actor.motion import BONES, Motion
from perfcap.actor.rig import Hinge, Rig
from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain

__all__ = ["Hinge", "Pose", "Rig", "Skeleton"]


class Skeleton(nn.Module):
    """Kinematics of a tree of joints whose rotations are products of hinges.

    A joint turns by ``prod_k R(a_k, angle_k) @ C`` relative to its parent, where C undoes the
    rest angles: at the rest angles every joint is at its rest position, unturned. With a
    motion's shared block ``"bones"``, bones of group g are longer by ``exp(bones_g)``.
    """

    lower: Tensor
    upper: Tensor
    rest_angles: Tensor
    rest_positions: Tensor
    rest_landmarks: Tensor

    def __init__(self, rig: Rig) -> None:
        super().__init__()
        self.rig = rig
        self.tree = KinematicTree(rig)
        self.angle_names = tuple(hinge.name for hinge in rig.hinges)
        self.group_names = self.tree.group_names
        self.register_buffer("rest_positions", rig.positions.clone())
        self.register_buffer("rest_landmarks", rig.landmark_positions.to(rig.positions).clone())
        for buffer, name in (("lower", "lower"), ("upper", "upper"), ("rest_angles", "rest")):
            values = rig.positions.new_tensor([getattr(hinge, name) for hinge in rig.hinges])
            self.register_buffer(buffer, values)

    @property
    def bounds(self) -> tuple[Tensor, Tensor]:
        """Lower and upper limits of a frame's 6 + A coordinates; infinite for the root."""
        free = self.lower.new_full((6,), torch.inf)
        return torch.cat((-free, self.lower)), torch.cat((free, self.upper))

    def rest_motion(self, frames: int = 1) -> Motion:
        """The rest pose, repeated: (F, ...)."""
        zero = self.lower.new_zeros(frames, 3)
        return Motion(
            self.rest_positions[0].expand(frames, 3), zero, self.rest_angles.expand(frames, -1)
        )

    def forward(self, motion: Motion) -> Pose:
        """Posed joints and landmarks of a motion (*b, F).

        Raises:
            InputError: the motion is of another number of angles.
        """
        self._require_angles(motion)
        if not self._is_plain(motion):
            return _kinematics_torch.place(self.tree, motion)
        from perfcap.actor import _kinematics_numba

        return _kinematics_numba.place(self.tree, motion)

    def linearize(self, motion: Motion) -> tuple[Tensor, Tensor, Tensor | None]:
        """Landmarks (*b, F, L, 3) and their derivatives in closed form.

        Returns:
            landmarks: (*b, F, L, 3), metres.
            frame: derivative in the frame's tangent (translation, rotation, angles),
                (*b, F, L, 3, 6 + A): an angle moves a point by axis x (point - joint).
            shared: derivative in ``"bones"``, (*b, F, L, 3, S), None where they are known.
        """
        self._require_angles(motion)
        if not self._is_plain(motion):
            return _kinematics_torch.linearize(self.tree, motion)
        from perfcap.actor import _kinematics_numba

        # bones may be learned, in place: what is kept for a motion belongs to their present values
        bones = self.tree.bone_vectors
        key = self, bones, 0 if bones.is_inference() else bones._version
        return motion.once(key, lambda: _kinematics_numba.linearize(self.tree, motion))

    def _require_angles(self, motion: Motion) -> None:
        """Compiled loops believe the shapes they are given."""
        own, given = self.tree.bone_vectors.device, motion.angles.device
        if own != given:
            raise InputError(
                f"motion is on {given}, the skeleton on {own}; take it there with motion.to(tensor)"
            )
        if motion.angles.shape[-1] != len(self.angle_names):
            raise InputError(
                f"motion has angles {tuple(motion.angles.shape)}, expected (*b, F, "
                f"{len(self.angle_names)}): those of this skeleton, by angle_names"
            )
        bones, count = motion.shared.get(BONES), len(self.group_names)
        if bones is not None and (bones.shape[-1:] != (count,) or bones.ndim >= motion.angles.ndim):
            raise InputError(
                f"motion shares bones {tuple(bones.shape)}, expected (*b, {count}): one number a "
                "bone group, by group_names, for all frames of a clip"
            )

    def _is_plain(self, motion: Motion) -> bool:
        """Whether compiled loops may be used: only numbers are asked for, on the CPU."""
        unknowns = motion.translation, motion.rotation, motion.angles, motion.shared.get(BONES)
        return is_plain(self.tree.bone_vectors, *unknowns)
