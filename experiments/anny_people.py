"""Random adults of the `anny` package, posed, with known joints: what body fits are scored on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.errors import InputError

Floats = NDArray[np.float64]

BONES = {
    "pelvis": "root",
    "spine": "spine01",
    "neck": "neck01",
    "head": "head",
    **{
        f"{side}_{ours}": f"{theirs}.{side.upper()}"
        for side in "lr"
        for ours, theirs in (
            ("shoulder", "upperarm01"),
            ("elbow", "lowerarm01"),
            ("wrist", "wrist"),
            ("hip", "upperleg01"),
            ("knee", "lowerleg01"),
            ("ankle", "foot"),
            ("toe", "toe3-1"),
        )
    },
}
_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


@dataclass(frozen=True, eq=False)
class Person:
    """A body, y up, facing +z, metres: vertices (V, 3), faces (T, 3), joints by name.

    ``rest`` and ``rest_joints`` are the same body in its rest pose.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    joints: dict[str, Floats]
    rest: Floats
    rest_joints: dict[str, Floats]


class People:
    """Draws people; loading takes seconds, two minutes the first time."""

    def __init__(self, seed: int) -> None:
        try:
            import anny
        except ImportError as error:
            raise InputError("anny is not installed; pip install 'perfcap[body]'") from error
        self.model: Any = anny.Anny()
        self.rng = np.random.default_rng(seed)

    def draw(self, raised: tuple[float, float] = (-15.0, 45.0)) -> Person:
        """A random adult whose arms are raised by some degrees from the A-pose."""
        return self.pose(self.shape(), raised)

    def shape(self) -> dict[str, float]:
        """Who: parameters of a random adult."""
        rng = self.rng
        return {
            "gender": float(rng.integers(2)),
            "age": float(2 / 3 + rng.uniform(0, 0.25)),
            "muscle": float(rng.beta(2, 2)),
            "weight": float(rng.beta(2, 2)),
            "height": float(np.clip(rng.normal(0.41, 0.09), 0, 1)),
            "proportions": float(rng.uniform()),
        }

    def pose(self, shape: dict[str, float], raised: tuple[float, float]) -> Person:
        """Somebody in a random pose."""
        values = {name: torch.tensor([value]) for name, value in shape.items()}
        turns = self._turns(self.rng.uniform(*raised))
        out = self.model(pose_parameters=turns, phenotype_kwargs=values)
        return Person(
            vertices=out["vertices"][0].double().numpy() @ _Y_UP.T,
            faces=self.model.faces.numpy().astype(np.int64),
            joints=self._joints(out["bone_poses"][0, :, :3, 3]),
            rest=out["rest_vertices"][0].double().numpy() @ _Y_UP.T,
            rest_joints=self._joints(out["rest_bone_heads"][0]),
        )

    def _joints(self, heads: torch.Tensor) -> dict[str, Floats]:
        places = heads.double().numpy() @ _Y_UP.T
        index = {bone: k for k, bone in enumerate(self.model.bone_labels)}
        return {ours: places[index[theirs]] for ours, theirs in BONES.items()}

    def _turns(self, raised: float) -> dict[str, torch.Tensor]:
        """Rotations of limbs, degrees: arms as asked, all else a little."""
        turns = {}
        for side, sign in (("L", 1.0), ("R", -1.0)):
            small = self.rng.normal(0, 4, (4, 3))
            turns[f"upperarm01.{side}"] = small[0] + (0, -sign * raised, 0)
            turns[f"lowerarm01.{side}"] = small[1]
            turns[f"upperleg01.{side}"] = 0.6 * small[2]
            turns[f"lowerleg01.{side}"] = 0.4 * small[3]
        matrices = {}
        for bone, angles in turns.items():
            matrix = torch.eye(4)[None].clone()
            rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
            matrix[0, :3, :3] = torch.tensor(rotation)
            matrices[bone] = matrix
        return matrices
