"""Whether frames of a motion follow one another: else joints or limbs leap, or joints stay."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.io.doctor.backwards import examine_backwards
from perfcap.io.doctor.finding import Finding, ranges
from perfcap.io.doctor.order import examine_order, examine_shuffled
from perfcap.io.doctor.repeated import examine_held
from perfcap.pipeline.joint_motion import LIMBS, unit_vectors
from perfcap.pipeline.motion_leaps import smoothing_doubts

_LIMBS = [(JOINTS.index(start), JOINTS.index(end)) for start, end in LIMBS]
# degrees, mean of the limbs, from a frame at either end to the next; and times as far as in any
# other step. Rest poses before 18 recorded motions are 41 off or more, and 2.7 times or more; ends
# of these motions without, and of others, every 30th frame of them alone as well, 1.4 times at most
_LEAPS, _BEYOND = 25.0, 2.0
_FEWEST = 8  # frames


def order_doubts(position: Tensor, rate: float) -> Iterator[str]:
    """Sentences about frames in no order, sorted as text, backwards, held, or of a rest pose.

    And about limbs that leap or trunks that spin in frames that are in order.

    Args:
        position: of joints in the world, (F, 16, 3) metres.
        rate: frames a second.
    """
    joints = position.detach().double().cpu()
    sure = torch.ones_like(joints[..., 0])
    order = examine_order("", joints, sure) or examine_shuffled("", joints, sure)
    yield from map(_sentence, order)
    backwards = [] if order else examine_backwards("", 0, joints, sure)
    yield from () if order or backwards else smoothing_doubts(joints, rate)
    for found in backwards:
        yield (
            f"frames {ranges(found.frames)} (counted from 0) look as if played backwards: joints "
            f"leap where they begin and end, and would not the other way round; {found.remedy}"
        )
    for found in examine_held("", joints, sure):
        yield (
            f"{found.what}; no recorded motion does: leave such frames out unless the person is "
            "to stand still there, and give the rate at which it was recorded"
        )
    yield from _apart(joints)


def _apart(joints: Tensor) -> Iterator[str]:
    """A first or last frame that is a pose of its own, as the rest pose that some files begin with.

    Args:
        joints: (F, 16, 3).
    """
    if len(joints) < _FEWEST:
        return
    limbs = unit_vectors(torch.stack([joints[:, b] - joints[:, a] for a, b in _LIMBS], 1))
    cosine = (limbs[1:] * limbs[:-1]).sum(-1).clamp(-1, 1)
    turned = cosine.arccos().rad2deg().mean(-1)
    most = float(turned[1:-1].max())
    for place, which, instead in ((0, "first", "--frames 1:"), (-1, "last", "--frames")):
        leap = float(turned[place])
        if leap > max(_LEAPS, _BEYOND * most):
            yield (
                f"the {which} frame is a pose of its own: limbs turn by {leap:.0f} degrees between "
                f"it and the next, and by {most:.0f} at most elsewhere; leave a rest pose out "
                f"({instead})"
            )


def _sentence(found: Finding) -> str:
    return f"{found.what}; {found.remedy}"
