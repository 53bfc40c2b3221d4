"""What kinematics needs to know of a rig, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from perfcap.actor.rig import Rig
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix

# --- How far clavicles turn, and the derivatives: what kinematics needs of ``Rig.clavicles`` ------
#
# With the angles a and b of the two hinges that lift an arm, its elevation E from hanging has
# ``cos E = cos a cos b``, and a clavicle turns by ``range * (sin(E / 2)^4 - its value at rest)``,
# where ``sin(E / 2)^2 = (1 - cos a cos b) / 2``.


class ClavicleTurns(nn.Module):
    """The K clavicles of a rig as tensors.

    Attributes:
        count: K.
        joint: of each clavicle, (K,).
        carried: the joint whose place each carries, (K,).
        lifts: the two angles that each turns with, (K, 2).
        axes: unit axes in rest coordinates, (K, 3).
        range: radians, (K,).
        rest: value of the rhythm at the rest angles, (K,).
        spread: 1 where an angle is one of a clavicle's two, else 0, (K, 2, A).
    """

    joint: Tensor
    carried: Tensor
    lifts: Tensor
    axes: Tensor
    range: Tensor
    rest: Tensor
    spread: Tensor

    def __init__(self, rig: Rig) -> None:
        super().__init__()
        like, every = rig.positions, rig.clavicles
        self.count = len(every)
        angle = {hinge.name: index for index, hinge in enumerate(rig.hinges)}
        lifts = torch.tensor([[angle[n] for n in c.lifts] for c in every]).long().reshape(-1, 2)
        rest = like.new_tensor([hinge.rest for hinge in rig.hinges])
        axes = like.new_tensor([c.axis for c in every]).reshape(-1, 3)
        for name, value in (
            ("joint", torch.tensor([rig.joints.index(c.joint) for c in every]).long()),
            ("carried", torch.tensor([rig.joints.index(c.carried) for c in every]).long()),
            ("lifts", lifts),
            ("axes", nn.functional.normalize(axes, dim=-1)),
            ("range", like.new_tensor([c.range for c in every])),
            ("rest", _height(rest[lifts]).square()),
            ("spread", (lifts[..., None] == torch.arange(len(rest))).to(like)),
        ):
            self.register_buffer(name, value)

    def forward(self, angles: Tensor) -> Tensor:
        """Turns (*b, F, K), radians, of angles (*b, F, A)."""
        turns: Tensor = self.range * (_height(angles[..., self.lifts]).square() - self.rest)
        return turns

    def slopes(self, angles: Tensor) -> Tensor:
        """Derivative of the turns in the two angles that lift the arm, (*b, F, K, 2)."""
        lifts = angles[..., self.lifts]
        return 2 * self.range[:, None] * _height(lifts)[..., None] * _height_slopes(lifts)

    def curvatures(self, angles: Tensor) -> Tensor:
        """Second derivative of the turns in those two angles, (*b, F, K, 2, 2)."""
        lifts = angles[..., self.lifts]
        height, slopes = _height(lifts)[..., None, None], _height_slopes(lifts)
        a, b = lifts.unbind(-1)
        same, mixed = 0.5 * a.cos() * b.cos(), -0.5 * a.sin() * b.sin()
        bent = torch.stack((same, mixed, mixed, same), -1).reshape(*same.shape, 2, 2)
        squared = slopes[..., :, None] * slopes[..., None, :]
        return 2 * self.range[:, None, None] * (squared + height * bent)

    def arms(self, rotation: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
        """World axes of the clavicles, and from where they begin to what they carry, (*b, F, K, 3).

        Args:
            rotation: of the joints, rest to posed, (*b, F, J, 3, 3).
            position: of the joints, (*b, F, J, 3), metres.
        """
        axes = (rotation[..., self.joint, :, :] @ self.axes[..., None]).squeeze(-1)
        return axes, position[..., self.carried, :] - position[..., self.joint, :]

    def drifts(self, rotation: Tensor, position: Tensor, angles: Tensor) -> Tensor:
        """How fast each angle shifts all that it moves, through a clavicle, (*b, F, A, 3)."""
        moved = torch.linalg.cross(*self.arms(rotation, position))
        return torch.einsum("...ki,kia,...kc->...ac", self.slopes(angles), self.spread, moved)

    def fold(self, jacobian: Tensor, angles: Tensor) -> Tensor:
        """Derivatives in the turns of the clavicles put to the account of the angles.

        Args:
            jacobian: in a frame's unknowns, of which the angles come last, and in the turns,
                (*b, F, ..., D + K).
            angles: (*b, F, A).

        Returns:
            (*b, F, ..., D).
        """
        if not self.count:
            return jacobian
        own, turned = jacobian.tensor_split((jacobian.shape[-1] - self.count,), -1)
        share = torch.einsum("...ki,kia->...ka", self.slopes(angles), self.spread)
        more = jacobian.dim() - share.dim()
        share = share.reshape(*share.shape[:-2], *(1,) * more, *share.shape[-2:])
        return own + nn.functional.pad(turned @ share, (own.shape[-1] - angles.shape[-1], 0))


def _height(lifts: Tensor) -> Tensor:
    """``sin(E / 2)^2`` of an arm's elevation E, (..., K), of its angles (..., K, 2)."""
    return 0.5 * (1 - lifts[..., 0].cos() * lifts[..., 1].cos())


def _height_slopes(lifts: Tensor) -> Tensor:
    """Derivative of ``_height``, (..., K, 2)."""
    a, b = lifts.unbind(-1)
    return 0.5 * torch.stack((a.sin() * b.cos(), a.cos() * b.sin()), -1)


# --- What kinematics needs to know of a rig, and what it gives ------------------------------------


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


class KinematicTree(nn.Module):
    """A rig as tensors, shared by the compiled and the plain kinematics.

    *Bones* lead to the joints from their parents, then to the landmarks from their joints.

    Attributes:
        axes: unit axes of the hinges, (A, 3).
        slots: hinges of each joint from first to last, then A where it has no more, (J, K).
        unrest: C, undoes the hinges at the rest angles, (J, 3, 3).
        parents: (J,), -1 for the root.
        hinge_joint: the joint each hinge turns, (A,).
        bone_start: the joint each bone starts at, (J + L,).
        bone_group: the group of each bone, -1 for the root's, (J + L,).
        bone_vectors: in the rest pose, (J + L, 3) metres; zero for the root's.
        chain: 1 where a bone is on the way from the root to a joint or landmark, else 0, indexed
            by point, then bone, (J + L, J + L).
        moves: 1 where an angle moves a landmark, else 0, (L, A).
        jumps: see ``_jumps``, (R, 2 + J).
        order: of the bones, each after the one that it starts at, (J + L,).
        above: 1 where a joint is on the way from the root to another or is it, indexed by the
            lower one first, (J, J); rotations are inherited along it.
        clavicles: joints that turn with angles of others.
    """

    axes: Tensor
    slots: Tensor
    unrest: Tensor
    parents: Tensor
    hinge_joint: Tensor
    bone_start: Tensor
    bone_group: Tensor
    bone_vectors: Tensor
    chain: Tensor
    moves: Tensor
    jumps: Tensor
    order: Tensor
    above: Tensor

    def __init__(self, rig: Rig) -> None:
        super().__init__()
        groups = rig.bone_groups or ("body",) * (len(rig.joints) + len(rig.landmarks))
        self.group_names = tuple(dict.fromkeys(groups[1:]))
        like = rig.positions
        start = [max(parent, 0) for parent in rig.parents] + list(rig.landmark_joints)
        for clavicle in rig.clavicles:
            start[rig.joints.index(clavicle.carried)] = rig.joints.index(clavicle.joint)
        ends = torch.cat((rig.positions, rig.landmark_positions.to(like)))
        axes = like.new_tensor([hinge.axis for hinge in rig.hinges]).reshape(-1, 3)
        joint = torch.tensor([rig.joints.index(h.joint) for h in rig.hinges], dtype=torch.long)
        above = _above(rig.parents)
        for name, value in (
            ("axes", nn.functional.normalize(axes, dim=-1)),
            ("slots", _slots(joint.tolist(), len(rig.joints))),
            ("unrest", _rest_turns(rig, axes).mT.contiguous()),
            ("parents", torch.tensor(rig.parents)),
            ("hinge_joint", joint),
            ("bone_start", torch.tensor(start)),
            ("bone_group", torch.tensor([-1] + [self.group_names.index(g) for g in groups[1:]])),
            ("bone_vectors", ends - rig.positions[start]),
            ("chain", _chain(start).to(like)),
            ("moves", above[list(rig.landmark_joints)][:, joint].to(like)),
            ("jumps", _jumps(rig.parents)),
            ("order", torch.tensor(_starts_first(start))),
            ("above", above.to(like)),
        ):
            self.register_buffer(name, value)
        self.clavicles = ClavicleTurns(rig)
        whole = (each for each in self.named_buffers() if not each[1].is_floating_point())
        self._indices = {name: value.clone() for name, value in whole}

    @property
    def joints(self) -> int:
        """J."""
        return len(self.parents)

    def require_own(self) -> None:
        """Refuse a tree that was changed, as means over all buffers do: they cut whole numbers off.

        Raises:
            InputError: numbers of joints are others than when it was made.
        """
        for name, value in self.named_buffers():
            if name in self._indices and not torch.equal(value, self._indices[name].to(value)):
                raise InputError(
                    f"the actor's {name!r}, numbers of its joints, were changed, as by a moving "
                    "average over all buffers, which cuts them off; average parameters alone "
                    "(use_buffers=False), or leave out what is not floating-point"
                )

    def scaled_bones(self, shape: Tensor | None) -> Tensor:
        """Bone vectors longer by ``exp(shape)``, (*b, J + L, 3); without a shape (J + L, 3)."""
        if shape is None:
            return self.bone_vectors
        scale = shape.exp()[..., self.bone_group.clamp(min=0)]
        return scale[..., None] * self.bone_vectors


def _above(parents: tuple[int, ...]) -> Tensor:
    """Whether joint i is j or above it, [j, i], (J, J)."""
    above = torch.eye(len(parents), dtype=torch.bool)
    for joint, parent in enumerate(parents[1:], 1):
        above[joint] |= above[parent]
    return above


def _slots(hinge_joint: list[int], joints: int) -> Tensor:
    """Hinges of each joint, padded with A to the same number, (J, K)."""
    of_joint = [[a for a, j in enumerate(hinge_joint) if j == joint] for joint in range(joints)]
    longest = max(1, *map(len, of_joint))
    return torch.tensor([h + [len(hinge_joint)] * (longest - len(h)) for h in of_joint])


def _rest_turns(rig: Rig, axes: Tensor) -> Tensor:
    """Product of each joint's hinges at the rest angles, (J, 3, 3)."""
    turns = torch.eye(3).to(axes).repeat(len(rig.joints), 1, 1)
    for hinge, axis in zip(rig.hinges, nn.functional.normalize(axes, dim=-1), strict=True):
        joint = rig.joints.index(hinge.joint)
        turns[joint] = turns[joint] @ rotvec_to_matrix(hinge.rest * axis)
    return turns


def _chain(start: list[int]) -> Tensor:
    """Which bones lead to each joint and landmark, (J + L, J + L); the root's leads nowhere."""
    chain = torch.eye(len(start), dtype=torch.bool)
    chain[0, 0] = False
    for bone in _starts_first(start)[1:]:
        chain[bone] |= chain[start[bone]]
    return chain


def _starts_first(start: list[int]) -> list[int]:
    """Bones in an order in which each follows the one that it starts at; theirs where that will."""
    order = [0]
    while len(order) < len(start):
        order += [b for b, s in enumerate(start) if b not in order and s in order][:1]
    return order


def _jumps(parents: tuple[int, ...]) -> Tensor:
    """Ancestors at distance 1, 2, 4, ... of every body, (R, 2 + J).

    Bodies are 0, which never turns and is everyone's last ancestor, 1, which the root rotation
    turns, and 2 + j for the joints. Products down a chain then take R = log2(depth) batched steps.
    """
    ancestor = torch.tensor([0, 0, *(2 + parent for parent in parents)])
    jumps = []
    while ancestor.any():
        jumps.append(ancestor)
        ancestor = ancestor[ancestor]
    return torch.stack(jumps)
