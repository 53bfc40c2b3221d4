"""The skeleton's bones as line segments inside the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_HAND = 0.45  # from the wrist to the middle of the fingers, in forearms

# What moves with each joint: segments to the joints and landmarks that end its bones.
_ENDS = {
    "pelvis": ("spine", "l_hip", "r_hip"),
    "spine": ("neck", "l_shoulder", "r_shoulder"),
    "neck": ("head",),
    "head": ("head_top",),
    **{f"{s}_shoulder": (f"{s}_elbow",) for s in "lr"},
    **{f"{s}_elbow": (f"{s}_wrist",) for s in "lr"},
    **{f"{s}_wrist": (f"{s}_hand",) for s in "lr"},
    **{f"{s}_hip": (f"{s}_knee",) for s in "lr"},
    **{f"{s}_knee": (f"{s}_ankle",) for s in "lr"},
    **{f"{s}_ankle": (f"{s}_toe", f"{s}_heel") for s in "lr"},
}


@dataclass(frozen=True, eq=False)
class Bones:
    """Segments, and the joint each moves with.

    Attributes:
        names: of the joints, (J,).
        start, end: metres, (P, 3).
        owner: joint of each segment, (P,).
    """

    names: tuple[str, ...]
    start: Floats
    end: Floats
    owner: Integers

    def nearest_points(self, points: Floats) -> tuple[Floats, Floats]:
        """Nearest point of each segment (N, P, 3) and its distance (N, P), metres."""
        along = self.end - self.start
        length = np.maximum((along**2).sum(1), 1e-18)
        share = ((points[:, None] - self.start) * along).sum(-1) / length
        near = self.start + share.clip(0, 1)[..., None] * along
        distance: Floats = np.linalg.norm(points[:, None] - near, axis=-1)
        return near, distance


def skeleton_bones(positions: Mapping[str, Floats]) -> Bones:
    """Bones of the skeleton from rest positions of its joints and landmarks, (3,) metres each.

    Hands end in the middle of the fingers, heels below the ankle on the level of the toes.
    """
    at = {name: np.asarray(place, dtype=np.float64) for name, place in positions.items()}
    for side in "lr":
        wrist, ankle = at[f"{side}_wrist"], at[f"{side}_ankle"]
        at[f"{side}_hand"] = wrist + _HAND * (wrist - at[f"{side}_elbow"])
        at[f"{side}_heel"] = np.array([ankle[0], at[f"{side}_toe"][1], ankle[2]])
    pairs = [(JOINTS.index(joint), at[joint], at[end]) for joint in JOINTS for end in _ENDS[joint]]
    owner, start, end = zip(*pairs, strict=True)
    return Bones(tuple(JOINTS), np.stack(start), np.stack(end), np.array(owner))
