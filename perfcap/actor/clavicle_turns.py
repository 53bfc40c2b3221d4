"""How far clavicles turn, and the derivatives: what kinematics needs of ``Rig.clavicles``.

With the angles a and b of the two hinges that lift an arm, its elevation E from hanging has
``cos E = cos a cos b``, and a clavicle turns by ``range * (sin(E / 2)^4 - its value at rest)``,
where ``sin(E / 2)^2 = (1 - cos a cos b) / 2``.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from perfcap.actor.rig import Rig


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
