"""Whether an actor's bones have the lengths that several views show."""

from __future__ import annotations

from collections.abc import Iterator

from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.legs import NO_LEGS, leg_lengths, ratio_to, rest_landmarks, triangulated

_RATIO = (0.87, 1.15)  # of the actor's legs to those that the views show
# The same of single bones, where legs fit: right actors have 0.93 to 1.05 in two to seven views,
# and a generic one 0.90 to 1.14 of a real man (--bones template); joints at wrong
# places 0.58 to 0.75 and 1.26 to 1.40. Feet have 0.90 to 1.02, and estimators differ in what they
# call a toe; many guess crowns, so that heads say nothing.
_SINGLE, _FEET = (0.8, 1.22), (0.7, 1.45)
# Lengths, of both sides, whose median is believed, and the middle half of them in parts of it: from
# cameras that face each other it is 0.3 to 1.8, and medians are too long.
_FEWEST, _SPREAD = 12, 0.22
_BONES = {
    name: [[LANDMARKS.index(f"{side}_{end}") for end in ends] for side in "lr"]
    for name, ends in (
        ("upper arms", ("shoulder", "elbow")),
        ("forearms", ("elbow", "wrist")),
        ("thighs", ("hip", "knee")),
        ("shanks", ("knee", "ankle")),
        ("feet", ("ankle", "toe")),
    )
}


REMEDY = (
    "solve the bone lengths (--bones solve, solve_bones=True), or give the actor of this person"
)


def bone_doubts(
    actor: Actor, cameras: Camera, detections: Detections, remedy: str = REMEDY
) -> Iterator[str]:
    """Sentences about legs, or else single bones, of other lengths than several views show.

    Args:
        actor: in its rest pose.
        cameras: C views, (C,) or (F, C).
        detections: (F, C).
        remedy: what to do where it is no mistake.
    """
    if detections.views < 2:
        return
    points = triangulated(cameras, detections)
    # in a single image 2 to 35 % of right actors of seven people are beyond
    enough = int(leg_lengths(points).isfinite().sum()) >= _FEWEST
    legs = ratio_to(actor, points) if enough else None
    if legs is not None and not _RATIO[0] < legs < _RATIO[1]:
        yield (
            f"the actor's legs are {legs:.2g} times as long as those that the views show; check "
            f"the scale and the focal lengths of the calibration, {remedy}"
        )
        return
    ratios = bone_ratios(actor, points)
    usual = {name: _FEET if name == "feet" else _SINGLE for name in ratios}
    odd = {name: r for name, r in ratios.items() if not usual[name][0] < r < usual[name][1]}
    if odd:
        each = ", ".join(f"{name} {ratio:.2f}" for name, ratio in odd.items())
        yield (
            f"bones of the actor have other lengths than those that the views show ({each} times "
            "as long); check that its joints lie where its limbs bend (perfcap actor inspect) and "
            f"the names of detected joints, {remedy}"
        )


def bone_ratios(actor: Actor, points: Tensor) -> dict[str, float]:
    """Lengths of an actor's bones over those of placed joints, both sides' medians.

    Args:
        actor: in its rest pose.
        points: landmarks in the world, (N, 16, 3) m, NaN where unknown.

    Returns:
        By bone; those that are hardly seen, or far from the same length in all poses, are left out.
    """
    found = {}
    for name, ends in _BONES.items():
        seen = points[:, ends].diff(dim=2).norm(dim=-1)
        seen = seen[seen.isfinite()]
        if len(seen) < _FEWEST:
            continue
        low, middle, high = seen.quantile(seen.new_tensor([0.25, 0.5, 0.75])).tolist()
        if middle > NO_LEGS and high - low < _SPREAD * middle:
            own = float(rest_landmarks(actor)[None][:, ends].diff(dim=2).norm(dim=-1).mean())
            found[name] = own / middle
    return found
