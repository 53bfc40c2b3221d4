"""What speaks against a fitted body: sizes of no person, views and masks that contradict it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements
from perfcap.actor.motion import Motion
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.actor.template import Template
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.evidence import beside
from perfcap.io.doctor.finding import ranges
from perfcap.io.doctor.legs import leg_ratio
from perfcap.io.doctor.mask_joints import LEAST_INSIDE, joints_inside
from perfcap.rigging.drawn_bodies import drawn_over
from perfcap.rigging.person_masks import PersonMasks

if TYPE_CHECKING:
    from perfcap.rigging.fit_body import BodyFit


@dataclass(frozen=True)
class FittedTo:
    """What a body was fitted to.

    Attributes:
        cameras: C views, (C,) or (F, C).
        detections: (F, C).
        height: as it was given, metres; None if it was not.
        masked: detections in pixels of the masks, and these; None without masks.
        names: of the views, for messages.
        numbers: of the frames, for messages.
    """

    cameras: Camera
    detections: Detections
    height: float | None
    masked: tuple[Detections, PersonMasks] | None
    names: Sequence[str]
    numbers: Sequence[int]


def fit_doubts(
    model: BodyModel, fit: BodyFit, given: FittedTo, *, option: str = ""
) -> Iterator[str]:
    """Sentences about a body that its size, the views, edges or masks speak against.

    Args:
        model: of the body.
        fit: the body, and its motion.
        given: what it was fitted to.
        option: what stands before names of arguments where they are given.
    """
    seen = given.cameras, given.detections
    yield from size_doubts(fit.measurements)
    yield from pose_doubts(model, fit.motion, *seen, given.numbers)
    if given.height is not None:
        body, asked = (fit.measurements, fit.template), f"{option}height"
        yield from height_doubts(*body, *seen, given.height, asked)
    yield from support_doubts(fit.support, f"give {option}masks")
    if given.masked is not None:
        found = overlap_of(model, fit.motion, *given.masked)
        yield from mask_doubts(found, given.names, given.numbers)


# --- What views do not tell -----------------------------------------------------------------------

_DOUBTFUL = 0.03  # metres of deviation of the height above which it is told
_FACING = -0.94  # cosine between two cameras' lines of sight from which they see the same


def depth_doubts(fit: BodyFit, given: FittedTo, *, option: str | None = "") -> Iterator[str]:
    """Sentences about sizes and depths that the views hardly tell.

    Args:
        fit: the body, and its motion.
        given: what it was fitted to.
        option: what stands before names of arguments; None where a height cannot be given.
    """
    views = given.cameras.views
    if views == 1 and given.height is None:
        yield (
            "one camera does not tell a person's size from the distance; the height is mostly a "
            f"guess, give {option or ''}height"
        )
    elif fit.deviations.height > _DOUBTFUL:
        known = f"the height is known to {100 * fit.deviations.height:.0f} cm only"
        yield known if option is None else f"{known}; give {option}height"
    if views == 2 and _opposite(given.cameras, fit.motion.translation.detach()):
        yield (
            "the two cameras look at each other and see the same outline; depths are told by sizes "
            "alone, a view from the side would help most"
        )


def _opposite(cameras: Camera, places: Tensor) -> bool:
    """Whether two cameras see the person from opposite sides, in the median of the frames."""
    sight = places[:, None] - cameras.centre.expand(len(places), 2, 3)
    sight = sight / sight.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    return float((sight[:, 0] * sight[:, 1]).sum(-1).median()) < _FACING


# --- Sizes ----------------------------------------------------------------------------------------

_TALL = (1.3, 2.15)  # m; of a body that is a grown person's
_MISSED = 0.06  # m, by which a body misses the height it was given
_OTHER_LEGS = 0.07  # share, of a body's legs to those of the views; sound ones have up to 0.03
# m, from the given height to that of a body with the legs of the views. A wrong height is met
# halfway, so that neither body nor legs are far off: right ones of nine recordings were up to 0.03
# off, from joints alone up to 0.07, those 18 cm too large or small 0.13 and more
_OTHER_HEIGHT = 0.1
# Of the person's size, median of a frame: of ten people in one to four views right fits have 0.03
# at most, and 0.043 in one of 256 frames
_BESIDE = 0.06
_SUPPORT = 0.15  # of the outline on edges, of which plain images and noise have less


def size_doubts(measurements: Measurements) -> Iterator[str]:
    """A sentence about a body that is as tall as hardly any person."""
    if not _TALL[0] < measurements.height < _TALL[1]:
        yield (
            f"the body is {measurements.height:.2f} m tall, as hardly anybody is; check masks, "
            "cameras and their units"
        )


def height_doubts(
    measurements: Measurements,
    template: Template,
    cameras: Camera,
    detections: Detections,
    height: float,
    asked: str = "height",
) -> Iterator[str]:
    """A sentence about a body that is not as tall as was given, or whose legs views contradict.

    Args:
        measurements: of the body.
        template: the body.
        cameras: C views, (C,) or (F, C).
        detections: (F, C), that it was fitted to.
        height: as it was given, metres.
        asked: what the height is called there.
    """
    tall = measurements.height
    if abs(tall - height) > _MISSED:
        yield (
            f"the views show somebody {tall:.2f} m tall, {asked} says {height:.2f}; check the "
            "height, and the scale of the cameras"
        )
        return
    ratio = leg_ratio(Actor(template), cameras, detections)
    shown = height if ratio is None else tall / ratio
    if ratio is not None and (abs(ratio - 1) > _OTHER_LEGS or abs(shown - height) > _OTHER_HEIGHT):
        yield (
            f"with {asked} {height:.2f} the body's legs are {ratio:.2f} times as long as those "
            f"that the views show, of somebody about {shown:.2f} m tall; check the height, and "
            "the scale of the cameras"
        )


def pose_doubts(
    model: BodyModel,
    motion: Motion,
    cameras: Camera,
    detections: Detections,
    numbers: Sequence[int],
) -> Iterator[str]:
    """A sentence about frames in which the body is not where its joints are seen.

    Args:
        model: of the body.
        motion: (F,), with the shape.
        cameras: C views, (C,) or (F, C).
        detections: (F, C), that it was fitted to.
        numbers: of the frames, for messages.
    """
    marks = ShapedPoints.of_landmarks(model, model.actor(torch.zeros(0)).to(motion.angles))
    off = beside(cameras, detections, marks(motion)[:, : len(LANDMARKS)])
    frames = off.flatten(1).nanmedian(-1).values
    lost = (frames > _BESIDE).nonzero().flatten().tolist()
    if lost:
        yield (
            f"the body lies up to {float(frames[lost].max()):.0%} of the person's size from the "
            f"joints in frames {ranges([numbers[place] for place in lost])} (counted from 0), and "
            "its shape follows; look whether joints there are of this person, and poses to start "
            "from of these frames, in metres and radians"
        )


def support_doubts(support: float | None, remedy: str = "give masks") -> Iterator[str]:
    """A sentence about contours (-1 to 1, see ``BodyFit``) that lie on edges hardly anywhere."""
    if support is not None and support < _SUPPORT:
        yield (
            f"edges of the images explain {100 * max(support, 0):.0f} % of the body's outline; "
            f"girths are known about as well as from joints alone, {remedy}"
        )


# --- Silhouettes: of the fitted body, or empty, of others, of clothes -----------------------------

_LOOSE, _BARE = 0.25, 0.2  # of the body's area: mask beyond the body, and body beyond the mask
_UNLIKE = 0.2  # of it, more than in most frames: poses are off by less
_SHOWN, _HALF = 0.1, 0.5  # of the body: known parts that say something, and that are compared


@dataclass(frozen=True)
class Overlap:
    """Of a body with masks.

    Attributes:
        joints: share of each view's that lie in the mask, (C,).
        beyond: of the mask, beyond the body, (F, C), shares of the body's area at known pixels, at
            least of half the body; NaN where hardly anything of it is known.
        missing: of the body, beyond the mask, likewise.
        empty: whether a mask is, (F, C), bool.
    """

    joints: Tensor
    beyond: Tensor
    missing: Tensor
    empty: Tensor


def overlap_of(
    model: BodyModel, motion: Motion, detections: Detections, masks: PersonMasks
) -> Overlap:
    """Compare a posed body with masks at pixels that are known, in pictures of moderate size.

    Args:
        model: of the body.
        motion: (F,), with the shape.
        detections: (F, C), in pixels of the masks.
        masks: of the same frames.
    """
    drawn = drawn_over(model, motion, masks)
    rows = [_compared(one.body, one.mask > 0.5, one.known) for one in drawn]
    shape = (*masks.inside.shape[:2], 3)
    table = torch.tensor(rows, dtype=torch.float64).reshape(shape)
    inside = joints_inside(detections, masks.inside, masks.known)
    return Overlap(inside, table[..., 0], table[..., 1], table[..., 2] > 0.5)


def _compared(drawn: Tensor, mask: Tensor, known: Tensor | None) -> tuple[float, float, bool]:
    """What a mask (H, W) has beyond a body, what it misses of it, and whether it is empty."""
    body = float(drawn.sum())
    if known is not None:
        drawn, mask = drawn & known, mask & known
    own = float(drawn.sum())
    area = max(own, _HALF * body, 1.0)
    beyond, missing = (float(part.sum()) / area for part in (mask & ~drawn, drawn & ~mask))
    if own < _SHOWN * body:
        said = beyond > _LOOSE  # a strip of the body says nothing, somebody elsewhere does
        return (beyond, missing, False) if said else (torch.nan, torch.nan, False)
    return beyond, missing, float(mask.sum()) < 0.02 * max(own, 1.0)


def mask_doubts(found: Overlap, names: Sequence[str], numbers: Sequence[int]) -> Iterator[str]:
    """Sentences about masks that are empty, of somebody else, or far larger than a body.

    Args:
        found: of C views and F frames.
        names: of the views.
        numbers: of the frames, for messages.
    """
    for view, name in enumerate(names):
        if float(found.empty[:, view].double().mean()) > 0.5:
            yield f"masks of {name}: are empty in most frames; the body follows the other views"
        elif float(found.joints[view]) < LEAST_INSIDE:
            yield (
                f"masks of {name}: hold {100 * float(found.joints[view]):.0f} % of the detected "
                "joints; expected those of the person that the joints belong to"
            )
        else:
            yield from _unlike_others(name, view, found, numbers)
    sound = (found.empty.double().mean(0) <= 0.5) & (found.joints >= LEAST_INSIDE)
    if not bool(sound.any()):
        return
    beyond, missing = (
        float(part.nanmedian(0).values[sound].nanmedian()) for part in (found.beyond, found.missing)
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


def _unlike_others(name: str, view: int, found: Overlap, numbers: Sequence[int]) -> Iterator[str]:
    """Frames of a view whose masks miss the body by far more than its other masks do."""
    off = (found.beyond + found.missing)[:, view]
    usual = float(off.nanmedian())
    odd = (off > usual + _UNLIKE).nonzero().flatten().tolist()
    if odd:
        frames = ", ".join(str(numbers[place]) for place in odd)
        yield (
            f"masks of {name}: miss the body by {100 * float(off[odd].max()):.0f} % of its area in "
            f"frames {frames} (counted from 0), by {100 * usual:.0f} % in most; are they of this "
            "person, and true there? Leave them out"
        )
