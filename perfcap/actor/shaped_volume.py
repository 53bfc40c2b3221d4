"""A volume of Gaussians on a body whose shape is unknown (Rhodin et al. 2016, Sec. 4.1)."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Self

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor, nn

from perfcap.actor.actor import Actor
from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.points import Linearized
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.actor.volume import Volume

_NEAR = 80  # vertices of the surface that a Gaussian moves with
_RIDGE = 1e-6  # m^2: places of those vertices are not looked at more closely than a millimetre


class ShapedGaussians(nn.Module):
    """Gaussians that bones carry, whose places and widths follow the body's shape.

    A centre is an affine combination of the vertices around it, so it is linear in the coefficients
    b of the shape, as the vertices and joints are. The logarithm of a width is linear in them: it
    grows as the distance of those vertices from the centre. What a ray loses in the middle of a
    Gaussian stays. The paper fits Gaussians to each of 228 scans and takes principal components;
    here all bodies are in correspondence, and their own components are kept.

    Args:
        points: the centres.
        widths: logarithm of the standard deviations (m) of the mean body, (Q,), and their
            derivatives, (S, Q).
        thickness: optical depth of a ray through the middle of each, (Q,).
        joints: index of the joint of the skeleton that each is rigid with, (Q,).
    """

    sees: Collection[str] = (BODY,)
    width_mean: Tensor
    width_basis: Tensor
    thickness: Tensor
    joints: Tensor

    def __init__(
        self, points: ShapedPoints, widths: tuple[Tensor, Tensor], thickness: Tensor, joints: Tensor
    ) -> None:
        super().__init__()
        self.points = points
        self.register_buffer("width_mean", widths[0])
        self.register_buffer("width_basis", widths[1])
        self.register_buffer("thickness", thickness)
        self.register_buffer("joints", joints)

    @classmethod
    def of(cls, model: BodyModel, actor: Actor, volume: Volume) -> Self:
        """The volume of the mean body, carried to all others.

        Args:
            model: the body.
            actor: ``model.actor`` of the mean.
            volume: fitted to it, such as by ``fit_volume``.
        """
        mean, basis = model.surface.mean.double(), model.surface.basis.double()
        volume = volume.to(mean)
        near = _near(actor, model, volume)  # Q K
        around = mean[near]  # Q K 3
        share = _affine(around, volume.centres)  # Q K
        moved = torch.einsum("qk,sqkc->sqc", share, basis[:, near])
        count = len(actor.skeleton.rig.joints)
        owner = torch.eye(count).to(mean)[volume.joints]
        centres = ShapedPoints.of_rest(model, actor, (volume.centres, moved), owner)
        arm = around - volume.centres[:, None]  # Q K 3
        change = torch.einsum("qkc,sqkc->sqk", arm, basis[:, near] - moved[:, :, None])
        size = arm.norm(dim=-1)
        growth = (change / size.clamp(min=1e-3)).mean(-1) / size.mean(-1)
        thickness = math.sqrt(2 * math.pi) * volume.deviations * volume.densities
        widths = volume.deviations.log(), growth
        return cls(centres, widths, thickness, volume.joints)

    @property
    def count(self) -> int:
        """Q."""
        return len(self.joints)

    def volume(self, shape: Tensor) -> Volume:
        """That of a person in the rest pose, with coefficients (S,)."""
        points = self.points
        centres = points.mean + torch.einsum("s,sqk->qk", shape, points.basis)
        width = (self.width_mean + shape @ self.width_basis).exp()
        density = self.thickness / (math.sqrt(2 * math.pi) * width)
        return Volume(centres, width, density, self.joints)

    def forward(self, motion: Motion) -> Tensor:
        """Centres in the world and logarithms of widths, (*b, F, Q, 4), metres."""
        centres: Tensor = self.points(motion)
        width = self._widths(motion)[..., None, :, None]
        return torch.cat((centres, width.expand(*centres.shape[:-1], 1)), -1)

    def linearize(self, motion: Motion) -> Linearized:
        """With derivatives in the frame (*b, F, Q, 4, 6 + A) and in the shape (*b, F, Q, 4, S)."""
        centres, frame, shared = self.points.linearize(motion)
        assert shared is not None
        width = self._widths(motion)[..., None, :, None].expand(*centres.shape[:-1], 1)
        own = self.width_basis.mT[:, None, :].expand(*shared.shape[:-2], 1, shared.shape[-1])
        none = frame.new_zeros(*frame.shape[:-2], 1, frame.shape[-1])
        return (
            torch.cat((centres, width), -1),
            torch.cat((frame, none), -2),
            torch.cat((shared, own), -2),
        )

    def _widths(self, motion: Motion) -> Tensor:
        return self.width_mean + motion.shared[BODY] @ self.width_basis


def _near(actor: Actor, model: BodyModel, volume: Volume) -> Tensor:
    """Vertices about each Gaussian, of the parts that its joint moves, (Q, K)."""
    dense = np.zeros((len(model.surface.mean), len(actor.skeleton.rig.joints)))
    joints = np.array(actor.bone_joints)[model.rig.weight_bones]
    np.add.at(dense, (np.arange(len(dense))[:, None], joints), model.rig.weights)
    places, found = model.surface.mean.double().numpy(force=True), []
    for centre, joint in zip(volume.centres.numpy(force=True), volume.joints.tolist(), strict=True):
        some = np.flatnonzero(dense[:, joint] > 0.25)
        some = some if len(some) >= _NEAR else np.arange(len(places))
        found.append(some[cKDTree(places[some]).query(centre, k=_NEAR)[1]])
    return torch.from_numpy(np.stack(found)).to(volume.joints.device)


def _affine(around: Tensor, centres: Tensor) -> Tensor:
    """Weights (Q, K) of least square that add up to one and give the centres (Q, 3)."""
    arm = around - centres[:, None]
    rows = torch.cat((arm, torch.ones_like(arm[..., :1])), -1)  # Q K 4
    gram = rows.mT @ rows + _RIDGE * torch.eye(4).to(rows)
    right = torch.tensor([0.0, 0.0, 0.0, 1.0]).to(rows).expand(len(rows), 4)
    found: Tensor = (rows @ torch.linalg.solve(gram, right)[..., None]).squeeze(-1)
    return found / found.sum(-1, keepdim=True)
