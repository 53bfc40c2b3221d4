"""Whether single joints are in each other's place in one of several views."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.evidence import Scene, joint_residuals
from perfcap.io.doctor.finding import Finding, Severity

_LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "toe"))
# Of the residual of these joints, that is left once they are exchanged back. Of right ones in
# two to four views it is 0.69 or more, but for toes of 0.5 that are unlike the other joints
_BETTER = 0.4
_LEAST = 0.02  # of the person's height, of the residual
_LIKE = 2.0  # times that of all joints, which theirs then is at most
_FEWEST = 20  # residuals of the joints, over all frames


def examine_one_view(scene: Scene, names: Sequence[str], height: float) -> list[Finding]:
    """Joints of a view that fit those of the others where they are exchanged, throughout.

    Medians over all joints do not show a few of them.

    Args:
        scene: C views, (F, C), of joints seen with confidence.
        names: of the views.
        height: of the person, pixels.
    """
    given = joint_residuals(scene)
    usual, seen = float(given.nanmedian()), scene.detections.confidence2d > 0
    found: list[tuple[float, str, int]] = []
    for what, order in _orders():
        moved = [k for k, other in enumerate(order) if k != other]
        now = _median(given[:, moved])
        if not now * scene.focal > _LEAST * height:
            continue
        for view in range(len(names)):
            here = seen[:, view][:, moved] & seen[:, view][:, [order[k] for k in moved]]
            undone = joint_residuals(_exchanged(scene, view, order))
            left = _median(undone[:, moved][here])  # where a view loses joints, fewer disagree
            if left < min(_BETTER * _median(given[:, moved][here]), _LIKE * usual):
                # elbows are a part of arms: what explains most
                found.append((float(undone.nanmedian(0).values.nansum()), what, view))
    if not found:
        return []
    _, what, view = min(found)
    subject = names[view] if len(names) > 2 else " or ".join(names)
    views = (view,) if len(names) > 2 else (0, 1)
    what, remedy = f"{what} look exchanged in this view", "give all views in one order of joints"
    return [Finding(Severity.WARNING, subject, what, remedy, views=views)]


def _orders() -> Iterator[tuple[str, list[int]]]:
    """Mistakes in words, and the order of the landmarks that undoes each."""
    for limb in _LIMBS:
        for upper, lower in pairwise(limb):
            yield f"{upper}s and {lower}s", _order((f"{s}_{upper}", f"{s}_{lower}") for s in "lr")
        for joint in limb:
            yield f"l_{joint} and r_{joint}", _order([(f"l_{joint}", f"r_{joint}")])
        which = "arms" if "wrist" in limb else "legs"
        yield f"left and right of the {which}", _order((f"l_{j}", f"r_{j}") for j in limb)


def _order(pairs: Iterable[tuple[str, str]]) -> list[int]:
    order = list(range(len(LANDMARKS)))
    for one, other in pairs:
        a, b = LANDMARKS.index(one), LANDMARKS.index(other)
        order[a], order[b] = b, a
    return order


def _exchanged(scene: Scene, view: int, order: Sequence[int]) -> Scene:
    seen = scene.detections
    joints, confidence = seen.joints2d.clone(), seen.confidence2d.clone()
    joints[:, view], confidence[:, view] = joints[:, view][:, order], confidence[:, view][:, order]
    return Scene(scene.cameras, replace(seen, joints2d=joints, confidence2d=confidence))


def _median(residual: Tensor) -> float:
    known = residual[residual.isfinite()]
    return float(known.median()) if len(known) >= _FEWEST else torch.nan
