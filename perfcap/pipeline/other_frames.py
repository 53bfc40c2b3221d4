"""Whether joints that are given beside a capture are those of other frames."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

_MOVED = 0.005  # of the person's height: nearer joints are of the same frames, or of one who stands
_NEARER = 0.5  # of the distance at the same frames; joints of another detector keep more
# likewise, of few frames or one view of several: detectors are far off in such at times
_SAME = 0.1
_FEW = 8  # frames
_COUNTED = 0.5  # of the joints that count at the same frames
_SHOWN = 64  # frames that are compared: a person moves in them as in all
_FEWEST = 2  # frames that a shift must leave


class OtherFrames(NamedTuple):
    """Where the joints of views lie nearest to those of a capture; apart in the person's height.

    Attributes:
        shift: frames of the capture by which they are later; 0 where they run backwards.
        there: median distance there.
        here: that of the same joints to those of their own frames.
    """

    shift: int
    there: float
    here: float

    @property
    def words(self) -> str:
        """Such as ``4 frames earlier``."""
        if not self.shift:
            return "in reversed order"
        plural = "" if abs(self.shift) == 1 else "s"
        return f"{abs(self.shift)} frame{plural} {'later' if self.shift > 0 else 'earlier'}"


class Pair(NamedTuple):
    """Joints (F, C, J, 2) that are given and those of the capture, in heights of the person.

    And which of each count, (F, C, J).
    """

    given: Tensor
    kept: Tensor
    given_counts: Tensor
    kept_counts: Tensor

    def view(self, view: int) -> Pair:
        """Of one view."""
        return Pair(*(part[:, view : view + 1] for part in self))

    def apart(self, own: Tensor, others: Tensor) -> tuple[float, int]:
        """Median distance of joints of frames to those of others, and how many count in both."""
        counts = self.given_counts[own] & self.kept_counts[others]
        apart = (self.given[own] - self.kept[others]).norm(dim=-1)[counts]
        return (float(apart.median()) if len(apart) else float("nan")), len(apart)


def other_frames(pair: Pair) -> dict[int, OtherFrames]:
    """Of which other frames the joints of views are: all views together, or else single ones."""
    views = range(pair.given.shape[1])
    found = _nearest(pair, _NEARER)
    if found is not None:
        return dict.fromkeys(views, found)
    alone = {view: _nearest(pair.view(view), _SAME) for view in views if len(views) > 1}
    return {view: each for view, each in alone.items() if each is not None}


def _nearest(pair: Pair, nearer: float) -> OtherFrames | None:
    """Where joints lie nearest, by shifts up to half the clip; None where that is where they are.

    Right ones lie nearest there, however far a detector is off, and who stands still is as near to
    all. The same given frames are compared here and there, so that none weighs in one place only.
    """
    frames = len(pair.given)
    shown = torch.linspace(0, frames - 1, min(frames, _SHOWN)).round().long().to(pair.given.device)
    if not pair.apart(shown, shown)[0] > _MOVED:
        return None
    tried = [(0, shown, frames - 1 - shown)]
    for shift in range(-(frames // 2), frames // 2 + 1):
        inside = shown[(shown + shift >= 0) & (shown + shift < frames)]
        if shift and len(inside) >= _FEWEST:
            tried.append((shift, inside, inside + shift))
    best: OtherFrames | None = None
    for shift, own, others in tried:
        (there, counted), (here, usual) = pair.apart(own, others), pair.apart(own, own)
        least = min(nearer, _SAME) if len(own) < _FEW else nearer
        clear = here > _MOVED and there < least * here and counted >= _COUNTED * usual
        if clear and (best is None or there < best.there):
            best = OtherFrames(shift, there, here)
    return best
