"""How well a surface overlaps the masks of a clip, and the guard that keeps what fits better."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from perfcap.io.doctor.held_masks import held_within
from perfcap.pipeline.checkpoint import ARRAY, NOTHING, Kept
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.sight import Outline, Sight
from perfcap.pipeline.surface import SurfaceFrames

# --- Whether masks lie where a captured person is -------------------------------------------------

_EXAMINED = 5  # frames
_ELSEWHERE = 0.2  # intersection over union; captures have more than half
_WAYS: dict[str, Callable[[Tensor], Tensor]] = {
    "upside down": lambda masks: masks.flip(-2),
    "mirrored": lambda masks: masks.flip(-1),
    "turned by 180°": lambda masks: masks.flip(-2, -1),
    "transposed": lambda masks: masks.mT,  # of square ones
}
_BETTER = 0.2  # of the same: more than a pose that is solved already is off
# Of the person's height, and of the overlap: that of bodies with the masks of three people whom a
# capture finds is the best where they are, of another actor's as well
_BESIDE, _FITS_BESIDE, _FEW = 0.03, 0.03, 2.5  # the last: pixels
_SHOWN = 0.1  # of the drawn person, of which less says nothing of where masks lie
_LARGER = 1.25  # areas of the captured person: masks that are drawn too wide, or of a coat


def examined(frames: int) -> Tensor:
    """A few frames, spread over a clip."""
    return torch.linspace(0, frames - 1, min(frames, _EXAMINED)).long()


def warn_of_masks_elsewhere(masks: Tensor, drawn: Tensor, trust: Tensor | None = None) -> None:
    """Warn of views whose masks the drawn person hardly meets, or is far from filling.

    Args:
        masks: (F, C, H, W), bool or from 0 to 1.
        drawn: coverage of the ``examined`` frames, (F', C, H, W).
        trust: how much each pixel counts, of a shape that broadcasts to the masks; those of 0 count
            neither in the masks nor in what is drawn. All count if not given.
    """
    some = examined(len(masks)).to(masks.device)
    found = masks[some] > 0.5
    shown = found.flatten(2).any(-1)[..., None, None]  # a mask may be missing
    model = (drawn > 0.5) & shown
    height = model.any(-1).sum(-1).amax(0).tolist()  # C
    known = _known(
        model, None if trust is None else trust.to(masks.device).expand(masks.shape)[some]
    )
    found, model = found & known, model & known
    share, there = _overlap(found, model)
    elsewhere = ((share < _ELSEWHERE) & there).nonzero().flatten().tolist()
    if elsewhere:
        worst = float(share[elsewhere].min())
        warnings.warn(
            f"masks of views {elsewhere} overlap the captured person by {worst:.0%} only; check "
            "that they are of these frames, not inverted, mirrored or transposed, and that cameras "
            "are in their pixels",
            stacklevel=3,
        )
        return
    how, gain = _other_way_up(found, model, known, torch.where(there, share, torch.inf))
    better = (gain > _BETTER).nonzero().flatten().tolist()
    if better:
        warnings.warn(
            f"masks of views {better} would overlap the captured person by "
            f"{float((share + gain)[better].min()):.0%} {how}, as given by "
            f"{float(share[better].min()):.0%}; check which way up they are",
            stacklevel=3,
        )
        return
    shifts = [_shift(found[:, view], model[:, view]) for view in range(found.shape[1])]
    beside = [
        f"{view} (by {x:+d}, {y:+d} pixels, {now:.0%} as given and {best:.0%} without)"
        for view, (x, y, now, best) in enumerate(shifts)
        if math.hypot(x, y) > max(_BESIDE * height[view], _FEW) and best - now > _FITS_BESIDE
    ]
    if beside:
        warnings.warn(
            "masks lie beside the captured person, to the right and down, and overlap better "
            f"without that, of views {', '.join(beside)}; check that cameras are in pixels of the "
            "masks: were these cropped or padded, or are they of other frames?",
            stacklevel=3,
        )
        return
    area, own = (each.sum((0, 2, 3)).clamp(min=1) for each in (found, model))
    sizes = torch.where(there, area / own, 1.0)
    other = ((sizes > _LARGER) | (sizes < 1 / _LARGER)).nonzero().flatten().tolist()
    if other:
        worst = max(sizes[other].tolist(), key=lambda size: abs(math.log(size)))
        warnings.warn(
            f"masks of views {other} have {worst:.1f} times the area of the captured person, who "
            "is moved nearer or farther to fill them; check that they end where the person does, "
            "and that the actor has the person's clothes",
            stacklevel=3,
        )


def warn_of_trust_within(masks: Tensor, trust: Tensor) -> None:
    """Warn where pixels count within the masks alone, so that nothing holds the person back.

    Args:
        masks: (F, C, H, W), bool or from 0 to 1.
        trust: how much each pixel counts, of a shape that broadcasts to the masks.
    """
    held = held_within(masks, trust)
    if held is not None:
        warnings.warn(
            f"trust counts pixels outside of the masks for {held:.0%} of what it "
            "counts those within for: the person may grow beyond the masks at no cost; expected "
            "how sure a pixel is, whichever it shows, not how likely it shows the person",
            stacklevel=3,
        )


def _other_way_up(found: Tensor, model: Tensor, known: Tensor, share: Tensor) -> tuple[str, Tensor]:
    """How masks (F, C, H, W) must be turned to fit best, and what each view gains, (C,)."""
    turned = {how: turn(found) for how, turn in _WAYS.items()}
    gains = {
        how: _overlap(masks & known, model)[0] - share
        for how, masks in turned.items()
        if masks.shape == model.shape
    }
    how = max(gains, key=lambda way: float(gains[way].max()))
    return how, gains[how]


def _known(model: Tensor, trust: Tensor | None) -> Tensor:
    """Which pixels count where a person is drawn, (F, C, H, W); trust is of this shape, or None."""
    if trust is None:
        return torch.ones_like(model)
    known = trust.detach() > 0
    least = _SHOWN * model.sum((-2, -1), keepdim=True)
    # a strip of the person at the edge of what is hidden may lie anywhere
    return known & ((model & known).sum((-2, -1), keepdim=True) >= least)


def _overlap(found: Tensor, model: Tensor) -> tuple[Tensor, Tensor]:
    """Intersection over union (C,) of masks (F, C, H, W), and whether there is anything."""
    both, either = ((each.sum((0, 2, 3))) for each in (found & model, found | model))
    return both / either.clamp(min=1), either > 0


def _shift(found: Tensor, model: Tensor) -> tuple[int, int, float, float]:
    """How far right and down masks (F, H, W) lie of others, pixels, and overlap as is and without.

    The shift is common to all frames, that of the largest overlap.
    """
    height, width = found.shape[-2:]
    size = 2 * height, 2 * width  # no part comes in on the other side
    one, other = (torch.fft.rfft2(each.float(), s=size) for each in (found, model))
    both = torch.fft.irfft2(one * other.conj(), s=size).sum(0)
    down, right = divmod(int(both.argmax()), size[1])
    total = found.sum() + model.sum()
    now, best = (float(each / (total - each).clamp(min=1)) for each in (both[0, 0], both.amax()))
    back = (
        right - size[1] if right >= width else right,
        down - size[0] if down >= height else down,
    )
    return *back, now, best


# --- How well a surface overlaps the masks of a clip ----------------------------------------------

BLOCK = 8  # frames drawn at once


def blocks(start: int, stop: int) -> list[range]:
    """Frames from ``start`` to ``stop``, as many at a time as are drawn at once."""
    return [range(first, min(first + BLOCK, stop)) for first in range(start, stop, BLOCK)]


def frame_overlaps(
    drawn: Iterable[Sequence[Outline]], evidence: Evidence, frames: range
) -> NDArray[np.float64]:
    """Intersection over union of surfaces ``[f][C]`` with masks, the mean over views, (f,).

    A view in which there is neither counts as 1. What somebody else hides counts for nothing.
    """
    pairs = zip(drawn, frames, strict=True)
    return np.array([frame_overlap(views, evidence, f) for views, f in pairs])


def frame_overlap(drawn: Sequence[Outline], evidence: Evidence, frame: int) -> float:
    """The same of one frame, in C views."""
    return float(np.mean(list(_overlaps(drawn, evidence, frame))))


def _overlaps(drawn: Sequence[Outline], evidence: Evidence, frame: int) -> Iterator[float]:
    unknown = evidence.unknown(frame)
    for number, (outline, mask) in enumerate(zip(drawn, evidence.masks(frame), strict=True)):
        seen, part = outline.seen, outline.part
        if unknown is not None:
            seen = seen & ~unknown[number][part]
        both = np.count_nonzero(seen & mask[part])
        either = np.count_nonzero(seen) + np.count_nonzero(mask) - both
        yield both / either if either else 1.0


def clip_overlaps(
    surface: SurfaceFrames,
    sight: Sight,
    evidence: Evidence,
    workers: int | None = None,
    kept: Kept = NOTHING,
) -> NDArray[np.float64]:
    """The same of every frame of a clip, (F,)."""
    return clip_measures(surface, sight, evidence, frame_overlap, workers, kept)


def clip_measures(
    surface: SurfaceFrames,
    sight: Sight,
    evidence: Evidence,
    measure: Callable[[Sequence[Outline], Evidence, int], float | tuple[float, ...]],
    workers: int | None = None,
    kept: Kept = NOTHING,
) -> NDArray[np.float64]:
    """What a measure of outlines ``[C]`` and masks says of every frame, (F,) or (F, ...)."""

    def measured(frames: range) -> NDArray[np.float64]:
        span = slice(frames.start, frames.stop)
        pairs = zip(sight.outlines(surface[span], span), frames, strict=True)
        return np.array([measure(views, evidence, frame) for views, frame in pairs])

    parts = kept.each(ARRAY, measured, blocks(0, surface.frames), workers)
    return np.array(list(chain.from_iterable(parts)))


# --- A refinement never leaves a frame worse than it found it: measured, and taken back -----------

Refined = TypeVar("Refined")

_FADE = 2  # frames over which a rejected frame's neighbours return to their refinement
_WORSE = 1e-3  # of overlap; rasterisation alone moves it by less


def keep_better(
    refined: Callable[[Tensor], Refined],
    overlaps: Callable[[Refined], NDArray[np.float64]],
    before: NDArray[np.float64],
) -> tuple[Refined, NDArray[np.float64], NDArray[np.bool_]]:
    """The refinement where it overlaps the masks at least as well as what was before.

    Frames in which it does not are given back, and their neighbours fade towards them. Fading can
    make a neighbour worse, which is then given back too: frames are only ever taken away, and what
    was before is left in the end.

    Args:
        refined: what comes of a share (F,) of the refinement in every frame, 0 to 1.
        overlaps: with the masks, (F,).
        before: overlap without the refinement, (F,).

    Returns:
        What is left of the refinement, its overlap (F,), and the frames that kept theirs, (F,).
    """
    kept = np.ones(len(before), np.bool_)
    while True:
        result = refined(_shares(kept))
        after = overlaps(result)
        worse = kept & (after < before - _WORSE)
        if not worse.any():
            return result, after, kept
        kept &= ~worse


def _shares(kept: NDArray[np.bool_]) -> Tensor:
    """0 in frames that are not kept, and ramps to 1 beside them, (F,) float64."""
    if kept.all():
        return torch.ones(len(kept), dtype=torch.float64)
    distance = ndimage.distance_transform_cdt(kept, "chessboard") if kept.any() else kept * 0
    return torch.from_numpy(np.minimum(distance / (_FADE + 1), 1.0))
