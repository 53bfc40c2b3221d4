"""Whether joints of one limb, or neck and crown, are in each other's place."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding, Severity

# Joints of a limb, how often its upper bone may fit between the neck and the first of them, and how
# many times one of its bones may be as long as the other in few frames: forearms of some recorded
# skeletons are short, and an arm that stays bent hides for a while which of its joints is where
_LIMBS = ((("shoulder", "elbow", "wrist"), 1.1, 1.8), (("hip", "knee", "ankle"), 1.9, 1.4))
_HEAD = ("head_top", "neck", "l_shoulder", "r_shoulder")
_LONGER = 1.4  # times one bone of a limb may be as long as the other, in many frames
# Of the bones as named. Who sits or boxes has short ones in any order, but steady ones in one: some
# networks have forearms as short as those of the motion that they learned from
_SHORTER = 0.9
_ORDERS = ([0, 1, 3, 2], [0, 2, 1, 3], [0, 3, 2, 1])  # of the neck and the joints
_FEWEST, _MANY = 10, 24  # frames
_SURE = 0.3  # confidence
_ABOVE = 0.5  # of the width of the shoulders in the image: from above, necks are nearer to them
_REMEDY = "exchange their names or columns: in the order of the joints they are each other's"


def examine_neighbours(subject: str, points: Tensor) -> list[Finding]:
    """Neck and crown, and joints of limbs, that have a person's bones, and shorter ones, otherwise.

    Args:
        subject: of the finding.
        points: landmarks (F, 16, 3) in the world or in the axes of a camera, metres, NaN where
            unknown.
    """
    found = ["head_top and neck"] if _headlong(points) else []
    if found:
        points = points[:, [1, 0, *range(2, len(LANDMARKS))]]
    for joints, most, longer in _LIMBS:
        for side in "lr":
            names = ["neck", *(f"{side}_{name}" for name in joints)]
            limb = points[:, [LANDMARKS.index(name) for name in names]]
            if order := _better(limb, most, longer):
                found.append(" and ".join(names[i] for i, other in enumerate(order) if i != other))
    if not found:
        return []
    what = f"{', '.join(found)} look exchanged: as named, no person has bones of such lengths"
    return [Finding(Severity.WARNING, subject, what, _REMEDY)]


def examine_crown(name: str, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Neck and crown that are each other's in one view, of which limbs have no lengths.

    Args:
        name: of the view.
        pixels: its joints, (F, 16, 2).
        confidence: of the joints, (F, 16).
    """
    shown = torch.where((confidence > _SURE)[..., None], pixels, torch.nan)
    neck, left, right = (shown[:, LANDMARKS.index(joint)] for joint in _HEAD[1:])
    away, wide = (neck - 0.5 * (left + right)).norm(dim=-1), (left - right).norm(dim=-1)
    # from above, the crown is over the shoulders, but the neck is not far from them
    if not (_headlong(shown) and float((away / wide).nanmedian()) > _ABOVE):
        return []
    what = "head_top and neck look exchanged: the crown is nearer to the shoulders"
    return [Finding(Severity.WARNING, name, what, _REMEDY)]


def _headlong(points: Tensor) -> bool:
    """Whether the crown is nearer to the shoulders than the neck."""
    crown, neck, left, right = (points[:, LANDMARKS.index(name)] for name in _HEAD)
    away = torch.stack((neck, crown)) - 0.5 * (left + right)
    lengths = away.detach().norm(dim=-1)
    known = lengths[:, lengths.isfinite().all(0)]
    if known.shape[1] < _FEWEST:
        return False
    own, other = known.median(1).values.tolist()
    return bool(own > _LONGER * other > 0)


def _better(limb: Tensor, most: float, longer: float) -> list[int] | None:
    """The order in which a neck and three joints (F, 4, 3) are those of a limb, if as named not."""
    named, loose = _bones(limb)
    many = int(limb.isfinite().all(-1).all(-1).sum()) >= _MANY
    if not _odd(named, most, _LONGER if many else longer):
        return None
    for order in _ORDERS:
        bones, steady = _bones(limb[:, order])
        apart = named[0] > most * named[1] or steady < loose
        if apart and sum(bones) < _SHORTER * sum(named) and not _odd(bones, most):
            return order
    return None


def _bones(limb: Tensor) -> tuple[list[float], float]:
    """Median lengths from joint to joint, and the middle half of all, m; 0 where hardly known."""
    middles, spread = [], 0.0
    for lengths in limb.detach().diff(dim=1).norm(dim=-1).unbind(1):
        known = lengths[lengths.isfinite()]
        if len(known) < _FEWEST:
            middles.append(0.0)
            continue
        low, middle, high = known.quantile(known.new_tensor([0.25, 0.5, 0.75])).tolist()
        middles.append(middle)
        spread += high - low
    return middles, spread


def _odd(bones: list[float], most: float, longer: float = _LONGER) -> bool:
    """Whether no person has such bones; of an estimator without one of the joints, not."""
    neck, upper, lower = bones
    if not min(upper, lower) > 0:
        return False
    return abs(math.log(upper / lower)) > math.log(longer) or neck > most * upper
