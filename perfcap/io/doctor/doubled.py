"""Two joints of which one is a copy of the other."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding, Severity

_FEWEST, _SHARE = 6, 0.5  # frames that show both joints, and of them such that have them in one
_GUESSED = [[LANDMARKS.index(f"{side}_{name}") for name in ("ankle", "toe")] for side in "rl"]
_REMEDY = (
    "give a joint that was not found, or that the network does not have, the confidence 0 (3D "
    "joints NaN), or the column that is its own"
)


def examine_doubled(
    subject: str, joints: Tensor, known: Tensor, *, true: bool = False
) -> list[Finding]:
    """Joints that lie on another one to the last digit: those of people do so by accident alone.

    Args:
        subject: of the finding.
        joints: landmarks (F, 16, D), in pixels or metres.
        known: which of them count, (F, 16).
        true: whether they are a truth, which has toes.
    """
    both = known[:, :, None] & known[:, None]  # F 16 16
    same = both & (joints[:, :, None] == joints[:, None]).all(-1)
    shown, shared = both.sum(0), same.sum(0)
    doubled = torch.triu((shown >= _FEWEST) & (shared > _SHARE * shown), diagonal=1)
    pairs = doubled.nonzero().tolist()
    if joints.shape[-1] == 3 and not true:  # poses of networks without toes have ankles there
        pairs = [pair for pair in pairs if pair not in _GUESSED]
    if not pairs:
        return []
    said = ", ".join(f"{LANDMARKS[first]} and {LANDMARKS[second]}" for first, second in pairs[:3])
    said += f" and {len(pairs) - 3} more pairs" if len(pairs) > 3 else ""
    least = min(float(shared[first, second] / shown[first, second]) for first, second in pairs)
    where = "every frame" if least == 1 else f"{least:.0%} of the frames"
    what = f"{said} lie at one place, to the last digit, in {where}: one is a copy"
    return [Finding(Severity.WARNING, subject, what, _REMEDY)]
