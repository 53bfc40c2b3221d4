"""What sentences about a truth call its frames and joints, and stretches of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

_HOLE = 3  # frames


@dataclass(frozen=True)
class Numbered:
    """What sentences call frames and joints; both are counted from 0 where nothing is given.

    Attributes:
        frames: numbers, (F,).
        joints: names, (J,).
    """

    frames: Sequence[int] = ()
    joints: Sequence[str] = ()

    def joint(self, index: int) -> str:
        """Its name."""
        return self.joints[index] if self.joints else f"joint {index}"

    def stretch(self, first: int, last: int) -> str:
        """The frames from one row to another in words."""
        ends = [self.frames[row] if self.frames else row for row in (first, last)]
        return f"frame {ends[0]}" if first == last else f"frames {ends[0]} to {ends[1]}"


def runs(wrong: Tensor, hole: int = _HOLE) -> list[tuple[int, int]]:
    """First and last frames of stretches that are wrong, (F,), with holes that are short."""
    found: list[tuple[int, int]] = []
    for frame in wrong.nonzero()[:, 0].tolist():
        if found and frame - found[-1][1] <= hole + 1:
            found[-1] = found[-1][0], frame
        else:
            found.append((frame, frame))
    return found
