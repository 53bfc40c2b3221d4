"""Truths in images that contradict the other truth: annotated joints, and silhouettes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from perfcap.metrics.lags import in_words, overlap
from perfcap.metrics.mismatch_named import Numbered, runs

# --- Annotated joints, against true ones in space that the cameras see ----------------------------

# Shares of the person's size in the image: how far apart both may be before it needs an
# explanation, and without one, since people who annotate place joints elsewhere than body models.
_APART, _FAR = 0.015, 0.06
_LEFT = 0.4  # share of the distance that an explanation may leave
_LAGS = 10  # frames
_FEWEST = 10  # joints in all frames
_RESIZED = 0.02
_PART, _BETWEEN = 10, 6  # frames of a stretch at least, and those within that tell nothing
_HELD = 0.75  # share of its frames that an explanation must explain
_SEEN = 4  # joints of a frame
_LISTED = 3  # sentences, before one stands for all


def pixel_mismatches(
    projected: Tensor,
    annotated: Tensor,
    mirrored: Sequence[int],
    views: Sequence[str],
    frames: Sequence[int] = (),
) -> tuple[str, ...]:
    """A sentence for each way in which joints in images are not those that its cameras see.

    Args:
        projected: true joints as the cameras of the truth see them, (F, C, J, 2) px.
        annotated: true joints in the images, the same; not finite where unknown.
        mirrored: each joint's counterpart on the other side; itself in the middle.
        views: their names, (C,).
        frames: their numbers, (F,); stretches are told by their length where none are given.
    """
    said: dict[tuple[str, str], list[_Wrong]] = {}
    for view, name in enumerate(views):
        wrong = _of_view(projected, annotated, view, list(mirrored), views)
        told = [] if wrong is None else [wrong]
        if wrong is None or not wrong.mended_by:  # by medians of all frames
            parts = _in_parts(projected[:, view], annotated[:, view], list(mirrored), frames)
            told = list(parts) or told
        for each in told:
            said.setdefault((each.mended_by, each.where), []).append(replace(each, view=name))
    if len(said) > _LISTED:
        said = {("", ""): [wrong for each in said.values() for wrong in each]}
    return tuple(_sentence(*how, wrong) for how, wrong in said.items())


@dataclass(frozen=True)
class _Wrong:
    """Annotated joints of a view that are off: by how many pixels, and with a change of theirs."""

    mended_by: str  # or nothing does
    far: float
    left: float
    view: str = ""
    where: str = ""  # stretch of frames


def _sentence(mended_by: str, where: str, wrong: Sequence[_Wrong]) -> str:
    views = f"view{'s' if len(wrong) > 1 else ''} {', '.join(each.view for each in wrong)}"
    near, far = min(each.far for each in wrong), max(each.far for each in wrong)
    apart = f"{far:.0f}" if len(wrong) == 1 else f"{near:.0f} to {far:.0f}"
    left = f"; {mended_by} {max(each.left for each in wrong):.0f} px are left" if mended_by else ""
    return (
        f"{views}: annotated joints lie {apart} px from where the cameras of the truth see its "
        f"joints{where}{left}; check that cameras, joints and images of the truth belong together; "
        "reproj_px measures that as well"
    )


def _of_view(
    projected: Tensor, annotated: Tensor, view: int, order: list[int], views: Sequence[str]
) -> _Wrong | None:
    seen, known = projected[:, view], annotated[:, view]
    size = _person(seen)
    now = _apart(seen, known, size)
    if not now > _APART:  # NaN where hardly any joint is known
        return None
    tries: list[tuple[float, str]] = []
    for lag in range(-_LAGS, _LAGS + 1):
        if lag == 0 or abs(lag) >= len(seen) // 2:
            continue
        here, there = overlap(len(seen), lag)
        what = f"with those of {in_words(lag)}"
        tries.append((_apart(seen[here], known[there], size), what))
    tries.append((_apart(seen[:, order], known, size), "with left and right exchanged"))
    both = (seen.isfinite() & known.isfinite()).all(-1)
    factor = float((seen[both] * known[both]).sum() / seen[both].square().sum().clamp(min=1e-9))
    if abs(factor - 1) > _RESIZED:
        what = f"if their image is {factor:.3g} times as large"
        tries.append((_apart(factor * seen, known, size), what))
    aside = (known - seen)[both].median(0).values
    what = f"if moved by {aside[0]:.0f}, {aside[1]:.0f} px"
    tries.append((_apart(seen + aside, known, size), what))
    for other, name in enumerate(views):
        if other != view:
            what = f"as those of view {name}"
            tries.append((_apart(projected[:, other], known, size), what))
    left, what = min(tries, key=lambda each: each[0] if each[0] == each[0] else torch.inf)
    if left < _LEFT * now:
        return _Wrong(what, size * now, size * left)
    return _Wrong("", size * now, 0.0) if now > _FAR else None


def _in_parts(
    seen: Tensor, known: Tensor, order: list[int], frames: Sequence[int]
) -> Iterator[_Wrong]:
    """Stretches of a view, joints (F, J, 2) px, with sides exchanged, or of other frames."""
    count, size = len(seen), _person(seen)
    now = _by_frame(seen, known)
    far = now > _APART * size
    if int(far.sum()) < _PART // 2:
        return
    tries = [("with left and right exchanged", _by_frame(seen[:, order], known))]
    for lag in range(-_LAGS, _LAGS + 1):
        if lag and abs(lag) < count // 2:
            here, there = overlap(count, lag)
            moved = torch.full_like(known, torch.nan)
            moved[here] = known[there]
            tries.append((f"with those of {in_words(lag)}", _by_frame(seen, moved)))
    found = []
    for what, errors in tries:
        better = far & (errors < _LEFT * now)
        for first, last in runs(better, hole=_BETWEEN):
            part = slice(first, last + 1)
            left = float((errors[part] / now[part])[far[part]].nanmedian())
            # frames in which sides are near each other, or nothing moves, tell nothing
            held = float(better[part][far[part]].double().mean()) >= _HELD
            if last - first + 1 >= _PART and held and left < _LEFT:
                found.append((left, first, last, what))
    told = torch.zeros(count, dtype=torch.bool)
    for left, first, last, what in sorted(found):
        if not bool(told[first : last + 1].any()):
            told[first : last + 1] = True
            off = float(now[first : last + 1].nanmedian())
            stretch = Numbered(frames).stretch(first, last)
            where = stretch if frames else f"{last - first + 1} frames in a row"
            yield _Wrong(what, off, left * off, where=f" in {where}")


def _by_frame(seen: Tensor, known: Tensor) -> Tensor:
    """Median distance of each frame, (F,) px; NaN of hardly any joints."""
    apart = (seen - known).norm(dim=-1)
    apart = torch.where(apart.isfinite(), apart, torch.nan)
    enough = apart.isfinite().sum(-1) >= _SEEN
    return torch.where(enough, apart.nanmedian(-1).values, torch.nan)


def _apart(seen: Tensor, known: Tensor, size: float) -> float:
    """Median distance as a share of the person; NaN of hardly any joints."""
    apart = (seen - known).norm(dim=-1)
    apart = apart[apart.isfinite()]
    return float(apart.median()) / size if len(apart) >= _FEWEST else torch.nan


def _person(points: Tensor) -> float:
    """Size of a person in the image: median diagonal of the box of their joints, px."""
    known = points.isfinite().all(-1, keepdim=True)
    least = torch.where(known, points, torch.inf).amin(1)
    most = torch.where(known, points, -torch.inf).amax(1)
    diagonal = (most - least).norm(dim=-1)
    diagonal = diagonal[diagonal.isfinite()]
    return max(float(diagonal.median()), 1.0) if len(diagonal) else torch.nan


# --- True silhouettes, against those of a result --------------------------------------------------

_GOOD = 0.95  # overlap that needs no explanation
_BAD = 0.5  # overlap that is said to be one without any
_REST, _GAIN = 0.6, 0.03  # share of 1 - overlap that an explanation may leave; and what it gains
_PLACE = 0.01  # of the person's height: outlines of right results lie nearer
_STRETCH = 0.04


def silhouette_mismatches(
    found: Tensor, true: Tensor, lags: Sequence[int], scale: float = 1.0
) -> tuple[str, ...]:
    """What explains that true silhouettes and those of a result overlap badly, or that they do.

    Args:
        found: silhouettes of a result, (N, H, W) bool.
        true: true ones of the frames around each, (N, L, H, W) bool; empty where there is none.
        lags: how many frames later each of the L is; 0 among them.
        scale: pixels of the images for one of these.
    """
    now_row = list(lags).index(0)
    known = true[:, now_row].any(-1).any(-1) & found.any(-1).any(-1)
    if not bool(known.any()):
        return ()
    found, true = found[known], true[known]
    same = true[:, now_row]
    now = _iou(found, same)
    if now >= _GOOD:
        return ()
    tries = list(_explanations(found, true, lags, now_row))
    what, moved = _placed(found, same, scale)
    if what:
        tries.append((_iou(moved, same), what))
    best, what = max(tries, key=lambda each: each[0])
    if 1 - best < _REST * (1 - now) and best > now + _GAIN:
        return (f"overlap at {best:.0%} instead of {now:.0%} {what}",)
    if now < _BAD:
        return (f"overlap at {now:.0%}",)
    return ()


def _explanations(
    found: Tensor, true: Tensor, lags: Sequence[int], now_row: int
) -> Iterator[tuple[float, str]]:
    same = true[:, now_row]
    yield _iou(found.flip(-1), same), "if they are mirrored"
    yield _iou(found.flip(-2), same), "if they are turned upside down in a mirror"
    yield _iou(found.flip(-1, -2), same), "if they are turned upside down"
    yield _iou(found, ~same), "if they are inverted"
    if found.shape[-1] == found.shape[-2]:
        yield _iou(found.mT, same), "if rows and columns are exchanged"
    for row, lag in enumerate(lags):
        there = true[:, row].any(-1).any(-1)
        if lag == 0 or 2 * int(there.sum()) < len(found):
            continue
        # the same frames without the lag, which may be better or worse than all
        gain = _iou(found[there], true[there, row]) - _iou(found[there], same[there])
        yield _iou(found, same) + gain, f"if true ones of {in_words(lag)} are taken"


def _placed(found: Tensor, true: Tensor, scale: float) -> tuple[str, Tensor]:
    """Silhouettes of the result moved and stretched along each axis to where the true ones are."""
    own, other = _edges(found), _edges(true)  # (N, 2, 2): axis, end
    height = float((own[:, 1, 1] - own[:, 1, 0]).median())
    factor = ((other[..., 1] - other[..., 0]) / (own[..., 1] - own[..., 0])).median(0).values
    middle, target = own.mean(-1).median(0).values, other.mean(-1)
    shift = (target - (middle + factor * (own.mean(-1) - middle))).median(0).values
    if not (shift.abs().max() > _PLACE * height or (factor - 1).abs().max() > _STRETCH):
        return "", found
    rows, columns = found.shape[-2:]
    size = torch.tensor([columns, rows], dtype=own.dtype)
    grid = torch.stack(
        torch.meshgrid(torch.arange(columns), torch.arange(rows), indexing="xy"), -1
    ).to(own)
    source = (grid + 0.5 - shift - middle) / factor + middle
    sampled = functional.grid_sample(
        found[:, None].to(own), (2 * source / size - 1).expand(len(found), -1, -1, -1),
        align_corners=False,
    )  # fmt: skip
    across, down = (scale * shift).tolist()
    wide, tall = factor.tolist()
    stretched = f" and are {wide:.2f} times as wide and {tall:.2f} times as tall"
    much = stretched if (factor - 1).abs().max() > _STRETCH else ""
    return f"if the true ones lie {across:.0f}, {down:.0f} px aside{much}", sampled[:, 0] > 0.5


def _edges(masks: Tensor) -> Tensor:
    """Where silhouettes begin and end along each axis, (N, 2, 2) px; none may be empty."""
    ends = []
    for lines in (masks.any(-2), masks.any(-1)):
        count = lines.shape[-1]
        first = lines.to(torch.uint8).argmax(-1)
        last = count - lines.flip(-1).to(torch.uint8).argmax(-1)
        ends.append(torch.stack((first, last), -1))
    return torch.stack(ends, 1).double()


def _iou(found: Tensor, true: Tensor) -> float:
    """Mean over frames of intersection over union."""
    both = (found & true).sum((-2, -1))
    either = (found | true).sum((-2, -1))
    return float((both / either.clamp(min=1)).mean())
