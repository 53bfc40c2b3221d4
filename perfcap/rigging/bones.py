"""The skeleton's bones as line segments inside the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LARGER = 20.0  # than the other, of bones and mesh: one of them is in another unit
_FAR = 0.2  # of the bones' extent that most of a mesh is nearer to them
_SOME = 5000  # vertices that are looked at
LANDMARK_ENDS = ("head_top", "l_toe", "r_toe")
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

    def require_near(self, vertices: Floats) -> None:
        """Refuse bones that are not those of a mesh (V, 3): in another unit, or other axes.

        Raises:
            InputError: most of the mesh is far from all of them, or they are larger by far.
        """
        ends = np.concatenate((self.start, self.end))
        bones, mesh = (float(np.linalg.norm(np.ptp(each, 0))) for each in (ends, vertices))
        far = float(
            np.median(self.nearest_points(vertices[:: len(vertices) // _SOME + 1])[1].min(1))
        )
        if not mesh / _LARGER <= bones <= mesh * _LARGER or far > _FAR * bones:
            raise InputError(
                f"bones are not those of the mesh: they extend over {bones:.3g}, the mesh over "
                f"{mesh:.3g}, and half of it is more than {far:.3g} from any; expected both in "
                "metres, in the same pose and with the same axis up"
            )


def skeleton_bones(positions: Mapping[str, Floats]) -> Bones:
    """Bones of the skeleton from rest positions of its joints and landmarks, (3,) metres each.

    Hands end in the middle of the fingers, heels below the ankle on the level of the toes.

    Raises:
        InputError: one is missing, or is no place.
    """
    at = {name: np.asarray(place, dtype=np.float64) for name, place in positions.items()}
    missing = [name for name in (*JOINTS, *LANDMARK_ENDS) if name not in at]
    if missing:
        names = ", ".join((*JOINTS, *LANDMARK_ENDS))
        raise InputError(f"joints lack {', '.join(missing)}; give positions of {names}")
    for name, place in at.items():
        if place.shape != (3,) or not np.isfinite(place).all():
            raise InputError(
                f"{name} is at {place.tolist()!s:.60}, an array {place.shape}; expected a place "
                "(3,), metres"
            )
    for side in "lr":
        wrist, ankle = at[f"{side}_wrist"], at[f"{side}_ankle"]
        at[f"{side}_hand"] = wrist + _HAND * (wrist - at[f"{side}_elbow"])
        at[f"{side}_heel"] = np.array([ankle[0], at[f"{side}_toe"][1], ankle[2]])
    pairs = [(JOINTS.index(joint), at[joint], at[end]) for joint in JOINTS for end in _ENDS[joint]]
    owner, start, end = zip(*pairs, strict=True)
    return Bones(tuple(JOINTS), np.stack(start), np.stack(end), np.array(owner))
