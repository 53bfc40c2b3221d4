"""What bodies of a model measure, as a function of their coefficients of shape."""

from __future__ import annotations

from dataclasses import asdict, fields

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import TAPE_JOINTS, Measurements, arm_vertices, take

Floats = NDArray[np.float64]

DENSITY = 985.0  # kg per cubic metre, of a body with half-filled lungs
LENGTHS = tuple(field.name for field in fields(Measurements))

_NUDGE = 0.2  # of a coefficient, for the slopes of measurements


class Scales:
    """Measures bodies, and how that changes with their shape.

    Args:
        model: the body.
        names: of what to measure: lengths, ``weight``, attributes of the model.
    """

    def __init__(self, model: BodyModel, names: tuple[str, ...] = LENGTHS) -> None:
        rig = model.rig
        self.model, self.names = model, names
        self.arm = arm_vertices(rig.bone_names, rig.bone_parents, rig.weight_bones, rig.weights)
        self.index = {name: rig.bone_names.index(name) for name in TAPE_JOINTS}

    def linearized(self, shape: Floats) -> tuple[Floats, Floats]:
        """Values (N,) of a shape (S,) and their slopes (N, S), by differences."""
        here = self.values(shape)
        moved = [self.values(shape + _NUDGE * step) for step in np.eye(len(shape))]
        return here, (np.stack(moved, 1) - here[:, None]) / _NUDGE

    def values(self, shape: Floats) -> Floats:
        """What a body measures, in the order of the names."""
        coefficients = torch.from_numpy(shape)
        vertices = self.model.vertices(coefficients).numpy()
        known: dict[str, float] = {}
        if set(self.names) & set(LENGTHS):
            bones = self.model.joints(coefficients).numpy()
            joints = {name: bones[index] for name, index in self.index.items()}
            known |= asdict(take(vertices, self.model.rig.faces, self.arm, joints))
        if "weight" in self.names:
            known["weight"] = mass(vertices, self.model.rig.faces)
        for name, (mean, slope) in self.model.rig.attributes.items():
            known[name] = mean + float(shape @ slope[: len(shape)])
        return np.array([known[name] for name in self.names])


def mass(vertices: Floats, faces: NDArray[np.int64]) -> float:
    """Kilograms of a closed surface at the density of a body."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(DENSITY * np.einsum("nk,nk->n", a, np.cross(b, c)).sum() / 6)
