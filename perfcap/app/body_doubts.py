"""Whether silhouettes are those of the fitted body (nobody, others, clothes), and end at edges."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.app.fit_views import ChosenFrames
from perfcap.errors import InputError
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging import BodyFit, PersonMasks
from perfcap.rigging.fit_body import extents
from perfcap.rigging.mask_checks import LEAST_INSIDE, joints_inside

_LOOSE, _BARE = 0.25, 0.2  # of the body's area: mask beyond the body, and body beyond the mask
_UNLIKE = 0.2  # of it, more than in most frames: poses are off by less
_HEIGHT = 300.0  # px, rows of the pictures that are compared


@dataclass(frozen=True)
class _Overlap:
    """Shares: joints of each view in the mask (C,), and of the body's area, in each frame (F, C),
    mask beyond the body and body beyond the mask; and whether a mask is empty.
    """

    joints: Tensor
    beyond: Tensor
    missing: Tensor
    empty: Tensor


def mask_doubts(
    model: BodyModel, fit: BodyFit, chosen: ChosenFrames, masks: PersonMasks
) -> Iterator[str]:
    """Sentences about masks that are empty, of somebody else, or far larger than a body."""
    found = _overlap(model, fit, chosen, masks)
    for view, name in enumerate(chosen.clip.names):
        if float(found.empty[:, view].double().mean()) > 0.5:
            yield f"masks of {name}: are empty in most frames; the body follows the other views"
        elif float(found.joints[view]) < LEAST_INSIDE:
            yield (
                f"masks of {name}: hold {100 * float(found.joints[view]):.0f} % of the detected "
                "joints; expected those of the person that the joints belong to"
            )
        else:
            yield from _unlike_others(name, view, found, chosen)
    sound = (found.empty.double().mean(0) <= 0.5) & (found.joints >= LEAST_INSIDE)
    if not bool(sound.any()):
        return
    beyond, missing = (
        float(part.median(0).values[sound].median()) for part in (found.beyond, found.missing)
    )
    if beyond > _LOOSE:
        yield (
            f"silhouettes exceed the body by {100 * beyond:.0f} % of its area: a coat, a skirt or "
            "a bag; girths are too large, fit joints alone or give the actor in these clothes"
        )
    elif missing > _BARE:
        yield (
            f"silhouettes leave out {100 * missing:.0f} % of the body: cut-off limbs, or masks of "
            "somebody smaller; look at the picture of the body"
        )


def _unlike_others(name: str, view: int, found: _Overlap, chosen: ChosenFrames) -> Iterator[str]:
    """Frames of a view whose masks miss the body by far more than its other masks do."""
    off = (found.beyond + found.missing)[:, view]
    usual = float(off.median())
    odd = (off > usual + _UNLIKE).nonzero().flatten().tolist()
    if odd:
        frames = ", ".join(str(chosen.clip.start + chosen.frames[place]) for place in odd)
        yield (
            f"masks of {name}: miss the body by {100 * float(off.max()):.0f} % of its area in "
            f"frames {frames} (counted from 0), by {100 * usual:.0f} % in most; are they of this "
            "person, and true there? Leave them out"
        )


def require_person(chosen: ChosenFrames, masks: PersonMasks) -> None:
    """Refuse masks that show the person whose joints are detected in no view.

    Raises:
        InputError: they are empty, inverted, or of somebody else.
    """
    shares = joints_inside(chosen.detections, masks)
    if not bool((shares >= LEAST_INSIDE).any()):
        told = ", ".join(f"{100 * share:.0f}" for share in shares.tolist())
        raise InputError(
            f"--masks: hold {told} % of the detected joints of the views; expected images that are "
            "white where the person is, numbered as the frames of the video"
        )


def _overlap(model: BodyModel, fit: BodyFit, chosen: ChosenFrames, masks: PersonMasks) -> _Overlap:
    """Compared in pictures of moderate size."""
    factor = max(1, int(masks.inside.shape[-2] / _HEIGHT))
    small = masks.shrunk(factor)
    surface = ShapedPoints.of_surface(model, model.actor(torch.zeros(0)).to(fit.shape))
    faces, bodies = torch.from_numpy(model.rig.faces), surface(fit.motion)
    views, rows = range(small.cameras.views), []
    for frame, vertices in enumerate(bodies):
        cameras = small.cameras.frames(slice(frame, frame + 1)).every_frame(1)
        local = cameras.map(lambda each: each[0])
        for view in views:
            drawn = ProjectedMesh.seen_by(local.select([view]), vertices, faces).rasterize().mask
            mask = small.inside[frame, view] > 0.5
            area = float(drawn.sum().clamp(min=1))
            beyond = float((mask & ~drawn).sum()) / area
            missing = float((drawn & ~mask).sum()) / area
            rows.append((beyond, missing, float(mask.sum()) < 0.02 * area))
    table = torch.tensor(rows, dtype=torch.float64).reshape(len(bodies), len(views), 3)
    inside = joints_inside(chosen.detections, masks)
    return _Overlap(inside, table[..., 0], table[..., 1], table[..., 2] > 0.5)


# --------------------------------------------------------------------------------------------------
# Whether masks end where the images have edges: too large, too small, boxes, of another video.

Floats = NDArray[np.float64]

_REACH = 0.06  # of the person's height: how far from the outline edges are looked for
_OFF = 0.008  # of it: how far they may lie from the outline, 1.5 cm
_LEAST = 1.5  # px, likewise
_CLEAR = 1.5  # times the usual gradient; sound masks have 2.2 to 5.4
_BLUR = 1.0  # px


@dataclass(frozen=True)
class OutlineEdges:
    """Image gradients along the outlines of a view's masks, over all frames.

    Attributes:
        offset: px inside the outline (negative: outside) where gradients are largest.
        clarity: gradient there over the median of those within reach; 1 where nothing is seen.
        size: of the person, px.
    """

    offset: float
    clarity: float
    size: float


def outline_doubts(
    chosen: ChosenFrames, masks: PersonMasks, *, girths: bool = True
) -> Iterator[str]:
    """Sentences about views whose masks do not end at edges of the images.

    Args:
        chosen: the frames.
        masks: theirs.
        girths: whether those of a body follow the masks; else it is a surface.
    """
    for view, found in enumerate(outline_edges(chosen, masks)):
        name, off = chosen.clip.names[view], abs(found.offset)
        if found.clarity < _CLEAR:
            follows = "Girths follow them" if girths else "The surface follows them"
            yield (
                f"masks of {name}: end at no edges of the images; are they boxes, rough, or of "
                f"another video? {follows}"
            )
        elif off > max(_LEAST, _OFF * found.size):
            far = f"{off:.0f} px ({100 * off / found.size:.1f} % of the person's height)"
            kind, what = ("larger", "outside") if found.offset > 0 else ("smaller", "inside")
            follows = "the surface follows them"
            if girths:
                follows = f"girths are {kind} by three to six times that"
            yield (
                f"masks of {name}: end about {far} {what} the edges of the images; {follows}, give "
                "masks that end where the person does"
            )


def outline_edges(chosen: ChosenFrames, masks: PersonMasks) -> list[OutlineEdges]:
    """For each view, where the images have their edges as seen from the outlines."""
    sizes = extents(chosen.detections).tolist()
    return [_of_view(chosen, masks, view, size) for view, size in enumerate(sizes)]


def _of_view(chosen: ChosenFrames, masks: PersonMasks, view: int, size: float) -> OutlineEdges:
    reach = max(4, round(_REACH * size))
    total, count = np.zeros(2 * reach), np.zeros(2 * reach)
    for frame in range(len(chosen)):
        image = chosen.read_view(view, frame, frame + 1)[0]
        height, width = image.shape[:2]
        mask = masks.inside[frame, view, :height, :width].numpy() > 0.5
        if mask.any() and not mask.all():
            # pixels of straight outlines lie at halves of a pixel: one row of them to a bin
            depth = np.floor(_depth(mask)).astype(np.int64)
            near = (depth >= -reach) & (depth < reach)
            place = depth[near] + reach
            total += np.bincount(place, _gradient(image)[near], len(total))
            count += np.bincount(place, minlength=len(count))
    if not (count > 0).all():
        return OutlineEdges(0.0, 1.0 if not count.any() else _CLEAR, size)
    profile = total / count
    usual = max(float(np.median(profile)), 1e-9)
    best = int(profile.argmax())
    return OutlineEdges(best - reach + 0.5, float(profile[best]) / usual, size)


def _depth(mask: NDArray[np.bool_]) -> Floats:
    """Distance of each pixel inside the outline, px; negative outside."""
    inside, outside = (
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for part in (mask, ~mask)
    )
    # the outline lies half a pixel from the last pixel of either side
    depth: Floats = np.where(mask, inside - 0.5, 0.5 - outside).astype(np.float64)
    return depth


def _gradient(image: NDArray[np.uint8]) -> Floats:
    """Largest length of the gradients of the channels, (H, W)."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR)
    across, down = cv2.Sobel(smooth, -1, 1, 0), cv2.Sobel(smooth, -1, 0, 1)
    length: Floats = np.hypot(across, down).max(-1).astype(np.float64)
    return length
