"""Bodies drawn over masks, and masks that are larger or fainter than a body of joints alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import Motion
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging.person_masks import PersonMasks

_HEIGHT = 300.0  # px, rows of the pictures that are compared


@dataclass(frozen=True)
class Drawn:
    """A body and a mask in a view of a frame.

    Attributes:
        frame: its number.
        view: likewise.
        body: where it is, (H, W), bool.
        mask: (H, W), 0 to 1.
        known: which pixels of the mask say anything, (H, W), bool; all if None.
    """

    frame: int
    view: int
    body: Tensor
    mask: Tensor
    known: Tensor | None


def drawn_over(model: BodyModel, motion: Motion, masks: PersonMasks) -> Iterator[Drawn]:
    """A posed body in every view of every frame, in pictures of moderate size.

    Args:
        model: of the body.
        motion: (F,), with the shape.
        masks: of the same frames.
    """
    factor = max(1, int(masks.inside.shape[-2] / _HEIGHT))
    shape, known = masks.inside.shape, masks.known
    told = None if known is None else (known > 0).expand(shape)
    small = replace(masks, known=told).shrunk(factor)
    surface = ShapedPoints.of_surface(model, model.actor(torch.zeros(0)).to(motion.angles))
    faces = torch.from_numpy(model.rig.faces)
    for frame, vertices in enumerate(surface(motion)):
        cameras = small.cameras.frames(slice(frame, frame + 1)).every_frame(1)
        local = cameras.map(lambda each: each[0])
        for view in range(small.cameras.views):
            body = ProjectedMesh.seen_by(local.select([view]), vertices, faces).rasterize().mask
            # averages of pixels some of which are unknown are none of the mask
            whole = None if small.known is None else small.known[frame, view] > 1 - 1e-6
            yield Drawn(frame, view, body, small.inside[frame, view], whole)


# --- Masks that are larger or fainter than the person ---------------------------------------------

# Times the area of a body that is fitted to joints alone: right masks of skirts and coats have less
# than the first. Right ones of somebody whom others hide may have no more than the second, but are
# surely inside where they are
_LARGER, _SMALLER = 1.3, 0.85
_SHOWN = 0.3  # of the body: known parts that say how large it is
_EMPTY = 0.02  # of the body's area, which a mask may be missing with
_SURE, _FEW = 0.9, 0.2  # values that are surely inside, and share of a mask that has them at least


@dataclass(frozen=True)
class Areas:
    """Of masks of C views.

    Attributes:
        ratio: to the area of a body, median of the frames, (C,); NaN where unknown.
        sure: share of it where pixels are surely inside, likewise.
    """

    ratio: Tensor
    sure: Tensor


def areas_of(model: BodyModel, of_joints: Motion, masks: PersonMasks) -> Areas:
    """Compare areas of masks with those of a body; soft masks count by their values.

    Args:
        model: of the body.
        of_joints: (F,), with the shape, fitted to joints alone.
        masks: of the same frames.
    """
    found = torch.full((*masks.inside.shape[:2], 2), torch.nan, dtype=torch.float64)
    for one in drawn_over(model, of_joints, masks):
        known = torch.ones_like(one.body) if one.known is None else one.known
        own, mask = float((one.body & known).sum()), one.mask * known
        area = float(mask.sum())
        if own > max(_SHOWN * float(one.body.sum()), 1.0) and area > _EMPTY * own:
            sure = float(mask[mask >= _SURE].sum()) / area
            found[one.frame, one.view] = found.new_tensor([area / own, sure])
    return Areas(*found.nanmedian(0).values.mT)


_AREA = "have {:.2f} times the area of a body that is fitted to joints alone"


def wide_doubts(areas: Areas, names: Sequence[str]) -> Iterator[str]:
    """Sentences about views whose masks are larger than the person.

    Args:
        areas: of C views.
        names: of the views.
    """
    for name, ratio in zip(names, areas.ratio.tolist(), strict=True):
        if ratio > _LARGER:
            yield (
                f"masks of {name}: {_AREA.format(ratio)}, and girths follow them; expected masks "
                "that end where the person does: are they wide, or the clothes loose? Fit joints "
                "alone then; of somebody stout they may be right"
            )


def faint_doubts(areas: Areas, names: Sequence[str]) -> Iterator[str]:
    """Likewise about soft masks that are 1 hardly anywhere."""
    for name, ratio, sure in zip(names, areas.ratio.tolist(), areas.sure.tolist(), strict=True):
        if ratio < _SMALLER and sure < _FEW:
            yield (
                f"masks of {name}: {_AREA.format(ratio)}, {sure:.0%} of it at pixels of {_SURE} "
                "or more, and girths follow them; expected 1 where the person surely is: divide "
                "them by what they reach there"
            )
