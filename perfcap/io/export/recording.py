"""A capture on its way out: the frames that leave, upright, in the axes of a format."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io.result import Result
from perfcap.io.surface_file import BLOCK

Floats = NDArray[np.float64]

Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From y up, facing +z, to z up, facing -y; rotation (3, 3)."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Consecutive frames of a result, in metres.

    Attributes:
        result: the capture.
        name: what files and their contents are called.
        first: the first of its frames that leaves.
        stop: the frame after the last one.
        upright: rotation from the world of the capture to one with y up, (3, 3).
        axes: rotation from there, rest pose and all, to the axes of a format, (3, 3).
    """

    result: Result
    name: str
    first: int
    stop: int
    upright: Floats = field(default_factory=lambda: np.eye(3))
    axes: Floats = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if not 0 <= self.first < self.stop <= self.result.frames:
            raise InputError(
                f"frames {self.first} to {self.stop - 1}: expected some of the "
                f"{self.result.frames} that {self.result.folder} holds"
            )

    @property
    def frames(self) -> int:
        """F."""
        return self.stop - self.first

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self.result.rate

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers of the frames in the video, (F,)."""
        return self.result.frame_numbers[self.first : self.stop]

    @property
    def times(self) -> Floats:
        """Seconds since the video's first frame, (F,)."""
        return np.asarray(self.numbers / self.rate)

    def part(self, start: int, stop: int) -> Self:
        """Frames ``start`` to ``stop`` of these."""
        return replace(self, first=self.first + start, stop=self.first + stop)

    def pieces(self, most: int) -> Iterator[Self]:
        """Consecutive parts of about the same length, of at most so many frames each."""
        count = -(-self.frames // max(1, most))
        bounds = [self.frames * number // count for number in range(count + 1)]
        for start, stop in pairwise(bounds):
            yield self.part(start, stop)

    @property
    def surface_name(self) -> str:
        """Of a file with the surface of these frames among those of others."""
        return f"{self.name}_surface_{self.numbers[0]:06d}-{self.numbers[-1]:06d}"

    def facing_up(self, up: str) -> Self:
        """The same with ``y`` or ``z`` up, its rest pose too."""
        return replace(self, axes=Z_UP if up == "z" else np.eye(3))

    @cached_property
    def template(self) -> Template:
        """The mesh on its skeleton in the rest pose."""
        template = replace(self.result.template, name=self.name)
        if np.array_equal(self.axes, np.eye(3)):
            return template
        rest = template.bone_rest.copy()
        rest[:, :3] = self.axes @ rest[:, :3]
        return replace(
            template, vertices=template.vertices @ self.axes.T, bone_rest=rest, space=None
        )

    @cached_property
    def bone_transforms(self) -> Floats:
        """Rest-to-posed transforms of the template's bones, (F, B, 4, 4)."""
        found = self.result.bone_transforms[self.first : self.stop].copy()
        turn = self.axes @ self.upright
        found[..., :3, :3] = turn @ found[..., :3, :3] @ self.axes.T
        found[..., :3, 3] = found[..., :3, 3] @ turn.T
        return found

    @property
    def posed_bones(self) -> Floats:
        """Bone-to-world transforms, (F, B, 4, 4)."""
        posed: Floats = self.bone_transforms @ self.template.bone_rest
        return posed

    @property
    def landmarks(self) -> Floats:
        """The 16 landmarks, (F, 16, 3)."""
        return self._turned(self.result.joints[self.first : self.stop])

    def vertices(self, start: int, stop: int) -> NDArray[np.float32]:
        """Vertices of frames ``start`` to ``stop`` of these, (f, V, 3).

        Raises:
            InputError: the captured ones are damaged.
        """
        last = min(self.first + stop, self.stop)
        found = self.result.vertices(slice(self.first + start, last))
        return self._turned(found).astype(np.float32, copy=False)

    def blocks(self, size: int = BLOCK) -> Iterator[NDArray[np.float32]]:
        """Vertices of all frames in order, ``size`` frames at a time."""
        for start in range(0, self.frames, size):
            yield self.vertices(start, start + size)

    def _turned(self, points: NDArray[Any]) -> NDArray[Any]:
        turn = self.axes @ self.upright
        if np.array_equal(turn, np.eye(3)):
            return points
        turned: NDArray[Any] = points @ turn.T.astype(points.dtype)
        return turned
