"""A body as a volume: isotropic Gaussians of density that ride on the joints."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from perfcap.actor.motion import BONES, Motion
from perfcap.actor.points import Landmarks, Linearized
from perfcap.actor.rig import Rig
from perfcap.actor.skeleton import Skeleton
from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable
from perfcap.geometry.record import Record
from perfcap.solve.second_order import SecondOrder

GAUSSIANS = 91  # of a body (Rhodin et al. 2016, Sec. 4)


@dataclass(frozen=True)
class Volume(Record):
    """Q isotropic Gaussians (Rhodin et al. 2016, Sec. 4).

    The density at x is ``sum_q densities_q exp(-|x - centres_q|^2 / (2 deviations_q^2))``.

    Attributes:
        centres: in the rest pose, (Q, 3) m.
        deviations: standard deviations, (Q,) m.
        densities: light absorbed in the middle of each, (Q,) 1/m.
        joints: index of the joint of the skeleton that each is rigid with, (Q,).
        colors: linear RGB in [0, 1], (Q, 3), or None; NaN where nothing was seen.

    Raises:
        InputError: shapes that do not belong together, places that are no numbers, deviations that
            are not above zero, or densities below it.
    """

    centres: Tensor
    deviations: Tensor
    densities: Tensor
    joints: Tensor
    colors: Tensor | None = None

    def __post_init__(self) -> None:
        count = len(self.centres)
        parts = (self.deviations, self.densities, self.joints)
        if self.centres.shape != (count, 3) or any(each.shape != (count,) for each in parts):
            raise InputError(
                f"volume has centres {tuple(self.centres.shape)}, deviations "
                f"{tuple(self.deviations.shape)}, densities {tuple(self.densities.shape)} and "
                f"joints {tuple(self.joints.shape)}; expected (Q, 3) and (Q,) for the others"
            )
        if self.colors is not None and self.colors.shape != (count, 3):
            raise InputError(
                f"volume has colors {tuple(self.colors.shape)} for {count} Gaussians; expected "
                f"({count}, 3)"
            )
        self._check_numbers()

    def _check_numbers(self) -> None:
        """Widths are squared, so that negative ones would draw the same and move otherwise."""
        centres, width, density = (
            each.detach() for each in (self.centres, self.deviations, self.densities)
        )
        if not all(map(is_readable, (centres, width, density))) or not self.count:
            return
        sound = bool(centres.isfinite().all() & (width.isfinite() & density.isfinite()).all())
        if not sound or not (float(width.min()) > 0 and float(density.min()) >= 0):
            raise InputError(
                f"volume has deviations from {float(width.min()):.3g} m and densities from "
                f"{float(density.min()):.3g} 1/m; expected finite numbers, above zero and not "
                "below zero, and finite centres in metres"
            )

    @property
    def count(self) -> int:
        """Q."""
        return len(self.centres)

    def to(self, like: Tensor) -> Volume:
        """The same volume with the type and device of a tensor; joints stay integers."""
        joints = self.joints.to(like.device)
        return replace(self.map(lambda each: each.to(like)), joints=joints)


class GaussianCentres(nn.Module):
    """Centres of a volume's Gaussians as points that a motion moves.

    Args:
        skeleton: of the body; bones may be unknown.
        volume: its Gaussians.

    Raises:
        InputError: the volume names joints that the skeleton does not have.
    """

    sees: Collection[str] = (BONES,)

    def __init__(self, skeleton: Skeleton, volume: Volume) -> None:
        super().__init__()
        known = len(skeleton.rig.joints)
        if not bool(((volume.joints >= 0) & (volume.joints < known)).all()):
            raise InputError(
                f"volume has Gaussians on joints {int(volume.joints.min())} to "
                f"{int(volume.joints.max())}, expected 0 to {known - 1} of its skeleton"
            )
        self.landmarks = Landmarks(_with_centres(skeleton, volume), last=volume.count)

    @property
    def count(self) -> int:
        """Q."""
        return self.landmarks.count

    def forward(self, motion: Motion) -> Tensor:
        """Centres in the world, (*b, F, Q, 3), metres."""
        centres: Tensor = self.landmarks(motion)
        return centres

    def linearize(self, motion: Motion) -> Linearized:
        """In closed form; see ``Skeleton.linearize``."""
        return self.landmarks.linearize(motion)

    def curvature(self, motion: Motion, linearized: Linearized, pull: Tensor) -> SecondOrder:
        """Second derivative of ``<pull, centres>`` for a pull (*b, F, Q, 3)."""
        return self.landmarks.curvature(motion, linearized, pull)


def _with_centres(skeleton: Skeleton, volume: Volume) -> Skeleton:
    """The skeleton with the Gaussians' centres behind its own landmarks."""
    rig, joints = skeleton.rig, volume.joints.tolist()
    groups = rig.bone_groups
    carried = _carried_groups(rig) if groups else {}
    more = [carried[joint] for joint in joints] if groups else []
    own = skeleton.rest_landmarks
    wider = replace(
        rig,
        landmarks=(*rig.landmarks, *(f"gaussian_{index}" for index in range(volume.count))),
        landmark_joints=(*rig.landmark_joints, *joints),
        landmark_positions=torch.cat((own, volume.centres.to(own))),
        bone_groups=(*groups, *more),
    )
    return Skeleton(wider).to(skeleton.lower)


def _carried_groups(rig: Rig) -> dict[int, str]:
    """The group of bones by which what is rigid with each joint lengthens.

    That of the bone which begins at the joint; of the spine, where several do.
    """
    groups, count = rig.bone_groups, len(rig.joints)
    found: dict[int, str] = {}
    for child, parent in enumerate(rig.parents[1:], start=1):
        found.setdefault(parent, groups[child])
    for mark, joint in enumerate(rig.landmark_joints):
        found.setdefault(joint, groups[count + mark])
    return {joint: found.get(joint, groups[max(joint, 1)]) for joint in range(count)}
