"""Where SMPL's 24 joints are, from its parameters and the few numbers of the model that matter.

Joints are linear in the shape, and skinning does not move them: positions need the rest joints, how
they change with the shape, and the tree. The model itself is licensed and is not here; ``smpl.npz``
is made of one's own copy, see docs/datasets.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.archive import read_archive
from perfcap.io.datasets.layout import array_of

JOINTS = 24
_WHAT = "smpl.npz: joints (24, 3), joint_shapes (24, 3, 10), parents (24)"


@dataclass(frozen=True, eq=False)
class SmplJoints:
    """The joints of a body model of one sex.

    Attributes:
        rest: joints of the mean shape, (24, 3), metres.
        shapes: how they move with each shape parameter, (24, 3, S), metres.
        parents: of each joint, (24,); -1 of the root, which comes first.
    """

    rest: Tensor
    shapes: Tensor
    parents: tuple[int, ...]

    def positions(self, rotations: Tensor, shape: Tensor, translation: Tensor) -> Tensor:
        """Joints in the world, (F, 24, 3), metres (Loper et al. 2015, Eq. 2 to 4).

        Args:
            rotations: of each joint against its parent, rotation vectors, (F, 24, 3).
            shape: (S',), at most S count.
            translation: (F, 3), metres.
        """
        count = min(self.shapes.shape[-1], len(shape))
        rest = self.rest + self.shapes[..., :count] @ shape[:count]
        local = rotvec_to_matrix(rotations)
        turned, placed = [local[:, 0]], [rest[0].expand(len(rotations), 3)]
        for joint in range(1, JOINTS):
            parent = self.parents[joint]
            bone = rest[joint] - rest[parent]
            turned.append(turned[parent] @ local[:, joint])
            placed.append(placed[parent] + (turned[parent] @ bone))
        return torch.stack(placed, 1) + translation.unsqueeze(1)


def read_smpl_joints(path: Path) -> SmplJoints:
    """Read the joints of a model.

    Raises:
        InputError: the file is missing or holds something else.
    """
    values = read_archive(path, ("joints", "joint_shapes", "parents"), _WHAT)
    rest = array_of(f"{path}: joints", values.get("joints"), (JOINTS, 3))
    shapes = array_of(f"{path}: joint_shapes", values.get("joint_shapes"), (JOINTS, 3, None))
    parents = array_of(f"{path}: parents", values.get("parents"), (JOINTS,)).astype(int)
    parents[0] = -1  # SMPL's own file has a very large number there
    if not ((parents[1:] >= 0) & (parents[1:] < np.arange(1, JOINTS))).all():
        raise InputError(f"{path}: parents are {parents.tolist()}, expected each before its child")
    return SmplJoints(torch.from_numpy(rest), torch.from_numpy(shapes), tuple(parents.tolist()))
