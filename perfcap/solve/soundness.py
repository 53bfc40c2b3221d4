"""Whether energies whose derivatives are found automatically are what those derivatives assume."""

from __future__ import annotations

import warnings
from typing import Any

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.compound import OfPart, WindowOfPart
from perfcap.solve.energy import Coupling, Energy, Objective, Residual, State, Step, WindowEnergy
from perfcap.solve.energy_checks import fits

_LEAK = 1e-9  # of the largest derivative
_NEGATIVE = (
    "has confidences below zero; expected numbers from 0 on: the square of what may have a sign, "
    "or its sigmoid"
)
_CONSTANT = (
    "does not change with its unknowns where they start, so that it has no effect; does its "
    "residual detach them, go through NumPy, or clamp?"
)


def require_sound(objective: Objective, state: Any) -> None:
    """Refuse what forward-mode differentiation would take for a residual of separate frames.

    Two derivatives along one direction each, of energies that have no closed form, once a solve.
    Derivatives would be wrong as well where a residual changes its state in place.

    Raises:
        InputError: a filter along other frames, a learned weight or a confidence below zero, a
            residual of another shape or type than (*b, F, G, d), rows that depend on other frames
            or batch elements than their own, or on shared unknowns that the energy does not see.
    """
    like = state.coordinates().frame
    frames = like.shape[-2]
    for name, energy in objective.items():
        if isinstance(energy, WindowEnergy) and energy.basis.shape[-1] != frames:
            raise InputError(
                f"energy {name!r} filters {energy.basis.shape[-1]} frames but the state has "
                f"{frames}; make one for as many"
            )
        if isinstance(energy, WindowEnergy) and energy.basis.dtype is not like.dtype:
            raise InputError(
                f"energy {name!r} filters along a basis of {energy.basis.dtype} but the unknowns "
                f"are {like.dtype}; take the energy there with .to({like.dtype})"
            )
        if energy.weight.requires_grad:
            _require_weight(name, energy.weight.detach())
        whole = state
        while isinstance(energy, OfPart | WindowOfPart) and energy.name in whole.parts:
            energy, whole = energy.energy, whole.parts[energy.name]
        if isinstance(energy, WindowEnergy):
            if type(energy).linearize_features is WindowEnergy.linearize_features:
                _require_own_features(name, energy, whole)
        elif type(energy).linearize is Energy.linearize and energy.coupling is Coupling.FRAME:
            _require_own_rows(name, energy, whole)


def require_residuals(objective: Objective, state: Any) -> None:
    """Refuse residuals that are none, and warn of constant ones, where only gradients are taken.

    Rows may depend on any frame, and be as many as they like; energies with closed forms of their
    derivatives or values are their author's.

    Raises:
        InputError: a residual of another batch or of fewer dimensions than (*b, F, G, d), with a
            confidence of another shape or below zero; or ``torch.inference_mode``.
    """
    require_recording()
    here = state.coordinates()
    step = Step(*(torch.zeros_like(part).requires_grad_() for part in (here.frame, here.shared)))
    with torch.enable_grad():
        moved = state.retract(step)
        for name, energy in objective.items():
            whole = moved
            while isinstance(energy, OfPart) and energy.name in whole.parts:
                energy, whole = energy.energy, whole.parts[energy.name]
            if (type(energy).linearize, type(energy).forward) == (Energy.linearize, Energy.forward):
                _require_batch(name, energy.residual(whole), here.frame.shape[:-2])


def require_recording() -> None:
    """Refuse ``torch.inference_mode``, in which derivatives are silently none.

    Raises:
        InputError: it is on.
    """
    if torch.is_inference_mode_enabled():
        raise InputError(
            "solve was called within torch.inference_mode, which records no derivatives; use "
            "torch.no_grad there"
        )


def _require_batch(name: str, residual: object, batch: torch.Size) -> None:
    values = _require_kind(name, residual)
    value, own = values.value, values.confidence
    if value.ndim != len(batch) + 3 or value.shape[:-3] != batch:
        raise InputError(
            f"energy {name!r} returned values {tuple(value.shape)}, expected (*b, F, G, d) with "
            f"*b = {tuple(batch)}: rows of G groups of d numbers"
        )
    _require_confidence(name, values)
    if own is not None and _any(own < 0):
        raise InputError(f"energy {name!r} {_NEGATIVE}")
    if not value.requires_grad and _any(value != 0):
        warnings.warn(f"energy {name!r} {_CONSTANT}", stacklevel=2)


def _require_own_rows(name: str, energy: Energy[Any], state: State) -> None:
    here = state.coordinates()
    lead = here.frame.shape[:-1]
    late, unseen = _late(lead, here.frame.device), _unseen(energy, state, here.shared)
    if unseen is not None:
        _, slope = _along(name, energy, state, Step(torch.zeros_like(here.frame), unseen))
        if _any(slope != 0):
            raise InputError(
                f"energy {name!r} depends on shared unknowns that it does not name; list the "
                f"blocks, of {', '.join(state.shared_sizes)}, in its attribute sees"
            )
    still = True
    for part in (late, ~late):  # a row may look ahead or back
        frame = part.unsqueeze(-1).to(here.frame).expand_as(here.frame)
        confidence, slope = _along(name, energy, state, Step(frame, torch.zeros_like(here.shared)))
        still = still and not _any(slope != 0)
        leaks = torch.where(part[..., None, None], 0, slope).abs()
        if slope.numel() and _any(leaks > _LEAK * slope.abs().amax()):
            raise InputError(
                f"energy {name!r} has rows that depend on other frames or batch elements than "
                "their own, so that their derivatives would be wrong; along time use a "
                "WindowEnergy, or solve with Adam()"
            )
    if still and not energy.sees:
        _warn_of_constant(name, energy, state)
    if confidence is not None and _any(confidence < 0):
        raise InputError(f"energy {name!r} {_NEGATIVE}")


def _require_own_features(name: str, energy: WindowEnergy[Any], state: Any) -> None:
    """Features (*b, F, E) that see other frames, as differences along time do, lose derivatives."""
    here = state.coordinates()
    late = _late(here.frame.shape[:-1], here.frame.device)
    for part in (late, ~late):
        frame = part.unsqueeze(-1).to(here.frame).expand_as(here.frame)
        slope = _features_along(name, energy, state, Step(frame, torch.zeros_like(here.shared)))
        leaks = torch.where(part.unsqueeze(-1), 0, slope).abs()
        if slope.numel() and _any(leaks > _LEAK * slope.abs().amax()):
            raise InputError(
                f"energy {name!r} has features that see other frames or batch elements than their "
                "own, so that their derivatives would be wrong; let them see one frame each and "
                "its basis couple them, or solve with Adam()"
            )


def _features_along(name: str, energy: WindowEnergy[Any], state: Any, step: Step) -> Tensor:
    """Derivative of features along a step, (*b, F, E)."""

    def features(size: Tensor) -> Tensor:
        found = energy.features(state.retract(Step(size * step.frame, size * step.shared)))
        lead = tuple(step.frame.shape[:-1])
        if not isinstance(found, Tensor) or tuple(found.shape[:-1]) != lead:
            kind = tuple(found.shape) if isinstance(found, Tensor) else type(found).__name__
            raise InputError(
                f"energy {name!r} returned features {kind}; expected a tensor (*b, F, E) of "
                f"(*b, F) = {lead}"
            )
        return found

    one = step.frame.new_tensor(1.0)
    moved: Any = torch.func.jvp(features, (torch.zeros_like(one),), (one,))
    slope: Tensor = moved[1]
    return slope


def _warn_of_constant(name: str, energy: Energy[Any], state: State) -> None:
    """Warn of a residual that is not zero and has no derivative, in a direction like no other."""
    here = state.coordinates()
    if torch._C._functorch.is_functorch_wrapped_tensor(here.frame):
        return
    odd = (1.0 + torch.arange(here.frame.numel())).sin().to(here.frame).reshape(here.frame.shape)
    _, slope = _along(name, energy, state, Step(odd, torch.zeros_like(here.shared)))
    if not _any(slope != 0) and _any(energy.residual(state).value != 0):
        warnings.warn(f"energy {name!r} {_CONSTANT}", stacklevel=2)


def _require_weight(name: str, weight: Tensor) -> None:
    """One that is learned may have become negative since it was given."""
    if weight.is_cpu and _any(weight < 0):
        raise InputError(
            f"energy {name!r} has a weight of {float(weight.min()):.3g}, expected one from 0 on; "
            "learn its logarithm"
        )


def _late(lead: torch.Size, device: torch.device) -> Tensor:
    """Half of the frames and batch elements, (*b, F), cut so that any distance crosses the cut."""
    late = torch.zeros(lead, dtype=torch.bool, device=device)
    for axis, size in enumerate(reversed(lead)):
        own = torch.arange(size, device=device) >= (size + 1) // 2
        late = late ^ own.reshape(-1, *[1] * axis)
    return late


def _unseen(energy: Energy[Any], state: State, like: Tensor) -> Tensor | None:
    """A direction in the shared blocks that the energy does not see; None where it sees all."""
    hidden = [
        (0.0 if name in energy.sees else 1.0, size) for name, size in state.shared_sizes.items()
    ]
    if not any(size and share for share, size in hidden):
        return None
    row = torch.cat([like.new_full((size,), share) for share, size in hidden])
    return row.expand_as(like)


def _along(
    name: str, energy: Energy[Any], state: State, step: Step
) -> tuple[Tensor | None, Tensor]:
    """Confidence of a residual, and the derivative of its values along a step, (*b, F, G, d)."""

    def rows(size: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        moved = state.retract(Step(size * step.frame, size * step.shared))
        before = _changes(moved)
        residual = energy.residual(moved)
        if _changes(moved) != before:
            raise InputError(
                f"energy {name!r} changes its state in place, on which other energies depend; "
                "make new tensors, as x + 1 instead of x += 1"
            )
        _require_residual(name, residual, step.frame)
        own = residual.confidence
        return residual.value, () if own is None else (own,)

    one = step.frame.new_tensor(1.0)
    moved: Any = torch.func.jvp(rows, (torch.zeros_like(one),), (one,), has_aux=True)
    _, slope, own = moved
    return own[0] if own else None, slope


def _changes(state: Any) -> list[int]:
    """How often each tensor that a state holds was written to."""
    held = getattr(state, "__dict__", {}).values()
    return [each._version for each in held if isinstance(each, Tensor) and not each.is_inference()]


def _require_kind(name: str, residual: object) -> Residual:
    if not isinstance(residual, Residual):
        raise InputError(
            f"energy {name!r} returned a {type(residual).__name__}, expected a Residual of values "
            "(*b, F, G, d)"
        )
    if not isinstance(residual.value, Tensor):
        raise InputError(
            f"energy {name!r} returned a Residual of a {type(residual.value).__name__}, expected "
            "a tensor (*b, F, G, d); use torch operations, so that it can be differentiated"
        )
    return residual


def _require_residual(name: str, residual: object, like: Tensor) -> None:
    values = _require_kind(name, residual)
    value, lead = values.value, tuple(like.shape[:-1])
    if tuple(value.shape[:-2]) != lead:
        raise InputError(
            f"energy {name!r} returned values {tuple(value.shape)}, expected (*b, F, G, d) of "
            f"(*b, F) = {lead}: a row for each frame, of G groups of d numbers"
        )
    if value.dtype != like.dtype:
        raise InputError(
            f"energy {name!r} returned {value.dtype} for unknowns of {like.dtype}; make its "
            "constants buffers, or the type of the unknowns"
        )
    _require_confidence(name, values)


def _require_confidence(name: str, residual: Residual) -> None:
    value, own = residual.value, residual.confidence
    if own is not None and not fits(own.shape, value.shape[:-1]):
        raise InputError(
            f"energy {name!r} has values {tuple(value.shape)} and confidence {tuple(own.shape)}; "
            "expected (*b, F, G, d) and one number a group, (*b, F, G)"
        )


def _any(mask: Tensor) -> bool:
    """Whether any is true; not asked inside of ``torch.func`` transforms, which cannot say."""
    inside = torch._C._functorch.is_functorch_wrapped_tensor(mask)
    return not inside and bool(mask.any())
