"""Whether masks are of the person whose joints are detected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS

LEAST_INSIDE = 0.5
"""Share of the sure joints that lie in one's own silhouette."""

_SURE = 0.3  # confidence from which a joint counts
_FEWEST, _HARDLY = 4, 0.1  # frames, and share of them, in which a joint is held
_LIMBS = [k for k, name in enumerate(LANDMARKS) if name[2:] in ("elbow", "knee", "ankle")]
_ANKLES, _TOES = ([LANDMARKS.index(f"{s}_{n}") for s in "lr"] for n in ("ankle", "toe"))
_ON_SHOES = 0.6  # of the way from ankles to toes, whose tips lie at the edge of right masks
_CROWN, _NECK = LANDMARKS.index("head_top"), LANDMARKS.index("neck")
_OTHERS = [k for k in range(len(LANDMARKS)) if k not in (_CROWN, _NECK)]
# How far masks of whole heads reach of the way from the neck to the crown: in the median of frames,
# and in a quarter of them, since crowns may be detected too high in many. Right masks of rendered
# and recorded people reach farther with true, simulated and detected joints, also from above and
# where heads are out of the image
_USUAL, _AT_TIMES = 0.75, 0.85
_FRAMES = _FEWEST, 8  # that say so
_HEADLESS = 0.6  # of that way: what ends before is no more than a chin
_FARTHEST, _STEPS = 1.5, 61  # of that way: crowns that are made of ears may lie low


def joints_inside(detections: Detections, inside: Tensor, known: Tensor | None = None) -> Tensor:
    """Share of the sure joints of each view that lie in the mask, (C,); 1 without joints.

    Args:
        detections: (F, C), in pixels of the masks.
        inside: where masks of the same frames are, (F, C, H, W), bool or 0 to 1.
        known: which pixels say anything, of a shape that broadcasts to ``inside``; joints at
            others do not count. All if None.
    """
    held, counted = _held(detections, inside, known)
    share = held.sum((0, 2)) / counted.sum((0, 2)).clamp(min=1)
    return torch.where(counted.any(-1).any(0), share.double(), 1.0)


def others_doubts(
    names: Sequence[str],
    detections: Detections,
    inside: Tensor,
    known: Tensor | None = None,
    *,
    numbered: bool = False,
) -> Iterator[str]:
    """Sentences about views whose masks are of somebody or something else.

    Args:
        names: of the views.
        detections: (F, C), in pixels of the masks.
        inside: where masks of the same frames are, (F, C, H, W), bool or 0 to 1.
        known: which pixels say anything, of a shape that broadcasts to ``inside``; joints at
            others do not count. All if None.
        numbered: whether they belong to frames by their numbers, which may be wrong.
    """
    whose = "numbered as the frames of the video" if numbered else "whose the joints are"
    shares = joints_inside(detections, inside, known).tolist()
    for name, share in zip(names, shares, strict=True):
        if share < LEAST_INSIDE:
            yield (
                f"masks of {name}: hold {100 * share:.0f} % of the detected joints; expected those "
                f"of the person, {whose}"
            )


def limb_doubts(
    names: Sequence[str], detections: Detections, inside: Tensor, known: Tensor | None = None
) -> Iterator[str]:
    """Sentences about views whose masks end before limbs, or a head, that are seen there.

    Args:
        names: of the views.
        detections: (F, C), in pixels of the masks.
        inside: where masks of the same frames are, (F, C, H, W), bool or 0 to 1.
        known: which pixels say anything, of a shape that broadcasts to ``inside``; joints at
            others do not count. All if None.
    """
    given = detections, inside, known
    shares = joints_inside(*given).tolist()
    limbs, reaches = _left_out(*given), _head_reach(*given).tolist()
    for name, share, parts, reach in zip(names, shares, limbs, reaches, strict=True):
        missing = [*_of_head(*reach), *parts]
        if share >= LEAST_INSIDE and missing:
            yield (
                f"masks of {name}: leave out {', '.join(missing)}; expected all of the person: is "
                "a part cut off, or hidden by something?"
            )


def _of_head(usual: float, at_times: float) -> list[str]:
    """What masks that reach so far leave out of a head; NaN where that is not known."""
    if not (usual < _USUAL or at_times < _AT_TIMES):
        return []
    return ["the head" if usual < _HEADLESS else "the top of the head"]


def _left_out(detections: Detections, inside: Tensor, known: Tensor | None) -> list[list[str]]:
    """Elbows, knees, ankles and shoes of each view that the masks of hardly any frame hold."""
    kept, within = _held(detections, inside, known)
    held, counted = kept.sum(0), within.sum(0)  # C 16
    never = (counted >= _FEWEST) & (held < _HARDLY * counted)
    joints = detections.joints2d
    places = torch.lerp(joints[..., _ANKLES, :], joints[..., _TOES, :], _ON_SHOES)
    seen = within[..., _TOES] & kept[..., _ANKLES]  # F C 2
    shoes, seen = _in_masks(torch.where(seen[..., None], places, -1.0), inside, known)
    shod = shoes.sum((0, 2))
    bare = (seen.sum((0, 2)) >= 2 * _FEWEST) & (shod < _HARDLY * seen.sum((0, 2)))
    limbs = [[LANDMARKS[k] for k in _LIMBS if row[k]] for row in never.tolist()]
    return [
        [*found, *["the shoes"] * none] for found, none in zip(limbs, bare.tolist(), strict=True)
    ]


def _head_reach(detections: Detections, inside: Tensor, known: Tensor | None) -> Tensor:
    """How far masks reach from the neck (0) to the crown (1) and on, (C, 2); NaN where unknown.

    The median and the upper quartile of the frames in which both are seen and the mask holds most
    other joints: else it, or what was detected, is of another person, or of one who is hidden.
    """
    held, counted = _held(detections, inside, known)
    others = counted[..., _OTHERS].sum(-1)
    own = (others > 0) & (2 * held[..., _OTHERS].sum(-1) >= others)
    seen = own & counted[..., _CROWN] & counted[..., _NECK]  # F C
    neck, crown = (detections.joints2d[..., None, joint, :] for joint in (_NECK, _CROWN))
    steps = torch.linspace(0, _FARTHEST, _STEPS).to(neck)
    line = torch.where(seen[..., None, None], torch.lerp(neck, crown, steps[:, None]), -1.0)
    # the farthest place counts: whatever lies between, as an arm in front, hides no head
    there, told = _in_masks(line, inside, known)
    if known is not None:  # what hides a part of the head may hide where the mask ends
        there = there | (~told & (steps <= 1))
    reach = torch.where(seen, (there * steps).amax(-1), torch.nan)
    shares = reach.nanquantile(reach.new_tensor([0.5, 0.75]), 0).mT  # C 2
    count = seen.sum(0)[:, None]
    return torch.where(count >= count.new_tensor(_FRAMES), shares, torch.nan)


def _held(detections: Detections, inside: Tensor, known: Tensor | None) -> tuple[Tensor, Tensor]:
    """Sure joints that lie in the mask, and those at pixels that are known, (F, C, 16)."""
    found = detections.joints2d.isfinite().all(-1)
    joints = torch.where(found[..., None], detections.joints2d, -1.0)
    held, within = _in_masks(joints, inside, known)
    counted = (detections.confidence2d > _SURE) & found & within
    return held & counted, counted


def _in_masks(points: Tensor, inside: Tensor, known: Tensor | None) -> tuple[Tensor, Tensor]:
    """Which points (F, C, N, 2) lie in the mask, and which at known pixels, (F, C, N)."""
    pixels = points.round().long()
    height, width = inside.shape[-2:]
    within = (pixels >= 0).all(-1) & (pixels[..., 0] < width) & (pixels[..., 1] < height)
    index = pixels[..., 1].clamp(0, height - 1) * width + pixels[..., 0].clamp(0, width - 1)
    held = inside.flatten(-2).gather(-1, index) > 0
    if known is not None:
        within &= (known > 0).expand(inside.shape).flatten(-2).gather(-1, index)
    return held & within, within
