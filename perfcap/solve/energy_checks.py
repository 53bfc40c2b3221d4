"""Whether an energy's settings are numbers, and its rows those of a state; else refused by name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable
from perfcap.solve.kernels import Kernel


def require_settings(weight: object, kernel: object) -> None:
    """Refuse what is no weight or no kernel; a tensor may hide its numbers.

    Raises:
        InputError: one is.
    """
    if kernel is not None and not isinstance(kernel, Kernel):
        raise InputError(
            f"kernel is {kernel!r:.80}, expected one such as Huber(0.1), or None for squares"
        )
    known = is_readable(weight) if isinstance(weight, Tensor) else True
    if not isinstance(weight, Tensor | float | int) or (
        known and not _all((weight >= 0) & (weight < math.inf))
    ):
        raise InputError(f"weight is {weight!r:.80}; expected a finite number from 0 on")


def require_fitting(energy: object, value: Tensor, confidence: Tensor | None) -> None:
    """Refuse confidences that are not those of the groups of values (*b, F, G, d).

    Raises:
        InputError: they do not broadcast to them.
    """
    if confidence is not None and not fits(confidence.shape, value.shape[:-1]):
        raise InputError(
            f"{type(energy).__name__} has values {tuple(value.shape)} and confidence "
            f"{tuple(confidence.shape)}, expected (*b, F, G, d) and (*b, F, G): do its points, "
            "views, frames and units fit each other?"
        )


def require_linearization(energy: object, linear: Any) -> None:
    """Refuse what is no residual with its derivative.

    Raises:
        InputError: it is something else.
    """
    parts = (
        getattr(getattr(linear, "residual", None), "value", None),
        getattr(linear, "frame", None),
    )
    if not all(isinstance(part, Tensor) for part in parts):
        raise InputError(
            f"{type(energy).__name__}.linearize returned a {type(linear).__name__}; expected a "
            "Linearization of a Residual and its derivative (*b, F, G, d, D)"
        )


def require_lead(energy: object, value: Tensor, batch: Sequence[int], frames: int) -> None:
    """Refuse values (*b, F, G, d) of other frames, or of another batch, than a state's.

    Raises:
        InputError: they are.
    """
    count, shape = len(batch), value.shape
    whole = len(shape) == count + 3 and shape[count] == frames
    if not whole or not fits(shape[:count], batch):
        raise InputError(
            f"{type(energy).__name__} has values {tuple(shape)} for a state of batch "
            f"{tuple(batch)} and {frames} frames, expected (*b, F, G, d): does what it is made of "
            "have the same batch and frames?"
        )


def require_slopes(energy: object, frame: Tensor, value: Tensor, unknowns: int) -> None:
    """Refuse a closed form whose derivative is not that of values (*b, F, G, d).

    Raises:
        InputError: it is not (*b, F, G, d, D).
    """
    wanted = (*value.shape[-3:], unknowns)
    if tuple(frame.shape[-4:]) != wanted or not fits(frame.shape[:-4], value.shape[:-3]):
        raise InputError(
            f"{type(energy).__name__}.linearize returned a derivative {tuple(frame.shape)} of "
            f"values {tuple(value.shape)}; expected (*b, F, G, d, D), which ends in {wanted}"
        )


def require_filtered(energy: object, features: Tensor, basis: Tensor) -> None:
    """Refuse features (*b, F, E) of other frames, or of another float type, than a basis (K, F).

    Raises:
        InputError: they are.
    """
    if features.shape[-2] != basis.shape[-1]:
        raise InputError(
            f"{type(energy).__name__} filters {basis.shape[-1]} frames but the state has "
            f"{features.shape[-2]}; make one for as many"
        )
    if features.dtype is not basis.dtype:
        raise InputError(
            f"{type(energy).__name__} filters features of {features.dtype} along a basis of "
            f"{basis.dtype}; take the energy there with .to({features.dtype})"
        )


def require_value(energy: object, value: Tensor, batch: Sequence[int]) -> None:
    """Refuse an energy that is not one number of each batch element.

    Raises:
        InputError: it is not (*b,), or a number for all.
    """
    if not fits(value.shape, batch) or value.ndim not in (0, len(batch)):
        raise InputError(
            f"{type(energy).__name__} has energies {tuple(value.shape)} for a state of batch "
            f"{tuple(batch)}; expected one of each batch element, summed over frames and groups"
        )


def require_types(energy: object, method: str, like: Tensor, *found: Tensor) -> None:
    """Refuse rows and derivatives of another float type than the unknowns'.

    Raises:
        InputError: one is.
    """
    if any(each.dtype is not like.dtype for each in found):
        kinds = ", ".join(str(each.dtype) for each in found)
        raise InputError(
            f"{type(energy).__name__}.{method} returned {kinds} for unknowns of {like.dtype}; make "
            "its constants buffers, or the type of the unknowns"
        )


def require_features(
    energy: object, features: Tensor, jacobian: Tensor, batch: Sequence[int], state: tuple[int, int]
) -> None:
    """Refuse features of other frames, or another batch, than a state's, and slopes of others.

    Args:
        energy: whose they are.
        features: (*b, F, E).
        jacobian: their derivative, (*b, F, E, D).
        batch: b of the state.
        state: F and D.

    Raises:
        InputError: they are.
    """
    frames, unknowns = state
    count, shape = len(batch), features.shape
    whole = len(shape) == count + 2 and shape[count] == frames
    if not whole or not fits(shape[:count], batch) or jacobian.shape != (*shape, unknowns):
        raise InputError(
            f"{type(energy).__name__}.linearize_features returned features {tuple(shape)} and "
            f"their derivative {tuple(jacobian.shape)} for a state of batch {tuple(batch)} and "
            f"{frames} frames of {unknowns} unknowns; expected (*b, F, E) and (*b, F, E, D)"
        )


def require_weight(name: str, weight: Tensor, batch: Sequence[int]) -> None:
    """Refuse a weight that is neither a number nor one of each batch element.

    Raises:
        InputError: it is another tensor.
    """
    if weight.ndim and (weight.ndim != len(batch) or not fits(weight.shape, batch)):
        raise InputError(
            f"energy {name!r} has weights {tuple(weight.shape)} for a state of batch "
            f"{tuple(batch)}; expected a number, or one of each batch element: weights of points "
            "and frames are confidences"
        )


def fits(shape: Sequence[int], wanted: Sequence[int]) -> bool:
    """Whether the one shape broadcasts to the other."""
    lacking = len(wanted) - len(shape)
    return lacking >= 0 and all(
        own in (1, size) for own, size in zip(shape, wanted[lacking:], strict=True)
    )


def _all(condition: Tensor | bool) -> bool:
    return bool(condition.all()) if isinstance(condition, torch.Tensor) else condition
