"""From a motion solved once: the floor, who stands where, and the energies that keep it so."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.points import Landmarks
from perfcap.actor.skeleton import Skeleton
from perfcap.actor.sole_points import SOLE_POINTS, sole_skeleton
from perfcap.energy.floor_penetration import FloorPenetration
from perfcap.energy.joint_target import JointTarget
from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import ContactConfig
from perfcap.pipeline.floor import Floor, find_floor
from perfcap.pipeline.stances import (
    contact_probability,
    find_stances,
    settled_places,
    split_stances,
)
from perfcap.solve.energy import Energy
from perfcap.solve.kernels import GemanMcClure

_POINTS = 2 * len(SOLE_POINTS)
_KNOWN = 0.6  # share of the support that is enough where the normal is known
_SPLITS = 2  # rounds in which stances are split


@dataclass(frozen=True)
class Standing:
    """Where the feet of a clip stand.

    Attributes:
        skeleton: poses the points under the feet, its last N landmarks.
        floor: that they stand on.
        probability: that each point stands in each frame, (F, N).
        place: where it stands, (F, N, 3), metres; any place where it does not.
        shift: what moves the motion that it was found from so that feet stand, (F, 3), metres.
    """

    skeleton: Skeleton
    floor: Floor
    probability: Tensor
    place: Tensor
    shift: Tensor

    @property
    def feet(self) -> Tensor:
        """Probability that the left and the right foot stand, (F, 2)."""
        return self.probability.reshape(-1, 2, len(SOLE_POINTS)).amax(-1)

    def energies(self, index: slice | Tensor, config: ContactConfig) -> dict[str, Energy[Motion]]:
        """The energies of a window (W,) of frames, or of several (N, W), by name.

        Points of a standing foot stay where they stand, which is the same in consecutive frames:
        ``sum_f sum_k p_fk |x_k(f) - a_fk|^2 / deviation^2``, with p the probability that they
        stand. With a the weighted mean of x over a stance that is the spread about it, so
        alternating between a and x minimises that spread. Frames stay independent for given a.
        """
        soles = Landmarks(self.skeleton, _POINTS)
        scale = None if config.scale is None else GemanMcClure(config.scale)
        sure = self.probability[index]
        return {
            "contact": JointTarget(
                *(soles, self.place[index].unsqueeze(-3), sure.unsqueeze(-2)),
                *(config.weight, scale, config.deviation),
            ),
            "floor": FloorPenetration(
                *(
                    soles,
                    self.floor.normal,
                    self.floor.height - config.margin,
                    torch.ones_like(sure),
                ),
                *(config.weight, None, config.depth),
            ),
        }


@torch.no_grad()
def find_standing(
    actor: Actor,
    motion: Motion,
    rate: float,
    config: ContactConfig,
    precision: Tensor,
    cameras: Camera | None = None,
    normal: Tensor | None = None,
) -> Standing | None:
    """The floor and the stances of a motion; None where feet stand on no floor.

    Args:
        actor: whose feet.
        motion: (F,).
        rate: frames a second.
        config: of the contact.
        precision: how well each frame's place is known without contact, (F, 3, 3), 1 / m^2: see
            ``translation_precision``.
        cameras: give the world's axes a meaning, where they are not a camera's own.
        normal: of the floor, a unit vector (3,), where it is known.
    """
    skeleton = sole_skeleton(actor)
    points: Tensor = skeleton(motion).landmarks
    soles = points[:, -_POINTS:]
    floor = find_floor(points[:, :-_POINTS], soles, rate, cameras, normal)
    enough = config.support if normal is None else _KNOWN * config.support
    if floor.support < enough:
        return None
    sure = contact_probability(soles, floor, rate)
    return stand_where(skeleton, soles, floor, sure, rate, config, precision)


@torch.no_grad()
def stand_where(
    skeleton: Skeleton,
    soles: Tensor,
    floor: Floor,
    sure: Tensor,
    rate: float,
    config: ContactConfig,
    precision: Tensor,
) -> Standing:
    """The places of feet whose contacts are known.

    Args:
        skeleton: poses the points under the feet, its last N landmarks.
        soles: where they are, (F, N, 3), metres.
        floor: that they stand on.
        sure: probability that each point stands, (F, N).
        rate: frames a second.
        config: of the contact.
        precision: how well each frame's place is known without contact, (F, 3, 3), 1 / m^2.
    """
    stances = find_stances(sure, rate)
    settled = settled_places(soles, stances, floor, precision, config.deviation)
    for _ in range(_SPLITS):
        stances = split_stances(stances, settled, rate)
        settled = settled_places(soles, stances, floor, precision, config.deviation)
    return Standing(skeleton, floor, settled.probability, settled.place, settled.shift)
