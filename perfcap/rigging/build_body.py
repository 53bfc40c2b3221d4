"""A body from what is known of a person: height, girths, weight, age."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import TAPE_JOINTS, Measurements, arm_vertices, measure, take
from perfcap.actor.template import Template
from perfcap.errors import InputError

# --- What bodies of a model measure, as a function of their coefficients of shape -----------------

Floats = NDArray[np.float64]

_LOG = logging.getLogger(__name__)

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
        coefficients = torch.from_numpy(shape).to(self.model.surface.mean)
        vertices = self.model.vertices(coefficients).numpy(force=True)
        known: dict[str, float] = {}
        if set(self.names) & set(LENGTHS):
            bones = self.model.joints(coefficients).numpy(force=True)
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


# --- A body from what is known of a person: height, girths, weight, age ---------------------------

_ROUNDS = 5
_COMPONENTS = 12  # later ones are details that nobody is measured for
_MOST = 3.5  # deviations
# How exactly a value is met, against one deviation of shape; and what is plausible.
_TOLERANCE = {
    **dict.fromkeys(LENGTHS, 0.004),
    "weight": 0.7,
    "gender": 0.08,
    "age": 6.0,
    "muscle": 0.08,
}
_RANGE = {
    "height": (1.3, 2.2),
    "chest": (0.5, 1.8),
    "waist": (0.4, 1.8),
    "hip": (0.5, 1.8),
    "inseam": (0.5, 1.2),
    "weight": (30.0, 200.0),
    "gender": (0.0, 1.0),
    "age": (18.0, 90.0),
    "muscle": (0.0, 1.0),
}
_THINNEST = 14.0  # kg/m², body mass index; below 16 is severe thinness (WHO)
_MISSED = 6.0  # tolerances: 2.4 cm of a girth, 4 kg
_UNITS = {**dict.fromkeys(LENGTHS, "metres"), "weight": "kilograms", "age": "years"}


@dataclass(frozen=True)
class Person:
    """What is known of somebody; None for what is not.

    Attributes:
        height, chest, waist, hip, inseam: metres, as ``Measurements``.
        weight: kilograms.
        gender: 0 male to 1 female.
        age: years.
        muscle: 0 to 1.
    """

    height: float | None = None
    chest: float | None = None
    waist: float | None = None
    hip: float | None = None
    inseam: float | None = None
    weight: float | None = None
    gender: float | None = None
    age: float | None = None
    muscle: float | None = None

    def __post_init__(self) -> None:
        for name, value in self.known().items():
            low, high = _RANGE[name]
            if not low <= value <= high:
                unit = _UNITS.get(name, "")
                raise InputError(
                    f"{name} is {value:g}; expected {low:g} to {high:g} {unit}".strip()
                )

    def known(self) -> dict[str, float]:
        """Values that are not None, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: float(value) for name, value in values.items() if value is not None}


@dataclass(frozen=True, eq=False)
class BuiltBody:
    """A body.

    Attributes:
        template: the rigged body.
        shape: its coefficients, (S,).
        measurements: of it, metres.
        weight: kilograms.
        missed: what was asked for and is far from being met: the values of the body.
    """

    template: Template
    shape: Tensor
    measurements: Measurements
    weight: float
    missed: Mapping[str, float] = field(default_factory=dict)

    def doubts(self, person: Person) -> Iterator[str]:
        """A sentence on each value that the body does not have, and on one of skin and bones."""
        index = self.weight / self.measurements.height**2
        if index < _THINNEST:
            yield (
                f"the body weighs {self.weight:.0f} kg and is {self.measurements.height:.2f} m "
                "tall, as hardly anybody is; girths are measured around the body, not across it"
            )
        for name, value in self.missed.items():
            told = f"{value:.3g} {_UNITS.get(name, '')}".strip()
            yield (
                f"{name} is {told}, {person.known()[name]:.3g} was asked for: hardly anybody has "
                "all of these measures; check them"
            )


def build_body(model: BodyModel, person: Person) -> BuiltBody:
    """The likeliest body that has what is known of a person.

    Gauss-Newton on the coefficients of shape: squared misses in tolerances, and one for each
    squared deviation. Values that contradict each other are met as nearly as people come, and a
    warning is logged: see ``BuiltBody.doubts``.

    Raises:
        InputError: the model does not know an attribute that is asked for.
    """
    known = person.known()
    unknown = [
        n for n in ("gender", "age", "muscle") if n in known and n not in model.rig.attributes
    ]
    if unknown:
        raise InputError(
            f"body model {model.rig.name!r} knows no {', '.join(unknown)}; it knows "
            f"{', '.join(model.rig.attributes) or 'lengths and weight only'}"
        )
    count = min(_COMPONENTS, model.components)
    shape = np.zeros(count)
    missed: dict[str, float] = {}
    if known:
        scales = Scales(model, tuple(known))
        wanted = np.array(list(known.values()))
        scale = np.array([1 / _TOLERANCE[name] for name in known])
        for _ in range(_ROUNDS):
            here, slopes = scales.linearized(shape)
            rows = scale[:, None] * slopes
            right = rows.T @ (scale * (wanted - here + slopes @ shape))
            solved = np.linalg.solve(rows.T @ rows + np.eye(count), right)
            shape = np.clip(solved, -_MOST, _MOST)
        reached = scales.values(shape)
        far = np.abs(reached - wanted) * scale > _MISSED
        missed = {n: float(v) for n, v, each in zip(known, reached, far, strict=True) if each}
    full = torch.zeros(model.components, dtype=torch.float64)
    full[:count] = torch.from_numpy(shape)
    template = model.template(full)
    weight = mass(template.vertices, template.faces)
    built = BuiltBody(template, full, measure(template), weight, missed)
    for line in built.doubts(person):
        _LOG.warning("%s", line)
    return built
