"""Which part of a body each face of a mesh is: what a detector learns sides from.

A joint's place says once a crop which side is left; parts say it at every pixel of the person.
Head and trunk are told apart in front and back, limbs in left and right.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.anatomy import JOINTS

_HALVED = ("head", "trunk", "skirt")
_LIMBS = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
PARTS = (
    "background",
    *(f"{part}_{half}" for part in _HALVED for half in ("front", "back")),
    *(f"{side}_{limb}" for limb in _LIMBS for side in "lr"),
)
UNKNOWN = 255  # label of a pixel of which nothing is known

_OF_JOINT = {
    "pelvis": "trunk",
    "spine": "trunk",
    "neck": "head",
    "head": "head",
    "shoulder": "upper_arm",
    "elbow": "forearm",
    "wrist": "hand",
    "hip": "thigh",
    "knee": "shank",
    "ankle": "foot",
}
_LEVEL = 4  # pixels of a picture along one of its map of parts


def face_parts(rest: Tensor, faces: Tensor, owner: Tensor) -> Tensor:
    """Index in ``PARTS`` of each face.

    Args:
        rest: vertices at rest, (V, 3) m, y up, facing +z.
        faces: (T, 3).
        owner: joint of the largest weight of each vertex, index in ``JOINTS``, (V,).

    Returns:
        (T,) uint8; a face has the part of its first corner.
    """
    fronts = torch.tensor([_front(name) for name in JOINTS])[owner]
    halved = torch.tensor([_part(name) in _HALVED for name in JOINTS])[owner]
    for part in sorted(set(fronts[halved].tolist())):
        here = halved & (fronts == part)
        depth = rest[here, 2]
        behind = depth < 0.5 * (depth.min() + depth.max())
        fronts[here] = part + behind.long()
    return fronts[faces[:, 0]].to(torch.uint8)


def skirt_parts(ahead: Tensor) -> Tensor:
    """The same of a skirt's faces, given which are before the wearer, (T,) bool."""
    return PARTS.index("skirt_back") - ahead.to(torch.uint8)


def part_map_size(size: int) -> int:
    """Pixels along the map of parts of a picture of ``size`` pixels."""
    return size // _LEVEL


def mirrored_parts() -> NDArray[np.uint8]:
    """Part in the mirror of every label from 0 to 255."""
    table = np.arange(256, dtype=np.uint8)
    for index, name in enumerate(PARTS):
        side, _, limb = name.partition("_")
        if side in "lr":
            table[index] = PARTS.index(f"{'r' if side == 'l' else 'l'}_{limb}")
    return table


def _part(joint: str) -> str:
    return _OF_JOINT[joint.rpartition("_")[2]]


def _front(joint: str) -> int:
    part = _part(joint)
    return PARTS.index(f"{part}_front" if part in _HALVED else f"{joint[0]}_{part}")
