"""Arguments that most energies have: units, and points that move."""

from __future__ import annotations

import math
from collections.abc import Collection

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.camera_checks import require_lenses
from perfcap.geometry.plain import is_readable


def require_unit(unit: float | Tensor, name: str = "unit") -> None:
    """Refuse what residuals cannot be divided by; a tensor elsewhere may hide its numbers.

    Raises:
        InputError: it is zero, negative or NaN. What is infinite counts for nothing.
    """
    _require(unit, name, "a number above zero, by which residuals are divided", above=True)


def require_scale(scale: float | Tensor, name: str) -> None:
    """Refuse factors of residuals that are negative, infinite or NaN, likewise.

    Raises:
        InputError: one is.
    """
    _require(scale, name, "a finite number from 0 on", above=False)


def _require(given: float | Tensor, name: str, wanted: str, *, above: bool) -> None:
    if isinstance(given, Tensor):
        given = given.detach()
        if not is_readable(given):
            return
        sound = bool((given > 0 if above else (given >= 0) & (given < math.inf)).all())
        given = float(given.min())
    else:
        sound = given > 0 if above else 0 <= given < math.inf
    if not sound:
        raise InputError(f"{name} is {given}; expected {wanted}")


def require_confidence(confidence: Tensor, name: str = "confidence") -> None:
    """Refuse confidences that are negative or no numbers; a tensor elsewhere may hide its own.

    Raises:
        InputError: one is.
    """
    confidence = confidence.detach()
    if is_readable(confidence) and not bool((confidence >= 0).all()):
        raise InputError(
            f"{name} is {float(confidence.min()):.3g} at least, expected numbers from 0 on; take "
            "the sigmoid of logits, and 0 for what is unseen (of Detections, finite() does)"
        )


def known_places(places: Tensor, confidence: Tensor, name: str) -> Tensor:
    """Places (..., N, k) with zeros for those of confidence 0 that are no numbers.

    Raises:
        InputError: others are none.
    """
    if not is_readable(places):
        return places
    lost = ~places.detach().isfinite().all(-1)
    if not bool(lost.any()):
        return places
    if bool((lost & (confidence.detach() > 0)).any()):
        raise InputError(
            f"{name} holds NaN or infinity where its confidence is above 0; expected a confidence "
            "of 0 there (of Detections, finite() gives it)"
        )
    return torch.where(lost.unsqueeze(-1), 0, places)


def require_moved(points: Tensor, moved: Tensor, unknowns: int | None = None) -> None:
    """Refuse a derivative of other points, or in other unknowns: compiled loops believe it.

    Args:
        points: (*b, F, N, 3).
        moved: their derivative, (*b, F, N, 3, D).
        unknowns: D; None where any will do.

    Raises:
        InputError: it is not theirs.
    """
    if moved.shape[:-1] != points.shape or unknowns not in (None, moved.shape[-1]):
        wanted = "D" if unknowns is None else f"D = {unknowns}"
        raise InputError(
            f"points {tuple(points.shape)} came with a derivative {tuple(moved.shape)}; expected "
            f"(*b, F, N, 3) and (*b, F, N, 3, D) with {wanted}: does their linearize fit the state?"
        )


def require_frames(energy: object, own: int, frames: int) -> None:
    """Refuse a state of other frames than an energy was made for.

    Raises:
        InputError: it is one.
    """
    if own != frames:
        raise InputError(
            f"{type(energy).__name__} is made for {own} frames but the state has {frames}; make "
            "one for as many"
        )


_TURNS = 4 * math.pi  # rad: no joint turns further
_BODY = 20.0  # m from end to end, of anybody's points


def require_radians(angles: Tensor, name: str) -> None:
    """Refuse angles that look like degrees, and NaN; infinite ones are none.

    Raises:
        InputError: one is beyond two turns, or no number.
    """
    angles = angles.detach()
    if not is_readable(angles):
        return
    if bool(angles.isnan().any()):
        raise InputError(f"{name} holds NaN, expected radians")
    far = angles[angles.isfinite() & (angles.abs() > _TURNS)]
    if len(far):
        raise InputError(
            f"{name} has angles of {float(far[0]):.4g}, expected radians: take torch.deg2rad of "
            "degrees"
        )


def require_metres(places: Tensor, confidence: Tensor) -> None:
    """Refuse places (..., N, 3) of a person's points that most often lie further apart than any.

    Raises:
        InputError: they do.
    """
    places, confidence = places.detach(), confidence.detach()
    if not is_readable(places) or not places.numel():
        return
    known = (places.isfinite().all(-1) & (confidence > 0)).unsqueeze(-1)
    high = torch.where(known, places, -math.inf).amax(-2)
    low = torch.where(known, places, math.inf).amin(-2)
    spans = (high - low)[known.any(-2).squeeze(-1)].amax(-1)
    if len(spans) and float(spans.median()) > _BODY:
        raise InputError(
            f"target has points that lie {float(spans.median()):.4g} apart in a frame, expected "
            "metres: divide millimetres by 1000"
        )


def require_places(places: Tensor, confidence: Tensor) -> None:
    """Refuse places (..., N, 3) of which two or more of a frame are at 0, 0, 0: unknown ones.

    Raises:
        InputError: some are, and count.
    """
    places, confidence = places.detach(), confidence.detach()
    if not (is_readable(places) and is_readable(confidence)):
        return
    zero = (places == 0).all(-1) & (confidence > 0)
    frames = int((zero.sum(-1) > 1).sum())
    if frames:
        raise InputError(
            f"target has several points at 0, 0, 0 in {frames} frames, where nothing was known; "
            "expected a confidence of 0 there"
        )


def require_cameras(cameras: Camera) -> None:
    """Refuse cameras that are none; those elsewhere may hide their numbers.

    Raises:
        InputError: they are none.
    """
    if all(map(is_readable, (cameras.intrinsics, cameras.rotation, cameras.translation))):
        require_lenses("cameras", cameras)


def seen_by(points: object) -> Collection[str]:
    """Shared unknowns that points depend on, by name.

    Raises:
        InputError: they are no points, but an actor, say.
    """
    sees: Collection[str] | None = getattr(points, "sees", None)
    if sees is None:
        raise InputError(
            f"points: got a {type(points).__name__}, expected points that move with a motion, such "
            "as actor.landmarks"
        )
    return sees
