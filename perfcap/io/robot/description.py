"""A robot as its file describes it: bodies, hinges and shapes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError

Floats = NDArray[np.float64]


_WIDEST = 4 * math.pi  # rad: limits farther apart are degrees, or none
_FEW = 5  # joints with limits
_NARROWEST = math.radians(_WIDEST)  # rad: limits of all joints nearer than that were radians


@dataclass(frozen=True)
class RobotHinge:
    """An angle of a robot, in the frame of its body.

    Attributes:
        name: of the joint in the file.
        anchor: where it turns, (3,) m.
        axis: unit axis, (3,).
        lower, upper: limits, radians; infinite where there are none.
        rest: the value at which the robot stands as drawn, radians.
    """

    name: str
    anchor: Floats
    axis: Floats
    lower: float = -math.inf
    upper: float = math.inf
    rest: float = 0.0


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid part.

    Attributes:
        name: in the file.
        parent: index, -1 for the root.
        pose: body to parent as drawn, (4, 4) m.
        hinges: from the first, at the parent, to the last.
        shapes: vertices (V, 3) m in the frame of the body, and triangles (T, 3).
    """

    name: str
    parent: int
    pose: Floats
    hinges: tuple[RobotHinge, ...] = ()
    shapes: tuple[tuple[Floats, NDArray[np.int64]], ...] = ()


@dataclass(frozen=True, eq=False)
class Robot:
    """Bodies, parents first; the first is the root, which moves freely.

    Attributes:
        name: of the robot.
        bodies: B.
        notes: what a user should know.
    """

    name: str
    bodies: tuple[Body, ...]
    notes: tuple[str, ...] = ()

    def world(self) -> Floats:
        """Body-to-world transforms as drawn, (B, 4, 4)."""
        found = np.empty((len(self.bodies), 4, 4))
        for index, body in enumerate(self.bodies):
            found[index] = body.pose if body.parent < 0 else found[body.parent] @ body.pose
        return found

    def below(self, body: int) -> list[int]:
        """A body and all that hangs on it, parents first."""
        found = {body}
        for index in range(body + 1, len(self.bodies)):
            if self.bodies[index].parent in found:
                found.add(index)
        return sorted(found)

    def above(self, body: int) -> list[int]:
        """A body and what it hangs on, up to the root."""
        found = [body]
        while self.bodies[found[-1]].parent >= 0:
            found.append(self.bodies[found[-1]].parent)
        return found

    def checked(self) -> Robot:
        """The same with unique names.

        Raises:
            InputError: it has no hinges, hinges of one name, or numbers that are none.
        """
        hinges = [hinge.name for body in self.bodies for hinge in body.hinges]
        if len(self.bodies) < 2 or not hinges:
            raise InputError(f"{self.name}: has no bodies on hinges; expected a humanoid")
        twice = sorted({name for name in hinges if hinges.count(name) > 1})
        if twice:
            raise InputError(f"{self.name}: several joints are named {', '.join(twice)[:80]}")
        names: dict[str, None] = {}
        for number, body in enumerate(self.bodies):
            name = body.name or f"body{number}"
            names[name if name not in names else f"{name}_{number}"] = None
        bodies = tuple(replace(b, name=n) for b, n in zip(self.bodies, names, strict=True))
        for body in bodies:
            if not np.isfinite(body.pose).all() or np.abs(body.pose).max() > 1e3:
                raise InputError(f"{self.name}: {body.name} is at no place in metres")
        return replace(self, bodies=bodies, notes=(*self.notes, *self._degrees()))

    def _degrees(self) -> Iterator[str]:
        """That limits look like degrees, or like radians that were taken for degrees."""
        hinges = [hinge for body in self.bodies for hinge in body.hinges]
        spans = [h.upper - h.lower for h in hinges if h.upper - h.lower < math.inf]
        if len(spans) > _FEW and max(spans) < _NARROWEST:
            yield (
                f"{self.name}: its joints turn by {math.degrees(max(spans)):.2g} degrees at most; "
                'are limits in radians? MJCF has degrees unless it says <compiler angle="radian"/>'
            )
        wide = [h for h in hinges if math.inf > h.upper - h.lower > _WIDEST]
        if wide:
            hinge = wide[0]
            yield (
                f"{self.name}: {len(wide)} of {len(hinges)} joints have limits such as "
                f"{hinge.lower:.4g} to {hinge.upper:.4g} rad ({hinge.name!r:.40}); they look like "
                "degrees and hold nothing back: write radians"
            )


def coupled_note(path: Path, names: Sequence[str], element: str) -> list[str]:
    """That joints follow others, which nothing here makes them do."""
    if not names:
        return []
    return [
        f"{path}: joints {', '.join(names)[:200]} follow others ({element}), but are solved as if "
        "they were free; set them from those before you play a motion"
    ]
