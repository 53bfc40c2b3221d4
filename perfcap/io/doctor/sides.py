"""Whether joints called left and right are: feet point ahead, knees bend one way, and hips lie
under the shoulders.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.body_size import body_size
from perfcap.io.doctor.finding import Finding, Severity, ranges

AHEAD = 0.2  # cosine between what sides and feet call ahead, below which a frame says nothing
_FEWEST = 5  # frames that say something
_MOST = 0.75  # share of them
_PLAIN = 0.4  # mean cosine of fewer frames that all say the opposite (``sides_of_clips.py``)
# The same of images in any order: of six recordings up to 0.11, of climbers 0.19
_SEVERAL, _SOME = 12, 0.3
_NEAR, _LONG = 3, 8  # frames on each side of an exchange, and as many in which it lasts
_CLEAR, _AT_ONCE = 0.6, 0.4  # how clearly they point the other way after it, of 1
# Of an image: lines of hips and of shoulders that are seen, shares of the person's size, and their
# cosine; frames that show both, and share of them in which they run opposite ways
_HIPS, _SHOULDERS, _CLEARLY = 0.05, 0.08, 0.5
_SHOW, _OPPOSITE = 8, 0.8
# Of two views: residuals of a joint that one of them has elsewhere, times the median and at least,
# on the plane; spread of the hips' width, logarithm, above which its direction is not known. Both
# chosen with renderings
_WILD, _TAME, _WOBBLY = 8.0, 0.005, 0.5
_BENT = 0.34  # sine of a knee that says how it bends
_PAIRS = ("hip", "shoulder", "elbow", "wrist", "knee", "ankle")
_KNEES = 8, 0.9  # frames, and share of them, by knees: of dancers some are turned far out
_NOWHERE = 1e-6  # of a place: rounding
_SHINS = [LANDMARKS.index(f"{side}_knee") for side in "lr"]
_ANKLES = [LANDMARKS.index(f"{side}_ankle") for side in "lr"]
_TOES = [LANDMARKS.index(f"{side}_toe") for side in "lr"]
_REMEDY = (
    "left and right are the person's own: exchange the names; a calibration whose world is a "
    "mirror image looks the same"
)


def examine_sides(subject: str, points: Tensor, *, successive: bool = True) -> list[Finding]:
    """Left and right of joints in space, exchanged in all views or in a 3D pose, leave no trace.

    But then toes point backwards, and knees bend the other way; and where arms or legs alone are
    exchanged, the hips' sides are opposite to the shoulders'. Of clips of less than five frames
    that is a warning, and must be plain.

    Args:
        subject: of the finding.
        points: landmarks (F, 16, 3) in right-handed axes, NaN where unknown.
        successive: whether frames follow one another; of images in any order, sides may be
            exchanged in some, as by an augmentation, and nothing turns over from one to the next.
    """
    ahead, level = bearings(points)
    if wrong := _against(level) or _plainly(level):
        legs = _against(ahead) or _plainly(ahead)
        what = f"left and right of the {'legs' if legs else 'arms'} look exchanged in every frame"
        return [Finding(wrong, subject, what, _REMEDY)]
    footless = bool(_feet(points).isnan().all())
    if wrong := _against(ahead, *_KNEES) if footless else _against(ahead) or _plainly(ahead):
        sign = "the knees bend backwards" if footless else "the feet point backwards"
        what = f"left and right look exchanged: {sign}"
        return [Finding(wrong, subject, what, _REMEDY)]
    if not successive and not footless and (share := _partly_against(ahead)):
        what = f"left and right look exchanged in {share} images: the feet point backwards there"
        return [Finding(Severity.WARNING, subject, what, _REMEDY)]
    return []


def examine_sides_of_two(
    subject: str, points: Tensor, residual: Tensor, successive: bool = True
) -> tuple[list[Finding], list[Finding]]:
    """The same of joints that two views place: what they hardly know is no error.

    A third view shows which of two has a joint elsewhere. Without it such joints are left out, and
    the hips' line counts only where it keeps its length: of two views from in front and from
    behind, or that take one hip for the other, it does not.

    Args:
        subject: of the finding.
        points: landmarks (F, 16, 3) in right-handed axes, NaN where unknown.
        residual: of these, (F, 16), on the plane one unit before the camera, NaN where unknown.
        successive: as of ``examine_sides``.

    Returns:
        What is so, and what is likely at most, as warnings; one of them is empty.
    """
    wild = residual > max(_WILD * float(residual.nanmedian()), _TAME)
    seen = torch.where(wild.unsqueeze(-1), torch.nan, points)
    found = examine_sides(subject, seen, successive=successive)
    if not found:
        seen = points
        found = examine_sides(subject, seen, successive=successive)
    elif _steady(seen):
        return found, []
    return [], [_likely(each, seen) if each.severity is Severity.ERROR else each for each in found]


def _steady(points: Tensor) -> bool:
    """Whether hips keep their width in the frames that say something."""
    clear = torch.stack(bearings(points)).abs().nan_to_num().amax(0) > AHEAD
    left, right = (points[clear, LANDMARKS.index(f"{side}_hip")] for side in "lr")
    width = (left - right).norm(dim=-1).log()
    width = width[width.isfinite()]
    return len(width) < 2 or float(width.std()) <= _WOBBLY


def _likely(found: Finding, points: Tensor) -> Finding:
    """What frames show, in numbers, where that is no proof."""
    cosine, level = bearings(points)
    sign = "knees bend" if bool(_feet(points).isnan().all()) else "feet point"
    sign = f"the {sign} backwards"
    if _against(level):
        cosine, sign = level, "hips and shoulders have left and right opposite ways"
    clear = cosine[cosine.abs() > AHEAD]
    what = (
        f"left and right may be exchanged: {sign} in {int((clear < 0).sum())} of {len(clear)} "
        f"frames that show it, of {len(points)}, but the two views do not place these joints surely"
    )
    remedy = "look at the joints in the images, or add a view; left and right are the person's own"
    return Finding(Severity.WARNING, found.subject, what, remedy)


def bearings(points: Tensor) -> tuple[Tensor, Tensor]:
    """Cosines between where hips and toes point, and between the lines of hips and shoulders.

    Ahead is across the hips and the shanks: who bends down has the chest look backwards, but feet
    stay at right angles to their shanks. Of joints without toes, the first is between the axis
    about which bent knees turn and the line of the hips.

    Args:
        points: landmarks (F, 16, 3) in right-handed axes, NaN where unknown.

    Returns:
        (F,) each, NaN where unknown; negative where sides are exchanged.
    """
    at = dict(zip(LANDMARKS, points.unbind(1), strict=True))
    hips, shoulders = at["l_hip"] - at["r_hip"], at["l_shoulder"] - at["r_shoulder"]
    level = _cosine(hips, shoulders)
    feet = _feet(points)
    if bool(feet.isnan().all()):
        return _cosine(_knees(at), hips), level
    # joints that few views see are often unknown, and one foot says as much as two
    between = 0.5 * (at["l_shoulder"] + at["r_shoulder"])
    trunk = torch.where(at["neck"].isnan(), between, at["neck"]) - 0.5 * (at["l_hip"] + at["r_hip"])
    shanks = points[:, _SHINS] - points[:, _ANKLES]
    up = torch.where(shanks.isnan(), trunk[:, None], shanks)
    return _cosine(torch.linalg.cross(hips[:, None].expand_as(up), up), feet).nanmean(1), level


def _feet(points: Tensor) -> Tensor:
    """From ankles to toes, (F, 2, 3); NaN where unknown, or guessed to be at the ankles."""
    ankles, toes = points[:, _ANKLES], points[:, _TOES]
    feet = toes - ankles
    guessed = (feet.abs() <= _NOWHERE * ankles.abs()).all(-1, keepdim=True)
    return torch.where(guessed, torch.nan, feet)


def _knees(at: dict[str, Tensor]) -> Tensor:
    """Axis about which the knees are bent, (F, 3): to the person's left, whatever the trunk does.

    NaN where both are straight or unknown.
    """
    axes = []
    for side in "lr":
        thigh = at[f"{side}_knee"] - at[f"{side}_hip"]
        shank = at[f"{side}_ankle"] - at[f"{side}_knee"]
        axis = torch.linalg.cross(
            *(torch.nn.functional.normalize(v, dim=-1) for v in (thigh, shank))
        )
        axes.append(torch.where(axis.norm(dim=-1, keepdim=True) > _BENT, axis, torch.nan))
    return torch.stack(axes).nanmean(0)


def examine_limbs_of_view(subject: str, pixels: Tensor, known: Tensor) -> list[Finding]:
    """Arms or legs of one image that have left and right exchanged against the others.

    Whoever turns their shoulders does not turn them about; of one view without 3D poses it is
    unknown which of the two are right.

    Args:
        subject: of the finding.
        pixels: landmarks (F, 16, 2).
        known: which of them count, (F, 16).
    """
    size = body_size(pixels, known)
    if size is None:
        return []
    seen = torch.where(known[..., None], pixels, torch.nan)
    at = dict(zip(LANDMARKS, seen.unbind(1), strict=True))
    hips, shoulders = at["l_hip"] - at["r_hip"], at["l_shoulder"] - at["r_shoulder"]
    wide = (hips.norm(dim=-1) > _HIPS * size) & (shoulders.norm(dim=-1) > _SHOULDERS * size)
    cosine = _cosine(hips, shoulders)[wide]
    clear = cosine[cosine.abs() > _CLEARLY]
    if len(clear) < _SHOW or float((clear < 0).double().mean()) < _OPPOSITE:
        return []
    what = (
        f"hips and shoulders have left and right opposite ways in {int((clear < 0).sum())} of "
        f"{len(clear)} frames that show both: those of the arms or of the legs look exchanged"
    )
    remedy = "left and right are the person's own: exchange the names of the ones that are wrong"
    return [Finding(Severity.WARNING, subject, what, remedy)]


def of_sides(points: Tensor) -> tuple[Tensor, Tensor]:
    """Joints that people have twice, of (..., 16, D): left and right, (..., 6, D) each."""
    left, right = ([LANDMARKS.index(f"{side}_{name}") for name in _PAIRS] for side in "lr")
    return points[..., left, :], points[..., right, :]


def across(points: Tensor) -> Tensor:
    """From right to left, of hips, shoulders, elbows, wrists, knees and ankles, (..., 6, D)."""
    left, right = of_sides(points)
    return left - right


def examine_exchange(subject: str, pixels: Tensor, known: Tensor, points: Tensor) -> list[Finding]:
    """Left and right that change places between two frames, in all views at once.

    Limbs point from right to left in the images as they did before, but the other way, and go on
    so. Where feet show it, the frames are named in which toes point backwards.

    Args:
        subject: of the finding.
        pixels: landmarks of successive frames, (F, C, 16, 2).
        known: which of them count, (F, C, 16).
        points: the same in the world, (F, 16, 3) in right-handed axes, NaN where unknown.
    """
    edges = exchanges(pixels, known, 2)  # a network exchanges sides now and then, in one view
    if not edges:
        return []
    parts = list(pairwise([0, *edges, len(points)]))
    wrong = [part for part in parts if examine_sides(subject, points[slice(*part)])]
    frames: tuple[int, ...] = ()
    if wrong and len(wrong) < len(parts):
        frames = tuple(frame for part in wrong for frame in range(*part))
        what = f"left and right look exchanged in every view in frames {ranges(frames)}"
    else:
        what = f"left and right change places in every view at frame {ranges(edges)}"
    remedy = "exchange the names of left and right there, or capture one part at a time (--frames)"
    views = tuple(range(pixels.shape[1])) if frames else ()
    what = f"{what} (of the capture, counted from 0): they turn over from one frame to the next"
    return [Finding(Severity.WARNING, subject, what, remedy, frames, views)]


def exchanges(pixels: Tensor, known: Tensor, views: int) -> list[int]:
    """Frames at which sides are the opposite of those before, where both went on for a while.

    Args:
        pixels: landmarks of successive frames, (F, C, 16, 2).
        known: which of them count, (F, C, 16).
        views: how many must show it.
    """
    sides = across(torch.where(known.unsqueeze(-1), pixels, torch.nan))  # F C N 2
    found = []
    for frame in range(_LONG, len(pixels) - _LONG + 1):
        # who turns takes more than one frame
        if not alike(sides[frame - 1], sides[frame]) < -_AT_ONCE:
            continue
        before = sides[frame - _NEAR : frame].nanmean(0)
        after = sides[frame : frame + _NEAR].nanmean(0)
        if not alike(before, after) < -_CLEAR:
            continue
        crossed = [alike(*view) < -_CLEAR for view in zip(before, after, strict=True)]
        if sum(crossed) < views:
            continue
        earlier = sides[frame - _LONG : frame - _NEAR].nanmean(0)
        later = sides[frame + _NEAR : frame + _LONG].nanmean(0)
        if alike(earlier, before) > 0 and alike(after, later) > 0:
            found.append((alike(before, after), frame))
    best: list[int] = []
    for _, frame in sorted(found):
        if all(abs(frame - other) >= _LONG for other in best):
            best.append(frame)
    return sorted(best)


def alike(sides: Tensor, others: Tensor) -> float:
    """Correlation of directions (..., 2) in the images, from -1 to 1; NaN where none are known."""
    count = (sides.isfinite() & others.isfinite()).all(-1)
    first, second = sides[count], others[count]
    return float((first * second).sum() / (first.norm() * second.norm()))


def _cosine(first: Tensor, second: Tensor) -> Tensor:
    """Of vectors (..., 3); NaN where a direction is unknown."""
    return torch.nn.functional.cosine_similarity(first, second, dim=-1)


def _against(cosine: Tensor, fewest: int = _FEWEST, most: float = _MOST) -> Severity | None:
    """What it is that nearly all frames that say something say the opposite, if they do."""
    clear = cosine[cosine.abs() > AHEAD]
    wrong = len(clear) >= fewest and float((clear < 0).double().mean()) > most
    return Severity.ERROR if wrong else None


def _plainly(cosine: Tensor) -> Severity | None:
    """The same of clips that are too short for it: most frames say the opposite, none the right."""
    clear = cosine[cosine.abs() > AHEAD]
    wrong = len(cosine) < _FEWEST and len(clear) >= max(1, len(cosine) / 2)
    wrong = wrong and bool((clear < 0).all()) and float(clear.mean()) < -_PLAIN
    return Severity.WARNING if wrong else None


def _partly_against(cosine: Tensor) -> str:
    """How many of the frames that say something say the opposite, in words, if markedly many do."""
    clear = cosine[cosine.abs() > AHEAD]
    against = int((clear < 0).sum())
    many = len(clear) >= _SEVERAL and against > _SOME * len(clear)
    return f"{against} of {len(clear)}" if many else ""
