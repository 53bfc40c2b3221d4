"""Whether people of a library of motion have the limbs of people, and arms that move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError

# Bones in parts of the ones before, wider than of people and of any skeleton in use; copied joints
# have none, and to the finger tips forearms are longer
_RATIOS = (
    ("foot", ("ankle", "toe"), ("knee", "ankle"), (0.12, 0.6)),
    ("forearm", ("elbow", "wrist"), ("shoulder", "elbow"), (0.35, 1.2)),
)

# of legs that never turn, feet slide, which is refused elsewhere
_MOVE = ("LeftArm", "RightArm", "LeftForeArm", "RightForeArm")
_ENOUGH, _STILL = 60, 1e-6  # frames, and degrees that no recorded joint stays within


def require_moving(
    whose: Path | str, angles: Sequence[NDArray[np.float64]], names: Sequence[str]
) -> None:
    """Refuse a person an arm of whom is never turned, as where names were not found.

    Args:
        whose: clips they are, for messages.
        angles: of all joints in each clip, (F, J, 3) degrees.
        names: of the joints.

    Raises:
        InputError: says which joints.
    """
    every = np.concatenate(angles)
    if len(every) < _ENOUGH:
        return
    still = [name for name in _MOVE if np.ptp(every[:, names.index(name)], 0).max() < _STILL]
    if still:
        raise InputError(
            f"{whose}: {', '.join(still)} have the same angles in every frame, which no person "
            "has; fill euler_zyx_deg of these joints from those of your skeleton, whose names may "
            "be others"
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
