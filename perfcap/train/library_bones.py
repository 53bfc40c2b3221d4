"""Whether people of a library of motion have feet and hands where those of people are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError

# Bones in parts of the ones before: feet of the CMU library have 0.25 to 0.32 of the shank, its
# forearms 0.45 to 0.70 of the upper arm, those of perfcap's actors up to 1.06; to the finger tips
# they have 1.24 and more
_RATIOS = (
    ("foot", ("ankle", "toe"), ("knee", "ankle"), (0.12, 0.6)),
    ("forearm", ("elbow", "wrist"), ("shoulder", "elbow"), (0.35, 1.2)),
)


def require_ends(path: Path, clips: Mapping[str, Tensor]) -> None:
    """Refuse motion whose toes are at the ankles, or wrists at the finger tips.

    As of skeletons that have no such joints, which were filled in.

    Args:
        path: of the library, for messages.
        clips: landmarks (F, 16, 3) by name.

    Raises:
        InputError: says which clip and bone.
    """
    for name, points in clips.items():
        at = {landmark: points[0, k] for k, landmark in enumerate(LANDMARKS)}
        for bone, own, before, (least, most) in _RATIOS:
            length, other = (
                sum(float((at[f"{s}_{a}"] - at[f"{s}_{b}"]).norm()) for s in "lr") / 2
                for a, b in (own, before)
            )
            if not least * other < length < most * other:
                raise InputError(
                    f"{path}: clip {name}: a {bone} ({own[0]} to {own[1]}) is {length:.2g} m long, "
                    f"{length / max(other, 1e-6):.2g} of the bone before; of people it is {least} "
                    f"to {most}: give offsets_m of these joints themselves, a lifter learns them"
                )
