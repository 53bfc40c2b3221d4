"""Chosen points of the surface as a function of the motion, without posing the rest of it."""

from __future__ import annotations

from collections.abc import Collection
from types import ModuleType

import torch
from torch import Tensor, nn

from perfcap.actor import _skinned_points_torch
from perfcap.actor._skinned_points_torch import Chosen, Skin, Unknowns
from perfcap.actor.actor import Actor
from perfcap.actor.frame_twists import frame_twists, moved_joints, topmost_joints
from perfcap.actor.motion import Motion
from perfcap.actor.points import Linearized, require_directions
from perfcap.errors import InputError
from perfcap.geometry.dual_quaternion import DualQuaternion
from perfcap.geometry.plain import is_plain


class SkinnedPoints(nn.Module):
    """Points ``sum_s weight_s * vertex_s`` of an actor's dual-quaternion-skinned surface.

    Equal to the same sums over ``Actor.surface``, at the cost of the chosen vertices only.

    Args:
        actor: whose surface.
        corners: vertices of each point, (*b, F, N, S) integer; leading axes may be left out where
            the points are the same, down to (N, S).
        weights: of the corners, the shape of ``corners``. Points whose weights are all zero, as
            those that pad a list, lie at the origin and do not move.
    """

    sees: Collection[str] = ()
    corners: Tensor
    weights: Tensor

    def __init__(self, actor: Actor, corners: Tensor, weights: Tensor) -> None:
        super().__init__()
        _check(corners, weights, len(actor.vertices))
        self.actor = actor
        self.register_buffer("corners", corners.to(actor.skin.pivots))
        self.register_buffer("weights", weights.to(actor.vertices))
        names = ("joints", "joint_weights", "pivots")
        for name, rows in zip(names, actor.skin.rows(), strict=True):
            self.register_buffer(name, rows, persistent=False)
        tree = actor.skeleton.tree
        self.register_buffer("topmost", topmost_joints(tree), persistent=False)
        self.register_buffer("moved", moved_joints(tree), persistent=False)

    @property
    def count(self) -> int:
        """N."""
        return self.corners.shape[-2]

    def forward(self, motion: Motion) -> Tensor:
        """Points in the world, (*b, F, N, 3), metres."""
        table = joint_table(*self.actor.joint_transforms(motion))
        points: Tensor = self._twin(table).place(self._skin(), self._chosen(motion), table)
        return points

    def linearize(self, motion: Motion, directions: Tensor | None = None) -> Linearized:
        """Points (*b, F, N, 3) and their derivative in closed form.

        Args:
            motion: where.
            directions: (*b, F, N, Q, 3), to get the derivative of ``directions . point`` only;
                saves time and memory over the derivative of all three coordinates.

        Returns:
            points: in the world, metres.
            frame: derivative in the frame's tangent (translation, rotation, angles),
                (*b, F, N, 3, 6 + A), or (*b, F, N, Q, 6 + A) along directions.
            shared: None: the surface is that of an actor whose bones are known.
        """
        rotation, translation = self.actor.joint_transforms(motion)
        table, chosen = joint_table(rotation, translation), self._chosen(motion)
        if directions is None:
            directions = torch.eye(3).to(table).expand(*chosen.corners.shape[:-1], 3, 3)
        require_directions(directions, chosen.corners.shape[:-1])
        unknowns = self._unknowns(motion, rotation, translation)
        points, frame = self._twin(table, directions).linearize(
            self._skin(), chosen, table, unknowns, directions
        )
        frame = self.actor.skeleton.tree.clavicles.fold(frame, motion.angles)
        return points, frame, None

    def _twin(self, *given: Tensor) -> ModuleType:
        """Compiled loops where only numbers are asked for; torch on GPUs and for derivatives."""
        if is_plain(*given, self.actor.vertices, self.weights):
            from perfcap.actor import _skinned_points_numba

            return _skinned_points_numba
        return _skinned_points_torch

    def _skin(self) -> Skin:
        rows = (self.get_buffer(name) for name in ("joints", "joint_weights", "pivots"))
        return Skin(self.actor.vertices, *rows)

    def _unknowns(self, motion: Motion, rotation: Tensor, translation: Tensor) -> Unknowns:
        skeleton = self.actor.skeleton
        rest = skeleton.rest_positions[..., None]
        position = (rotation @ rest).squeeze(-1) + translation
        tree = skeleton.tree
        twists = frame_twists(tree, rotation, position, motion.angles)
        return Unknowns(twists, self.get_buffer("topmost"), tree.parents, self.get_buffer("moved"))

    def _chosen(self, motion: Motion) -> Chosen:
        frames = motion.angles.shape[:-1]
        lead = self.corners.shape[:-2]
        if lead != frames[len(frames) - len(lead) :]:
            raise InputError(
                f"points have corners {tuple(self.corners.shape)} but the motion has frames "
                f"{tuple(frames)}; give corners {(*frames, *self.corners.shape[-2:])}"
            )
        shape = (*frames, *self.corners.shape[-2:])
        return Chosen(self.corners.expand(shape), self.weights.expand(shape))


class LimbPoints(SkinnedPoints):
    """Points that are each rigid with one joint (Liu et al. 2013, Eq. 3): nothing is blended.

    Args:
        actor: whose joints.
        places: of the points in the rest pose, (N, 3), metres.
        joints: of the skeleton, that each moves with, (N,) integer.
    """

    places: Tensor

    def __init__(self, actor: Actor, places: Tensor, joints: Tensor) -> None:
        count, known = len(places), len(actor.skeleton.rig.joints)
        fits = places.shape == (count, 3) and joints.shape == (count,)
        if not fits or joints.is_floating_point():
            raise InputError(
                f"points have places {tuple(places.shape)} and joints {tuple(joints.shape)} of "
                f"{joints.dtype}; give (N, 3) and integers (N,)"
            )
        if count and not 0 <= int(joints.min()) <= int(joints.max()) < known:
            raise InputError(
                f"points have joints {int(joints.min())} to {int(joints.max())}; the skeleton has "
                f"0 to {known - 1}"
            )
        nn.Module.__init__(self)
        self.actor = actor
        like, own = actor.vertices, joints.to(actor.skin.pivots)
        self.register_buffer("places", places.to(like))
        self.register_buffer("corners", torch.arange(count).to(own)[:, None])
        self.register_buffer("weights", torch.ones(count, 1).to(like))
        self.register_buffer("joints", own[:, None], persistent=False)
        self.register_buffer("joint_weights", torch.ones(count, 1).to(like), persistent=False)
        self.register_buffer("pivots", own, persistent=False)
        tree = actor.skeleton.tree
        self.register_buffer("topmost", topmost_joints(tree), persistent=False)
        self.register_buffer("moved", moved_joints(tree), persistent=False)

    def _skin(self) -> Skin:
        rows = (self.get_buffer(name) for name in ("joints", "joint_weights", "pivots"))
        return Skin(self.places, *rows)


def joint_table(rotation: Tensor, translation: Tensor) -> Tensor:
    """Rigid motions of joints as rows (*b, F, J, 8), real then dual part."""
    motion = DualQuaternion.from_rigid(rotation, translation)
    return torch.cat((motion.real, motion.dual), -1)


def _check(corners: Tensor, weights: Tensor, vertices: int) -> None:
    if corners.dim() < 2 or corners.is_floating_point() or corners.shape != weights.shape:
        raise InputError(
            f"points have corners {tuple(corners.shape)} of {corners.dtype} and weights "
            f"{tuple(weights.shape)}; give vertex indices and weights of one shape (*b, F, N, S)"
        )
    if corners.numel() and (corners.min() < 0 or corners.max() >= vertices):
        raise InputError(
            f"points have corners from {int(corners.min())} to {int(corners.max())} but the actor "
            f"has {vertices} vertices; give indices of its vertices"
        )
