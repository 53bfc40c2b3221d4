"""Which way is up in the world of a finished capture, for everybody in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.result import Result
from perfcap.pipeline.surroundings import (
    axis,
    shared_up,
    up_doubt,
    upright,
    upright_together,
)

_LEANS = 10.0  # degrees of a floor that are spoken of; on axes of a world it leans by none
_STANDS = 0.9  # support of a floor that is believed


@dataclass(frozen=True, eq=False)
class Level:
    """What people say about their world.

    Attributes:
        axis: along which they stand, of the world, (3,).
        agreed: whether that is y by agreement, as of a retargeted motion.
        normal: of the floor that their feet stand on, (3,); None where none was found.
    """

    axis: Tensor
    agreed: bool = False
    normal: Tensor | None = None

    def chosen(self, option: str, value: str) -> tuple[Tensor, list[str]]:
        """The direction (3,) that an option names, and what to say about it.

        Args:
            option: for messages.
            value: ``auto``, ``floor``, or an axis.

        Raises:
            InputError: another value, or no floor was found.
        """
        if value == "floor":
            if self.normal is None:
                raise InputError(
                    f"{option} floor: the capture found none; expected auto or an axis"
                )
            return self.normal, []
        up = self.axis if value == "auto" else axis(value).to(self.axis)
        lines = [f"{option} {value}: {line}" for line in [up_doubt(up, self.axis)] if line]
        if self.normal is not None and not lines:
            lean = math.degrees(math.acos(min(1.0, float(self.normal @ up))))
            if lean > _LEANS:
                lines.append(
                    f"the floor that was found leans by {lean:.0f} degrees against the axis of the "
                    f"world that is taken for up; {option} floor makes it level"
                )
        return up, lines


def level_of(results: Sequence[Result]) -> Level:
    """Which way is up for the people of a capture."""
    people = [torch.from_numpy(result.joints) for result in results]
    if all(result.level for result in results):
        up = upright(people[0], level=True)
        return Level(up, agreed=True, normal=up)
    along = upright_together(people)
    normals = [each for each in map(_normal, results) if each is not None and each @ along > 0.5]
    normal = normals[shared_up(people, normals)] if normals else None
    return Level(along, normal=normal)


def _normal(result: Result) -> Tensor | None:
    """Of the floor that a report states, where it is to be believed."""
    floor = result.report.get("floor")
    if not isinstance(floor, dict):
        return None
    try:
        normal = torch.tensor([float(value) for value in floor["normal"]], dtype=torch.float64)
        support = float(floor["support"])
    except (KeyError, TypeError, ValueError, OverflowError):
        return None
    known = normal.shape == (3,) and abs(float(normal.norm()) - 1) < 1e-3 and support >= _STANDS
    return normal if known else None
