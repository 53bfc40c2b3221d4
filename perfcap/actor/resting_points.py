"""Chosen vertices that rest elsewhere than the template has them, frame by frame."""

from __future__ import annotations

from types import ModuleType

import torch
from torch import Tensor

from perfcap.actor._skinned_points_torch import Chosen, Skin, blended
from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints, joint_table
from perfcap.geometry.rotation import quaternion_to_matrix


class RestingPoints(SkinnedPoints):
    """Vertices of an actor's surface, skinned from other places at rest.

    Args:
        actor: whose skin.
        corners: vertices, (*b, F, N, 1) integer.
        rest: where they rest in each frame, (*b, F, N, 3), metres.
    """

    def __init__(self, actor: Actor, corners: Tensor, rest: Tensor) -> None:
        super().__init__(actor, corners, torch.ones_like(rest[..., :1]))
        self.rest = rest

    def turns(self, motion: Motion) -> Tensor:
        """Derivative of the points in where they rest, (*b, F, N, 3, 3): blended rotations."""
        table = joint_table(*self.actor.joint_transforms(motion))
        real = blended(super()._skin(), super()._chosen(motion), table)[..., 0, :4]
        return quaternion_to_matrix(real / real.norm(dim=-1, keepdim=True))

    def _twin(self, *given: Tensor) -> ModuleType:
        return super()._twin(*given, self.rest)

    def _skin(self) -> Skin:
        template, corners = super()._skin(), self.corners.flatten()
        return Skin(self.rest.reshape(-1, 3), *(rows[corners] for rows in template[1:]))

    def _chosen(self, motion: Motion) -> Chosen:
        chosen = super()._chosen(motion)
        count = chosen.corners.numel()
        own = torch.arange(count, device=chosen.corners.device)
        return Chosen(own.reshape(chosen.corners.shape), chosen.weights)
