"""Points that a motion moves, with second derivatives: all that energies see of a person."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

import torch
from torch import Tensor, nn

from perfcap.actor.frame_twists import frame_twists, moved_joints
from perfcap.actor.kinematic_tree import Pose
from perfcap.actor.motion import BONES, Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.errors import InputError
from perfcap.solve.second_order import SecondOrder, points_second_order

# --- Second derivatives of landmarks in closed form -----------------------------------------------
#
# An unknown a turns everything below it about its axis, so where a comes before b on the way from
# the root, the derivative of a landmark in b, J_b, turns too: d2p / da db = axis_a x J_b.
# Contracted with a pull w on the landmarks, that is ``axis_a . sum_l J_b,l x w_l``: one vector for
# each b.

Blocks = tuple[Tensor, Tensor | None, Tensor | None]


def kinematic_curvature(
    skeleton: Skeleton, motion: Motion, jacobian: Tensor, pull: Tensor
) -> Blocks:
    """Second derivative of ``<pull, landmarks>`` in the tangent of a motion.

    Args:
        skeleton: whose landmarks.
        motion: where, (*b, F).
        jacobian: derivative of the landmarks in a frame's unknowns, (*b, F, L, 3, 6 + A).
        pull: on the landmarks, (*b, F, L, 3).

    Returns:
        In the frame's unknowns (*b, F, 6 + A, 6 + A), in those and the bones (*b, F, 6 + A, S),
        and in the bones, summed over frames (*b, S, S); the last two None where bones are known.
    """
    tree, pose = skeleton.tree, skeleton(motion)
    twists = frame_twists(tree, pose.rotation, pose.position, motion.angles)
    axes = twists[..., 3 : motion.frame_dim, :3]  # *b F 3+A 3
    moment = torch.linalg.cross(jacobian[..., 3:].mT, pull.unsqueeze(-2)).sum(-3)  # *b F 3+A 3
    turned = _order(skeleton) * (axes @ moment.mT)
    frame = torch.nn.functional.pad(turned + turned.mT, (3, 0, 3, 0))
    carried = tree.chain[tree.joints :].mT @ pull  # what pulls on a bone's end, *b F J+L 3
    if tree.clavicles.count:
        clavicles = _through_clavicles(skeleton, motion, pose, axes[..., 3:, :], carried)
        frame = frame + torch.nn.functional.pad(clavicles, (6, 0, 6, 0))
    if BONES not in motion.shared:
        return frame, None, None
    vectors = tree.scaled_bones(motion.shared[BONES]).unsqueeze(-3)
    bones = (pose.rotation[..., tree.bone_start, :, :] @ vectors[..., None]).squeeze(-1)
    groups = torch.arange(len(tree.group_names)).to(tree.bone_group)
    member = (tree.bone_group[:, None] == groups).to(bones)  # J+L S
    below = moved_joints(tree)[tree.bone_start, 3 : motion.frame_dim].mT.to(bones)  # 3+A J+L
    torque = axes @ torch.linalg.cross(bones, carried).mT  # *b F 3+A J+L
    border = torch.nn.functional.pad((below * torque) @ member, (0, 0, 3, 0))
    if tree.clavicles.count:
        ends, every = tree.clavicles.carried, tree.clavicles
        along, arm = every.arms(pose.rotation, pose.position)
        pulled = (torch.linalg.cross(along, arm) * carried[..., ends, :]).sum(-1, keepdim=True)
        more = torch.einsum("...ki,kia->...ak", every.slopes(motion.angles) * pulled, every.spread)
        border = border + torch.nn.functional.pad(more @ member[ends], (0, 0, 6, 0))
    stretched = (bones * carried).sum(-1).sum(-2) @ member
    return frame, border, torch.diag_embed(stretched)


def _through_clavicles(
    skeleton: Skeleton, motion: Motion, pose: Pose, axes: Tensor, carried: Tensor
) -> Tensor:
    """What the turns of clavicles add to the second derivative in the angles, (*b, F, A, A).

    What an arm carries is shifted by ``m = axis x clavicle`` a radian. In its two angles the second
    derivative of that is ``turn'_i turn'_j axis x m + turn''_ij m``; the rule of hinges has put
    ``axis_i x turn'_j m`` in its place.
    """
    every = skeleton.tree.clavicles
    along, arm = every.arms(pose.rotation, pose.position)
    shift, pull = torch.linalg.cross(along, arm), carried[..., every.carried, :]
    slopes = every.slopes(motion.angles)  # *b F K 2
    bent = (torch.linalg.cross(along, shift) * pull).sum(-1)[..., None, None]
    straight = (shift * pull).sum(-1)[..., None, None]
    block = slopes[..., :, None] * slopes[..., None, :] * bent
    block = block + every.curvatures(motion.angles) * straight
    lifted = torch.linalg.cross(axes[..., every.lifts, :], shift.unsqueeze(-2))
    taken = (lifted * pull.unsqueeze(-2)).sum(-1)  # *b F K 2
    first, last = taken[..., 0] * slopes[..., 0], taken[..., 1] * slopes[..., 1]
    mixed = taken[..., 0] * slopes[..., 1]
    block = block - torch.stack((first, mixed, mixed, last), -1).reshape(block.shape)
    return torch.einsum("...kij,kia,kjb->...ab", block, every.spread, every.spread)


def _order(skeleton: Skeleton) -> Tensor:
    """1 where an unknown comes before another, 1/2 where they turn as one, (3 + A, 3 + A).

    With its transpose added every pair counts once, and the root rotation, which turns about all
    three axes at once, is the mean of both orders.
    """
    tree = skeleton.tree
    joint = tree.hinge_joint
    count = len(joint)
    before = moved_joints(tree)[joint, 6 : 6 + count].mT.clone()  # of hinges, by first, then second
    index = torch.arange(count).to(joint)
    same = joint[:, None] == joint
    before[same] = (index[:, None] < index)[same].to(before)
    before = before + 0.5 * torch.eye(count).to(before)
    order = before.new_ones(3 + count, 3 + count)
    order[:3, :3], order[3:, :3], order[3:, 3:] = 0.5, 0.0, before
    return order


# --- Points that a motion moves: all that energies see of a person --------------------------------

Linearized = tuple[Tensor, Tensor, Tensor | None]
"""Points (*b, F, N, 3), derivative (*b, F, N, 3, D), and (*b, F, N, 3, S') in what is shared."""


class Points(Protocol):
    """N points of a person: landmarks, places on the surface, of a known body or an unknown one.

    ``sees`` names the shared blocks of a motion that move them; a motion need not have these.
    """

    sees: Collection[str]

    @property
    def count(self) -> int:
        """N, points of a frame."""

    def __call__(self, motion: Motion) -> Tensor:
        """Points in the world, (*b, F, N, 3), metres."""

    def linearize(self, motion: Motion) -> Linearized:
        """Points, and their derivatives in the frame's tangent and in the shared blocks seen.

        The shared derivative has the blocks that the points see and the motion has, in the
        motion's order; it is None where there are none.
        """


class Landmarks(nn.Module):
    """The landmarks of a skeleton as points, in the order of its rig; bones may be unknown.

    Args:
        skeleton: whose landmarks.
        last: how many of them, from the end; all if None.
    """

    sees: Collection[str] = (BONES,)

    def __init__(self, skeleton: Skeleton, last: int | None = None) -> None:
        super().__init__()
        self.skeleton = skeleton
        self.first = 0 if last is None else len(skeleton.rest_landmarks) - last

    @property
    def count(self) -> int:
        """All 16 of people, or the last ones."""
        return len(self.skeleton.rest_landmarks) - self.first

    def forward(self, motion: Motion) -> Tensor:
        """Landmarks in the world, (*b, F, N, 3), metres."""
        landmarks: Tensor = self.skeleton(motion).landmarks
        return landmarks[..., self.first :, :]

    def linearize(self, motion: Motion) -> Linearized:
        """In closed form; see ``Skeleton.linearize``."""
        points, frame, shared = self.skeleton.linearize(motion)
        if not self.first:
            return points, frame, shared
        kept = slice(self.first, None)
        own_shared = None if shared is None else shared[..., kept, :, :]
        return points[..., kept, :], frame[..., kept, :, :], own_shared

    def curvature(self, motion: Motion, linearized: Linearized, pull: Tensor) -> SecondOrder:
        """Second derivative of ``<pull, landmarks>`` for a pull (*b, F, N, 3)."""
        frame = linearized[1]
        if self.first:
            frame = self.skeleton.linearize(motion)[1]
            pull = torch.nn.functional.pad(pull, (0, 0, self.first, 0))
        return SecondOrder(*kinematic_curvature(self.skeleton, motion, frame, pull))


# --- Vectors between points of a person: where one is as seen from another ------------------------


class PointDifferences(nn.Module):
    """Points minus other points, as points that energies take: bones, reaches, orientations.

    Args:
        points: N points of a person.
        ends: which of them the vectors lead to, M.
        starts: which they start at, M; None for a point that is taken as it is.

    Raises:
        InputError: other numbers of ends and starts, or points that are not there.
    """

    sees: Collection[str]
    ends: Tensor
    starts: Tensor
    relative: Tensor

    def __init__(self, points: Points, ends: Sequence[int], starts: Sequence[int | None]) -> None:
        super().__init__()
        used = [*ends, *(start for start in starts if start is not None)]
        if len(ends) != len(starts) or not all(0 <= each < points.count for each in used):
            raise InputError(
                f"ends {list(ends)} and starts {list(starts)}: expected as many of each, from 0 to "
                f"{points.count - 1}"
            )
        self.points, self.sees = points, points.sees
        self.register_buffer("ends", torch.tensor(list(ends)))
        self.register_buffer("starts", torch.tensor([start or 0 for start in starts]))
        self.register_buffer("relative", torch.tensor([start is not None for start in starts]))

    @property
    def count(self) -> int:
        """M."""
        return len(self.ends)

    def forward(self, motion: Motion) -> Tensor:
        """Vectors in the world, (*b, F, M, 3), metres."""
        return self._between(self.points(motion), -2)

    def linearize(self, motion: Motion) -> Linearized:
        """The same differences of the points' derivatives."""
        points, frame, shared = self.points.linearize(motion)
        return (
            self._between(points, -2),
            self._between(frame, -3),
            None if shared is None else self._between(shared, -3),
        )

    def curvature(self, motion: Motion, linearized: Linearized, pull: Tensor) -> SecondOrder:
        """Second derivative of ``<pull, vectors>`` for a pull (*b, F, M, 3)."""
        count = self.points.count
        on_points = pull.new_zeros(*pull.shape[:-2], count, 3).index_add(-2, self.ends, pull)
        kept = pull * self.relative.to(pull)[:, None]
        on_points = on_points.index_add(-2, self.starts, -kept)
        return points_second_order(self.points, motion, self.points.linearize(motion), on_points)

    def _between(self, values: Tensor, axis: int) -> Tensor:
        """Rows of the ends minus those of the starts, along an axis counted from the end."""
        shape = (-1,) + (1,) * (-1 - axis)
        start = values.index_select(axis, self.starts) * self.relative.to(values).reshape(shape)
        return values.index_select(axis, self.ends) - start


def require_directions(directions: Tensor, points: Sequence[int]) -> None:
    """Refuse directions that are not those of points (*b, F, N): compiled loops believe them.

    Raises:
        InputError: they are not (*b, F, N, Q, 3).
    """
    if tuple(directions.shape[:-2]) != tuple(points) or directions.shape[-1] != 3:
        raise InputError(
            f"directions have shape {tuple(directions.shape)} for points {tuple(points)}; expected "
            "(*b, F, N, Q, 3) of the same frames and points"
        )
