"""Points of a body model as functions of pose and shape together, with closed-form derivatives."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perfcap.actor.actor import Actor
from perfcap.actor.body_model import BodyModel
from perfcap.actor.frame_twists import frame_twists, moved_joints
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.points import Linearized
from perfcap.detect.joint_set import LANDMARKS

Integers = NDArray[np.int64]
OFFSETS = "offsets"  # shared: where a detector sees landmarks, beside where a body has them


class ShapedPoints(nn.Module):
    """Points that bones carry while the body changes its shape.

    Linear blend skinning of rest points ``v(b)`` about rest joints ``r(b)``, both linear in the
    coefficients b, a motion's shared block ``"body"``:
    ``x = sum_j w_j (R_j (v(b) - r_j(b)) + p_j(b))``. At a fixed pose x is linear in b. Hinges and
    rest angles are those of the mean body.

    Args:
        actor: the mean body, standing where the joints say.
        joints: rest positions of its joints, mean (J, 3) and basis (S, J, 3), metres.
        points: rest points, mean (N, 3) and basis (S, N, 3).
        weights: (N, J), rows sum to one.
        offsets: (O, N, 3), metres: coefficients of the shared block ``"offsets"`` move these
            points, and nothing else, within the joints they ride on. None where there are none.
    """

    sees: Collection[str]
    weights: Tensor
    joint_mean: Tensor
    joint_basis: Tensor
    mean: Tensor
    offsets: Tensor | None
    basis: Tensor

    def __init__(
        self,
        actor: Actor,
        joints: tuple[Tensor, Tensor],
        points: tuple[Tensor, Tensor],
        weights: Tensor,
        offsets: Tensor | None = None,
    ) -> None:
        super().__init__()
        self.skeleton = actor.skeleton
        self.sees = (BODY,) if offsets is None else (BODY, OFFSETS)
        self.register_buffer("offsets", offsets)
        names = ("joint_mean", "joint_basis", "mean", "basis")
        for name, value in zip(names, (*joints, *points), strict=True):
            self.register_buffer(name, value)
        self.register_buffer("weights", weights)
        tree = self.skeleton.tree
        self.register_buffer("moved", moved_joints(tree).to(weights), persistent=False)
        parents = tree.parents.clamp(min=0)
        self.register_buffer("bone_mean", joints[0] - joints[0][parents], persistent=False)
        self.register_buffer("bone_basis", joints[1] - joints[1][:, parents], persistent=False)
        self.register_buffer("chain", tree.chain[: tree.joints, : tree.joints], persistent=False)

    @classmethod
    def of_surface(cls, model: BodyModel, actor: Actor, vertices: Integers | None = None) -> Self:
        """Vertices of a model's surface.

        Args:
            model: the body.
            actor: ``model.actor`` of the mean.
            vertices: of the model, (N,); all if None.
        """
        if vertices is None:
            vertices = np.arange(len(model.surface.mean))
        dense = _joint_weights(model, actor)[vertices]
        index = torch.from_numpy(vertices)
        surface = (model.surface.mean[index], model.surface.basis[:, index])
        return cls(actor, _joints(model, actor), surface, torch.from_numpy(dense).to(surface[0]))

    @classmethod
    def of_landmarks(
        cls, model: BodyModel, actor: Actor, offsets: Sequence[float] | None = None
    ) -> Self:
        """The 16 landmarks, then the skeleton's joints.

        Args:
            model: the body.
            actor: ``model.actor`` of the mean.
            offsets: deviation of where a detector sees each landmark from where the body has it,
                metres, (16,): the coefficients of ``mirrored_offsets`` are unknown too.
        """
        joints = _joints(model, actor)
        rig, count = actor.skeleton.rig, len(actor.skeleton.rig.joints)
        places = [_landmark(model, name) for name in LANDMARKS]
        mean = torch.cat((torch.stack([p for p, _ in places]), joints[0]))
        basis = torch.cat((torch.stack([b for _, b in places], 1), joints[1]), 1)
        moved = None
        if offsets is not None:
            free = mirrored_offsets(offsets).to(basis)
            moved = torch.cat((free, free.new_zeros(len(free), count, 3)), 1)
        owner = torch.tensor([*rig.landmark_joints, *range(count)])
        return cls(actor, joints, (mean, basis), torch.eye(count).to(mean)[owner], moved)

    @classmethod
    def of_rest(
        cls, model: BodyModel, actor: Actor, points: tuple[Tensor, Tensor], weights: Tensor
    ) -> Self:
        """Any points of the rest pose, mean (N, 3) and basis (S, N, 3), with weights (N, J)."""
        return cls(actor, _joints(model, actor), points, weights)

    def at(self, index: Integers) -> ShapedPoints:
        """Some of the points, (N,)."""
        some = copy(self)  # shares the skeleton and the joints
        some._buffers = dict(self._buffers)
        rows = torch.from_numpy(index).to(self.mean.device)
        for name, axis in (("mean", 0), ("basis", 1), ("weights", 0), ("offsets", 1)):
            known = self._buffers[name]
            some.register_buffer(name, None if known is None else known.index_select(axis, rows))
        return some

    def chosen(self, corners: Tensor, _: Tensor) -> ChosenPoints:
        """Points (F, N, 1) that differ from frame to frame, each of weight one."""
        return ChosenPoints(self, corners.squeeze(-1))

    @property
    def count(self) -> int:
        """N."""
        return len(self.weights)

    def forward(self, motion: Motion) -> Tensor:
        """Points in the world, (*b, F, N, 3), metres."""
        rotation, position, rest = self._joints(motion)
        return self._blend(motion, rotation, position, rest)

    def linearize(self, motion: Motion) -> Linearized:
        """Points, and their derivatives in the frame's tangent and in what is shared.

        Returns:
            points (*b, F, N, 3), frame (*b, F, N, 3, 6 + A), shared (*b, F, N, 3, S + O).
        """
        rotation, position, rest = self._joints(motion)
        local = self._rest_points(motion).unsqueeze(-2) - rest.unsqueeze(-3)  # *b N J 3
        carried = torch.einsum("...fjab,...njb->...fnja", rotation, local)
        carried = carried + position.unsqueeze(-3)  # *b F N J 3
        points = torch.einsum("nj,...fnja->...fna", self.weights, carried)
        twists = frame_twists(self.skeleton.tree, rotation, position, motion.angles)
        turn, shift = twists[..., None, :, :3], twists[..., None, :, 3:]  # *b F 1 D 3
        sums = torch.einsum("nj,ju,...fnja->...fnua", self.weights, self._buffer("moved"), carried)
        share = self.weights @ self._buffer("moved")
        frame = torch.linalg.cross(turn.expand_as(sums), sums) + share[..., None] * shift
        return points, frame.mT, self._shared_derivative(motion, rotation)

    def _buffer(self, name: str) -> Tensor:
        return self.get_buffer(name)

    def _rest_points(self, motion: Motion) -> Tensor:
        points = self.mean + torch.einsum("...s,snk->...nk", _shared(motion, BODY), self.basis)
        if self.offsets is None:
            return points
        return points + torch.einsum("...s,snk->...nk", _shared(motion, OFFSETS), self.offsets)

    def _joints(self, motion: Motion) -> tuple[Tensor, Tensor, Tensor]:
        """Rotation (*b, F, J, 3, 3), position (*b, F, J, 3), and rest positions (*b, J, 3)."""
        shape = _shared(motion, BODY)
        plain = Motion(motion.translation, motion.rotation, motion.angles)
        rotation = self.skeleton(plain).rotation
        bones = self._buffer("bone_mean") + torch.einsum(
            "...s,sjk->...jk", shape, self._buffer("bone_basis")
        )
        parent = rotation[..., self.skeleton.tree.parents.clamp(min=0), :, :]
        turned = (parent @ bones[..., None, :, :, None]).squeeze(-1)
        position = self._buffer("chain") @ turned + motion.translation.unsqueeze(-2)
        rest = self.joint_mean + torch.einsum("...s,sjk->...jk", shape, self.joint_basis)
        return rotation, position, rest

    def _blend(self, motion: Motion, rotation: Tensor, position: Tensor, rest: Tensor) -> Tensor:
        offset = position - (rotation @ rest[..., None, :, :, None]).squeeze(-1)
        turn = torch.einsum("nj,...fjab->...fnab", self.weights, rotation)
        points = (turn @ self._rest_points(motion)[..., None, :, :, None]).squeeze(-1)
        return points + self.weights @ offset

    def _shared_derivative(self, motion: Motion, rotation: Tensor) -> Tensor:
        """Of the points, (*b, F, N, 3, S + O), the blocks in the motion's order."""
        parent = rotation[..., self.skeleton.tree.parents.clamp(min=0), :, :]
        bones = torch.einsum("...jab,sjb->...jas", parent, self._buffer("bone_basis"))
        moved = torch.einsum("kj,...jas->...kas", self._buffer("chain"), bones)
        moved = moved - torch.einsum("...jab,sjb->...jas", rotation, self.joint_basis)
        turn = torch.einsum("nj,...fjab->...fnab", self.weights, rotation)
        carried = torch.einsum("nj,...jas->...nas", self.weights, moved)
        parts = {BODY: carried + torch.einsum("...nab,snb->...nas", turn, self.basis)}
        if self.offsets is not None:
            parts[OFFSETS] = torch.einsum("...nab,snb->...nas", turn, self.offsets)
        return torch.cat([parts[name] for name in motion.shared if name in parts], -1)


@dataclass(frozen=True)
class ChosenPoints:
    """Points of a body that differ from frame to frame, (F, N)."""

    points: ShapedPoints
    index: Tensor

    def linearize(self, motion: Motion) -> Linearized:
        """Points (F, N, 3), frame (F, N, 3, 6 + A), shared (F, N, 3, S + O)."""
        each = [
            self.points.at(index.numpy(force=True)).linearize(motion[frame : frame + 1])
            for frame, index in enumerate(self.index)
        ]
        points, frames, shared = zip(*each, strict=True)
        return torch.cat(points), torch.cat(frames), torch.cat(shared)


def mirrored_offsets(deviations: Sequence[float]) -> Tensor:
    """Displacements of the landmarks that are alike left and right, (K, 16, 3) metres.

    Three for each pair, two within the middle for each of the others.

    Args:
        deviations: displacement at a coefficient of one, (16,) metres.
    """
    rows = []
    for name, size in zip(LANDMARKS, deviations, strict=True):
        if name.startswith("r_"):
            continue
        other = LANDMARKS.index("r" + name[1:]) if name.startswith("l_") else None
        for axis in range(0 if other is not None else 1, 3):
            row = torch.zeros(len(LANDMARKS), 3, dtype=torch.float64)
            row[LANDMARKS.index(name), axis] = size
            if other is not None:
                row[other, axis] = -size if axis == 0 else size
            rows.append(row)
    return torch.stack(rows)


def _shared(motion: Motion, name: str) -> Tensor:
    """Coefficients of a shared block."""
    if name not in motion.shared:
        raise ValueError(f"motion of a body model needs a shared block {name!r}; it has none")
    return motion.shared[name]


def _joints(model: BodyModel, actor: Actor) -> tuple[Tensor, Tensor]:
    """Mean and basis of the skeleton's joints; they have the names of bones."""
    index = [model.rig.bone_names.index(name) for name in actor.skeleton.rig.joints]
    return model.bones.mean[index], model.bones.basis[:, index]


def _landmark(model: BodyModel, name: str) -> tuple[Tensor, Tensor]:
    if name in model.rig.landmarks:
        vertices = torch.from_numpy(model.rig.landmarks[name][1])
        return model.surface.mean[vertices].mean(0), model.surface.basis[:, vertices].mean(1)
    bone = model.rig.bone_names.index(name)
    return model.bones.mean[bone], model.bones.basis[:, bone]


def _joint_weights(model: BodyModel, actor: Actor) -> NDArray[np.float64]:
    """Weights of the skeleton's joints, (V, J)."""
    rig = model.rig
    joints = np.array(actor.bone_joints)[rig.weight_bones]
    dense = np.zeros((len(rig.weights), len(actor.skeleton.rig.joints)))
    np.add.at(dense, (np.arange(len(dense))[:, None], joints), rig.weights)
    return dense
