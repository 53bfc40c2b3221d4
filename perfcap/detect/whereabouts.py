"""Where a person was seen last, and whether a look may be at the same person."""

from __future__ import annotations

from dataclasses import dataclass, replace

from perfcap.detect.joint_set import JointSet
from perfcap.detect.look import Box, Look, sureness

_SHRUNK = 0.6  # of the size in the frame before: what is less may be something else
_JUMPED = 0.5  # of that size, for the middle
NEARBY = 1.0  # of that size: whoever is lost for a few frames comes back within it
UNSURE = 0.4  # mean confidence below which somebody may have turned upside down
AGE = 8  # frames after which somebody who was lost may be anywhere and of any size


@dataclass(frozen=True)
class Whereabouts:
    """Where the person was seen last: the box, and how many frames ago."""

    box: Box | None = None
    age: int = 0
    ever: bool = False

    def after(self, look: Look | None) -> Whereabouts:
        """The same one frame later, in which a look was at the person, or none."""
        box = None if look is None else look.box()
        if box is None:
            return replace(self, age=self.age + 1)
        return Whereabouts(box, 0, True)

    def doubts(self, look: Look) -> bool:
        """Whether a look shows something smaller, or elsewhere, than a frame before."""
        box = look.box()
        if box is None or self.box is None or not self._recent():
            return False
        return _size(box) < _SHRUNK * _size(self.box) or self.moved(box) > _JUMPED

    def near(self, look: Look) -> bool:
        """Whether a look may be at the person, by where it is; anywhere, if that was long ago."""
        box = look.box()
        return box is None or not self._recent() or self.moved(box) <= NEARBY

    def likely(self, look: Look, joint_set: JointSet) -> float:
        """How sure a look is, less the farther away it is from where the person was of late."""
        sure = sureness(look.confidence, joint_set)
        if not self._recent():
            return sure
        box = look.box()
        return sure - (1.0 if box is None else self.moved(box))

    def _recent(self) -> bool:
        return self.box is not None and self.age < AGE

    def moved(self, box: Box | None) -> float:
        """Distance of the middles, in sizes of the person."""
        if self.box is None or box is None:
            return 0.0
        x, y = (0.5 * (box[i] + box[i + 2] - self.box[i] - self.box[i + 2]) for i in (0, 1))
        return float((x * x + y * y) ** 0.5) / max(_size(self.box), 1e-6)


def _size(box: Box) -> float:
    return max(box[2] - box[0], box[3] - box[1])


ANYWHERE = Whereabouts()
