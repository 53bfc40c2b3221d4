"""Which joints count, and means over those that do.

A joint is *missing* where a coordinate of the estimate or of the truth is not finite, or where its
confidence is zero or NaN. What is missing is left out of every mean, and counted.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.errors import InputError

PERSON = 100.0  # m from end to end: of wild estimates, too; a person in centimetres has more
_POINT = 0.1  # m: joints that never lie farther apart are one point, not a person
_SHARES, _MANY = 2.0, 8  # px: no more of an image than shares of its size; joints that show it
_TURNS, _SHARE = 4 * math.pi, 0.1


def check_same_joints(estimate: Tensor, truth: Tensor) -> None:
    """Refuse joints that do not belong together.

    Raises:
        InputError: the shapes differ, are not (*b, F, J, d), or have no frame.
    """
    if not (isinstance(estimate, Tensor) and isinstance(truth, Tensor)):
        raise InputError(
            f"estimate is a {type(estimate).__name__} and truth a {type(truth).__name__}, expected "
            "tensors; torch.from_numpy makes them of arrays"
        )
    if estimate.shape != truth.shape or estimate.dim() < 3 or not estimate.shape[-3]:
        raise InputError(
            f"estimate has shape {tuple(estimate.shape)} and truth {tuple(truth.shape)}; give "
            "joints of the same frames, one or more, as (*b, F, J, d)"
        )


def check_metres(**joints: Tensor) -> None:
    """Refuse joints (*b, F, J, 3) whose frames most often span more than any person in metres.

    Raises:
        InputError: some do.
    """
    for name, points in joints.items():
        frames = points.detach()[complete(points)].double()
        if points.shape[-1] != 3 or not len(frames):
            continue
        span = float((frames.amax(-2) - frames.amin(-2)).norm(dim=-1).median())
        if span > PERSON:
            raise InputError(
                f"{name} spans {span:.4g} from end to end in a frame, expected metres; convert them"
            )


def check_heights(height: Tensor) -> None:
    """Refuse heights (*b, F, N) of a person whose frames most often span more than any in metres.

    Where the person is above the floor says nothing: an estimate may be anywhere.

    Raises:
        InputError: some do.
    """
    frames = height.detach()[height.isfinite().all(-1)].double()
    span = float((frames.amax(-1) - frames.amin(-1)).median()) if len(frames) else 0.0
    if span > PERSON:
        raise InputError(
            f"height spans {span:.4g} from lowest to highest in a frame, expected metres; convert "
            "it"
        )


def check_pixels(pixels: Tensor, truth: Tensor, valid: Tensor) -> None:
    """Refuse what is no image of joints (*b, F, J, 2) in pixels, where some count (*b, F, J).

    Raises:
        InputError: another number of coordinates, or joints of several frames within two pixels of
            one another, as shares of an image's size are.
    """
    if pixels.shape[-1] != 2:
        raise InputError(
            f"pixels have shape {tuple(pixels.shape)}, expected (*b, F, J, 2); project joints first"
        )
    seen = valid.unsqueeze(-1)
    for name, points in (("pixels", pixels), ("truth", truth)):
        known = points.detach().where(seen, torch.nan)
        flat = known.flatten(0, -2)
        flat = flat[flat.isfinite().all(-1)]
        span = float((flat.amax(0) - flat.amin(0)).max()) if len(flat) else math.inf
        if int(valid.sum()) >= _MANY and 0 < span <= _SHARES:
            raise InputError(
                f"{name} has joints within {span:.3g} of one another, expected pixels; multiply "
                "shares of an image by its width and height"
            )


def check_places(truth: Tensor, valid: Tensor | None = None, name: str = "truth") -> None:
    """Refuse joints (*b, F, J, 3) of which two or more of a frame are at 0, 0, 0.

    So files mark what was not measured, and estimators where they found nobody; with a true one of
    these the similarity of a frame has no error at all, with an estimated one that of a point.

    Raises:
        InputError: some are, and count.
    """
    empty = (truth.detach() == 0).all(-1)
    lost = ((empty if valid is None else empty & valid).sum(-1) > 1).flatten()
    if not bool(lost.any()):
        return
    known = truth.detach().nan_to_num()
    if float((known.amax(-2) - known.amin(-2)).amax()) > _POINT:
        raise InputError(
            f"{name} has several joints at 0, 0, 0 in {int(lost.sum())} of {len(lost)} frames "
            f"(first in row {int(lost.nonzero()[0])}), expected places in metres; where nothing "
            "is known give NaN, or leave the frames out"
        )


def check_radians(**angles: Tensor) -> None:
    """Refuse angles of which one in ten or more is beyond two turns.

    Raises:
        InputError: they are.
    """
    for name, values in angles.items():
        known = values.detach()[values.isfinite()].abs()
        if len(known) and float((known > _TURNS).double().mean()) >= _SHARE:
            raise InputError(
                f"{name} has angles of up to {float(known.max()):.4g}, expected radians: take "
                "torch.deg2rad of degrees"
            )


def check_mask(valid: Tensor) -> None:
    """Refuse what is no mask: a byte of 255 would count 255 times.

    Raises:
        InputError: it is not bool.
    """
    if valid.dtype != torch.bool:
        raise InputError(f"valid is {valid.dtype}, expected bool; say which are true, as valid > 0")


def complete(points: Tensor) -> Tensor:
    """Frames (*b, F) of points (*b, F, J, d) in which every joint is finite."""
    return points.isfinite().all(-1).all(-1)


def counted_joints(
    estimate: Tensor, truth: Tensor, confidence: Tensor | None = None, partial: bool = False
) -> Tensor:
    """Which joints count, (*b, F, J).

    Args:
        estimate: (*b, F, J, d).
        truth: (*b, F, J, d).
        confidence: (*b, F, J); a joint of confidence 0 or NaN is missing.
        partial: whether a frame with missing joints counts with those it has; otherwise it does
            not count at all.

    Raises:
        InputError: shapes that do not belong together.
    """
    check_same_joints(estimate, truth)
    present = estimate.isfinite().all(-1) & truth.isfinite().all(-1)
    if confidence is not None:
        if confidence.shape != present.shape:
            raise InputError(
                f"confidence has shape {tuple(confidence.shape)} for joints "
                f"{tuple(estimate.shape)}; give one number a joint, (*b, F, J)"
            )
        present = present & (confidence > 0)  # NaN is not larger
    return present if partial else present.all(-1, keepdim=True).expand_as(present)


def frame_mean(values: Tensor, valid: Tensor) -> Tensor:
    """Mean (*b) of values (*b, F, J) over what is valid; NaN over nothing.

    Args:
        values: may hold anything where they are not valid.
        valid: frames (*b, F) or joints (*b, F, J).
    """
    kept = _over_joints(values, valid)
    total = torch.where(kept, values, torch.zeros_like(values)).sum((-2, -1))
    return total / kept.sum((-2, -1))


def joint_mean(values: Tensor, valid: Tensor) -> Tensor:
    """Mean (*b, J) of values (*b, F, J) over the frames in which each joint is valid."""
    kept = _over_joints(values, valid)
    return torch.where(kept, values, torch.zeros_like(values)).sum(-2) / kept.sum(-2)


def masked(points: Tensor, valid: Tensor) -> Tensor:
    """Points (*b, F, J, d) with NaN where frames (*b, F) or joints (*b, F, J) are not valid."""
    lack = valid.dim() - points.dim() + 2
    kept = valid[..., None, None] if lack == 0 else valid.unsqueeze(-1)
    return torch.where(kept, points, torch.nan)


def _over_joints(values: Tensor, valid: Tensor) -> Tensor:
    check_mask(valid)
    if valid.shape not in (values.shape, values.shape[:-1]):
        raise InputError(
            f"valid has shape {tuple(valid.shape)} for values {tuple(values.shape)}; give one a "
            "frame, (*b, F), or one a joint, (*b, F, J)"
        )
    return valid if valid.dim() == values.dim() else valid.unsqueeze(-1).expand_as(values)
