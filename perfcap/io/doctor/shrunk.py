"""2D joints that shrink towards the image's corner at an end of a clip, as zeros beside it do."""

from __future__ import annotations

from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity, ranges

_SURE, _JOINTS = 0.3, 8  # confidence, and joints that two frames must share
_LONGEST = 15  # frames at an end: half of the window of an average of 31
_GROWN = 1.4  # times as large and as far from the corner; an average of three frames makes 1.5
_ALIKE, _ASIDE = 0.35, 0.15  # shares of the growth, by which size, and place across, may differ
_ENDED = 0.33  # share of the growth that may follow in as many frames


def examine_shrunk(subject: str, view: int, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Ends at which the person is smaller and, by as much, nearer to the corner of the image.

    People who come nearer grow about where they come from, and go on.

    Args:
        subject: of the finding.
        view: its number.
        pixels: joints, (F, 16, 2).
        confidence: (F, 16).
    """
    sure = confidence > _SURE
    first, last = _shrunk(pixels, sure), _shrunk(pixels.flip(0), sure.flip(0))
    count = len(pixels)
    frames = sorted({*range(first), *range(count - last, count)})
    if not frames:
        return []
    what = (
        f"the person shrinks towards the corner of the image in frames {ranges(frames)} (of the "
        "capture, counted from 0)"
    )
    remedy = (
        "did a filter take joints before the first or after the last frame for 0 (numpy.convolve "
        "with 'same', a mean from zeros)? Smooth with what is there alone, or not at all"
    )
    return [Finding(Severity.WARNING, subject, what, remedy, tuple(frames), (view,))]


def _shrunk(pixels: Tensor, sure: Tensor) -> int:
    """Frames from the first on in which joints (F, 16, 2) are smaller than in those that follow."""
    for after in range(1, min(_LONGEST, (len(pixels) - 1) // 2) + 1):
        grown = _growth(pixels[0], pixels[after], sure[0] & sure[after])
        if grown < _GROWN:
            continue
        later = _growth(pixels[after], pixels[2 * after], sure[after] & sure[2 * after], loose=True)
        if abs(later - 1) < _ENDED * (grown - 1):
            return after
    return 0


def _growth(before: Tensor, after: Tensor, both: Tensor, *, loose: bool = False) -> float:
    """How much farther joints (16, 2) are from the corner; 0 where they are not as much larger."""
    if int(both.sum()) < _JOINTS:
        return 0.0
    before, after = before[both], after[both]
    middle, there = before.mean(0), after.mean(0)
    far = float(middle @ middle)
    if far <= 0:
        return 0.0
    grown = float(there @ middle) / far
    if loose:
        return grown
    about = before - middle
    larger = float((about * (after - there)).sum() / about.square().sum().clamp(min=1e-9))
    aside = float((there - grown * middle).norm()) / far**0.5
    alike = abs(larger - grown) < _ALIKE * (grown - 1) and aside < _ASIDE * (grown - 1)
    return grown if alike else 0.0
