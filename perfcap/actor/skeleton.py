"""Articulated kinematics in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from perfcap.actor.motion import Motion
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix, skew


@dataclass(frozen=True)
class Hinge:
    """One angle: a joint turning about a fixed axis.

    Attributes:
        name: of the angle.
        joint: the joint that turns.
        axis: unit axis in rest coordinates, carried along by the joint's parent and by the
            joint's earlier hinges.
        lower, upper: limits, radians.
        rest: the angle of the rest pose, radians.
    """

    name: str
    joint: str
    axis: tuple[float, float, float]
    lower: float
    upper: float
    rest: float = 0.0


@dataclass(frozen=True)
class Rig:
    """A skeleton as plain data; lengths in metres, all positions in the rest pose.

    Attributes:
        joints: names, parents before children; the first is the root.
        parents: index of each joint's parent, -1 for the root.
        positions: of the joints, (J, 3).
        hinges: in the order of the angles; a joint's hinges are applied from first (at the
            parent) to last (at the bone).
        landmarks: names of the points that detections speak of.
        landmark_joints: the joint each landmark is rigidly attached to.
        landmark_positions: (L, 3).
        bone_groups: name of the group whose length each bone shares: one for each joint's bone
            from its parent (the root's is ignored), then one for each landmark's from its joint.
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    positions: Tensor
    hinges: tuple[Hinge, ...]
    landmarks: tuple[str, ...]
    landmark_joints: tuple[int, ...]
    landmark_positions: Tensor
    bone_groups: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if any(parent >= joint for joint, parent in enumerate(self.parents)):
            raise InputError("skeleton joints must follow their parents; sort them from the root")
        if not torch.isfinite(self.positions).all():
            raise InputError("skeleton has joint positions that are not finite numbers")


@dataclass(frozen=True)
class Pose:
    """Posed joints: x = rotation @ (x_rest - rest position) + position.

    Attributes:
        rotation: rest to posed, (*b, F, J, 3, 3).
        position: of the joints in the world, (*b, F, J, 3), metres.
        landmarks: in the world, (*b, F, L, 3), metres.
    """

    rotation: Tensor
    position: Tensor
    landmarks: Tensor


class Skeleton(nn.Module):
    """Kinematics of a tree of joints whose rotations are products of hinges.

    A joint turns by ``prod_k R(a_k, angle_k) @ C`` relative to its parent, where C undoes the
    rest angles: at the rest angles every joint is at its rest position, unturned. With shape
    unknowns, bones of group g are longer by ``exp(shape_g)``.
    """

    lower: Tensor
    upper: Tensor
    rest_angles: Tensor
    rest_positions: Tensor
    rest_landmarks: Tensor

    def __init__(self, rig: Rig) -> None:
        super().__init__()
        self.rig = rig
        like = rig.positions
        self.angle_names = tuple(hinge.name for hinge in rig.hinges)
        self.group_names = tuple(dict.fromkeys(rig.bone_groups[1:]))
        self.register_buffer("rest_positions", like.clone())
        self.register_buffer("rest_landmarks", rig.landmark_positions.to(like).clone())
        for name in ("lower", "upper"):
            self.register_buffer(name, like.new_tensor([getattr(h, name) for h in rig.hinges]))
        self.register_buffer("rest_angles", like.new_tensor([h.rest for h in rig.hinges]))
        self._register_hinges(rig)
        self._register_bones(rig)
        self._levels = _levels(rig.parents)

    def _register_hinges(self, rig: Rig) -> None:
        """Hinges, padded to the same number for every joint."""
        like = rig.positions
        joint = [rig.joints.index(hinge.joint) for hinge in rig.hinges]
        count = max((joint.count(j) for j in joint), default=1)
        slots = torch.full((len(rig.joints), count), len(joint))  # the last column is a zero angle
        for angle, j in enumerate(joint):
            slots[j, int((slots[j] < len(joint)).sum())] = angle
        axes = like.new_tensor([h.axis for h in rig.hinges] + [(1.0, 0.0, 0.0)])
        self.register_buffer("_hinge_joint", torch.tensor(joint, dtype=torch.long))
        self.register_buffer("_slots", slots)
        self.register_buffer("_axes", torch.nn.functional.normalize(axes, dim=-1))
        self.register_buffer("_skew", skew(self._axes))
        self.register_buffer("_skew2", self._skew @ self._skew)
        local = self._local_products(self.rest_angles)[..., -1, :, :]
        self.register_buffer("_unrest", local.mT.contiguous())

    def _register_bones(self, rig: Rig) -> None:
        """Bones (joint from parent, then landmark from joint) and which points they lead to."""
        like, count = rig.positions, len(rig.joints)
        start = [max(p, 0) for p in rig.parents] + list(rig.landmark_joints)
        vectors = torch.cat((rig.positions, rig.landmark_positions.to(like))) - rig.positions[start]
        vectors[0] = 0
        chain = torch.zeros(count + len(rig.landmarks), len(start), dtype=like.dtype)
        for joint, parent in enumerate(rig.parents):
            if parent >= 0:
                chain[joint] = chain[parent]
                chain[joint, joint] = 1
        for landmark, joint in enumerate(rig.landmark_joints):
            chain[count + landmark] = chain[joint]
            chain[count + landmark, count + landmark] = 1
        above = torch.zeros(count, count, dtype=torch.bool)  # above[j, i]: i is j or above it
        for joint, parent in enumerate(rig.parents):
            above[joint] = above[parent] if parent >= 0 else False
            above[joint, joint] = True
        moves = above[list(rig.landmark_joints)][:, self._hinge_joint]
        groups = rig.bone_groups or ("body",) * len(start)
        names = self.group_names or ("body",)
        member = torch.tensor([[g == n for n in names] for g in groups])
        member[0] = False
        for name, value in (
            ("_bone_start", torch.tensor(start)),
            ("_bone_vectors", vectors),
            ("_chain", chain),
            ("_moves", moves.to(like)),
            ("_groups", member.to(like)),
        ):
            self.register_buffer(name, value)

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
        """Posed joints and landmarks of a motion (*b, F)."""
        local = self._local_products(motion.angles)[..., -1, :, :]
        return self._place(motion, self._compose(motion, local))[0]

    def linearize(self, motion: Motion) -> tuple[Tensor, Tensor, Tensor | None]:
        """Landmarks (*b, F, L, 3) and their derivatives in closed form.

        Returns:
            landmarks: (*b, F, L, 3), metres.
            frame: derivative in the frame's tangent (translation, rotation, angles),
                (*b, F, L, 3, 6 + A): an angle moves a point by axis x (point - joint).
            shared: derivative in the shape, (*b, F, L, 3, S), None without shape.
        """
        products = self._local_products(motion.angles)
        rotation = self._compose(motion, products[..., -1, :, :])
        pose, bones = self._place(motion, rotation)
        points = pose.landmarks.unsqueeze(-2)  # *b F L 1 3
        joint = self._hinge_joint
        axes = self._world_axes(rotation, products)  # *b F A 3
        arms = (points - pose.position[..., joint, :].unsqueeze(-3)) * self._moves[..., None]
        turned = torch.linalg.cross(axes.unsqueeze(-3), arms)  # *b F L A 3
        root = skew(motion.translation.unsqueeze(-2) - pose.landmarks)  # columns e_k x (p - t)
        eye = torch.eye(3).to(root).expand_as(root)
        frame = torch.cat((eye, root, turned.mT), -1)
        if motion.shape is None:
            return pose.landmarks, frame, None
        chain = self._chain[len(self.rig.joints) :]
        shared = torch.einsum("lb,bs,...bi->...lis", chain, self._groups, bones)
        return pose.landmarks, frame, shared

    def _local_products(self, angles: Tensor) -> Tensor:
        """Partial products of each joint's hinges, then C: (*b, F, J, K + 1, 3, 3).

        Entry k < K is the rotation before hinge k; the last is the whole joint.
        """
        padded = torch.nn.functional.pad(angles, (0, 1))[..., None, None]
        hinges = torch.eye(3).to(padded) + padded.sin() * self._skew
        hinges = hinges + (1 - padded.cos()) * self._skew2
        hinges = hinges[..., self._slots, :, :]  # *b F J K 3 3
        products = [torch.eye(3).to(padded).expand(hinges[..., 0, :, :].shape)]
        for k in range(hinges.shape[-3]):
            products.append(products[-1] @ hinges[..., k, :, :])
        if hasattr(self, "_unrest"):
            products[-1] = products[-1] @ self._unrest
        return torch.stack(products, -3)

    def _compose(self, motion: Motion, local: Tensor) -> Tensor:
        """Rest-to-posed rotation of every joint (*b, F, J, 3, 3), level by level."""
        rotation: list[Tensor] = [local[..., 0, :, :]] * local.shape[-3]
        rotation[0] = rotvec_to_matrix(motion.rotation) @ local[..., 0, :, :]
        for joints in self._levels:
            parents = torch.stack([rotation[self.rig.parents[j]] for j in joints], -3)
            for joint, turned in zip(joints, (parents @ local[..., joints, :, :]).unbind(-3)):
                rotation[joint] = turned
        return torch.stack(rotation, -3)

    def _place(self, motion: Motion, rotation: Tensor) -> tuple[Pose, Tensor]:
        """Joint and landmark positions, and the bones (*b, F, B, 3) in the world."""
        vectors = self._bone_vectors
        if motion.shape is not None:
            scale = (motion.shape @ self._groups.mT).exp()  # *b B
            vectors = vectors * scale[..., None, :, None]
        starts = rotation[..., self._bone_start, :, :]
        bones = (starts @ vectors[..., None]).squeeze(-1)
        points = self._chain @ bones + motion.translation.unsqueeze(-2)
        position, landmarks = points.split((len(self.rig.joints), len(self.rig.landmarks)), -2)
        return Pose(rotation, position, landmarks), bones

    def _world_axes(self, rotation: Tensor, products: Tensor) -> Tensor:
        """Axes of the hinges in the world, (*b, F, A, 3)."""
        joint = self._hinge_joint
        parents = torch.tensor(self.rig.parents).clamp(min=0).to(joint)
        slot = (self._slots[joint] == torch.arange(len(joint)).to(joint)[:, None]).long().argmax(-1)
        before = products[..., joint, slot, :, :] @ self._axes[:-1, :, None]
        return (rotation[..., parents[joint], :, :] @ before).squeeze(-1)


def _levels(parents: tuple[int, ...]) -> list[list[int]]:
    """Joints below the root by depth, so that each level is one batched product."""
    depth = [0] * len(parents)
    for joint, parent in enumerate(parents):
        depth[joint] = depth[parent] + 1 if parent >= 0 else 0
    return [[j for j, d in enumerate(depth) if d == level] for level in range(1, max(depth) + 1)]
