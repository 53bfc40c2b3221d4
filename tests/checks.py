"""Checks that every energy must pass; one call a test."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from perfcap.geometry.plain import torch_only
from perfcap.solve import Coupling, Energy, Objective, State, Step, WindowEnergy
from perfcap.solve.assembly import assemble
from perfcap.solve.energy import seen_columns

_BLOCKS = ("curvature", "frame_gradient", "border", "shared_curvature", "shared_gradient")
_WINDOW = ("features", "jacobian")
Pick = Callable[[int], tuple[Energy, State]]


def check_energy(
    energy: Energy,
    state: State,
    *,
    atol: float = 1e-6,
    rtol: float = 1e-6,
    step: float = 1e-5,
    pick: Pick | None = None,
    inputs: Sequence[Tensor] = (),
) -> None:
    """Check an energy at a float64 state: shapes, value, derivatives, coupling, batch, twins.

    Args:
        energy: what to check.
        state: where; generic, so that no derivative vanishes by accident.
        atol: largest error of a Jacobian entry, beside ``rtol`` times the largest entry.
        rtol: see ``atol``.
        step: of the central differences, in tangent units.
        pick: ``pick(i)`` is the energy and the state of element i of the flattened batch alone;
            with it the batch is compared with a loop.
        inputs: leaf tensors that the energy must send a gradient to.

    Raises:
        AssertionError: naming the energy, and for a derivative the entry that is wrong.
    """
    check_shapes(energy, state)
    check_value(energy, state)
    check_coupling(energy, state)
    check_jacobian(energy, state, atol=atol, rtol=rtol, step=step)
    check_gradient(energy, state, step=step)
    check_twins(energy, state)
    if pick is not None:
        check_batch(energy, state, pick)
    if inputs:
        check_reaches(energy, state, inputs)


def check_shapes(energy: Energy, state: State) -> None:
    """Residual (*b, F, G, d), confidence that broadcasts to (*b, F, G), value (*b,)."""
    frames = state.coordinates().frame.shape[:-1]
    residual = energy.residual(state)
    shape = tuple(residual.value.shape)
    assert shape[:-2] == tuple(frames), (
        f"{_name(energy)}: residual has shape {shape}, expected {(*frames, 'G', 'd')}"
    )
    if residual.confidence is not None:
        confidence = tuple(residual.confidence.shape)
        joint = torch.broadcast_shapes(confidence, shape[:-1])
        assert joint == shape[:-1], (
            f"{_name(energy)}: confidence has shape {confidence}, expected to fit {shape[:-1]}"
        )
    value = tuple(energy(state).shape)
    assert value == tuple(frames[:-1]), (
        f"{_name(energy)}: value has shape {value}, expected the batch {tuple(frames[:-1])}"
    )


def check_value(energy: Energy, state: State) -> None:
    """``forward`` is weight times the sum of kernels of the residual, and so is ``linearize``'s."""
    residual = energy.residual(state)
    squared = residual.value.square().sum(-1)
    if residual.confidence is not None:
        squared = squared * residual.confidence
    expected = energy.weight * energy.kernel.value(squared).sum((-1, -2))
    _assert_close(energy, "forward(state)", energy(state), expected)
    if isinstance(energy, WindowEnergy):
        features, _ = energy.linearize_features(state)
        _assert_close(energy, "linearize_features(state)[0]", features, energy.features(state))
        return
    linear = energy.linearize(state)
    _assert_close(energy, "linearize(state).residual", linear.residual.value, residual.value)
    _assert_close(energy, "linearized cost", energy.cost(linear.residual), expected)


def check_coupling(energy: Energy, state: State) -> None:
    """Rows of a frame do not change when another frame moves, nor with undeclared shared ones."""
    assert isinstance(energy, WindowEnergy) == (energy.coupling is Coupling.WINDOW), (
        f"{_name(energy)}: coupling is {energy.coupling}; WINDOW is what WindowEnergy is for"
    )
    here = state.coordinates()
    before = _rows(energy, state)
    for frame in range(here.frame.shape[-2]):
        moved = _rows(energy, state.retract(_single_frame(here, frame)))
        change = (moved - before).abs().flatten(len(here.frame.shape) - 1).amax(-1)
        change[..., frame] = 0
        other = int(change.flatten(0, -2).amax(0).argmax()) if change.ndim > 1 else change.argmax()
        assert change.max() <= 1e-12 * (1 + before.abs().max()), (
            f"{_name(energy)}: rows of frame {other} change when frame {frame} moves, "
            "but the energy declares that each frame stands alone"
        )
    if here.shared.shape[-1] and not energy.sees:
        moved = _rows(energy, state.retract(Step(0 * here.frame, 0.1 + 0 * here.shared)))
        assert torch.allclose(moved, before, rtol=0, atol=1e-12), (
            f"{_name(energy)}: rows change with the shared unknowns, but does not name them in sees"
        )


def check_jacobian(
    energy: Energy, state: State, *, atol: float = 1e-6, rtol: float = 1e-6, step: float = 1e-5
) -> None:
    """Jacobian against central differences through ``retract``."""
    here = state.coordinates()
    if isinstance(energy, WindowEnergy):
        frame, shared = energy.linearize_features(state)[1], None
    else:
        linear = energy.linearize(state)
        frame, shared = linear.frame, linear.shared
    for column in range(state.frame_dim):
        tangent = torch.zeros_like(here.frame)
        tangent[..., column] = step
        numeric = _difference(energy, state, Step(tangent, 0 * here.shared), step)
        _assert_column(energy, f"unknown {column}", frame[..., column], numeric, atol, rtol)
    columns = torch.arange(here.shared.shape[-1])[seen_columns(state.shared_sizes, energy.sees)]
    assert (0 if shared is None else shared.shape[-1]) == len(columns), (
        f"{_name(energy)}: sees {energy.sees}, but linearize gives another shared Jacobian"
    )
    for column, unknown in enumerate(columns.tolist()):
        tangent = torch.zeros_like(here.shared)
        tangent[..., unknown] = step
        numeric = _difference(energy, state, Step(0 * here.frame, tangent), step)
        _assert_column(energy, f"shared unknown {column}", shared[..., column], numeric, atol, rtol)


def check_gradient(energy: Energy, state: State, *, step: float = 1e-5) -> None:
    """Automatic gradient of ``forward`` against central differences, along random directions."""
    here = state.coordinates()
    frame = torch.zeros_like(here.frame).requires_grad_()
    shared = torch.zeros_like(here.shared).requires_grad_()
    value = energy(state.retract(Step(frame, shared)))
    gradient = torch.autograd.grad(value.sum(), (frame, shared), allow_unused=True)
    random = torch.Generator().manual_seed(0)
    for _ in range(3):
        direction = [_normal_like(part, random) for part in (frame, shared)]
        slope = sum(
            (g * d).sum() for g, d in zip(gradient, direction, strict=True) if g is not None
        )
        after = energy(state.retract(Step(step * direction[0], step * direction[1])))
        before = energy(state.retract(Step(-step * direction[0], -step * direction[1])))
        numeric = ((after - before) / (2 * step)).sum().detach()
        error = abs(float(slope) - float(numeric))
        assert error <= 1e-5 * (abs(float(numeric)) + float(value.detach().sum())), (
            f"{_name(energy)}: gradient of forward along a random direction is {float(slope):.8g}, "
            f"central differences give {float(numeric):.8g}"
        )


def check_twins(energy: Energy, state: State) -> None:
    """What a solver gets from compiled loops is what torch alone computes, as on a card."""
    with torch.no_grad():
        own = assemble(Objective({"energy": energy}), state)
        with torch_only():
            other = assemble(Objective({"energy": energy}), state)
    parts = [(name, getattr(own, name), getattr(other, name)) for name in _BLOCKS]
    for one, two in zip(own.windows, other.windows, strict=True):
        parts += [(name, getattr(one, name), getattr(two, name)) for name in _WINDOW]
    for name, actual, expected in parts:
        size = float(expected.abs().max()) if expected.numel() else 0.0
        torch.testing.assert_close(
            actual,
            expected,
            rtol=0,
            atol=1e-9 * size,
            msg=lambda text, name=name: f"{_name(energy)}: {name} without kernels differs. {text}",
        )


def check_batch(energy: Energy, state: State, pick: Pick) -> None:
    """Every batch element equals the same element alone."""
    batch = state.coordinates().frame.shape[:-2]
    residual = energy.residual(state).value
    residual = residual.reshape(-1, *residual.shape[len(batch) :])
    values = energy(state).reshape(-1)
    for index in range(batch.numel()):
        single, alone = pick(index)
        own = single.residual(alone).value.reshape(residual.shape[1:])
        _assert_close(energy, f"residual of batch element {index}", residual[index], own)
        _assert_close(energy, f"value of batch element {index}", values[index], single(alone))


def check_reaches(energy: Energy, state: State, inputs: Sequence[Tensor]) -> None:
    """The energy sends a finite gradient that is not zero to each input."""
    gradients = torch.autograd.grad(energy(state).sum(), list(inputs), allow_unused=True)
    for index, gradient in enumerate(gradients):
        reached = gradient is not None and bool(gradient.isfinite().all() and gradient.any())
        assert reached, f"{_name(energy)}: no finite gradient reaches input {index}"


def _rows(energy: Energy, state: State) -> Tensor:
    """What is linearised frame by frame: residuals, or the features of a window energy."""
    if isinstance(energy, WindowEnergy):
        return energy.features(state)
    return energy.residual(state).value


def _difference(energy: Energy, state: State, move: Step, step: float) -> Tensor:
    after = _rows(energy, state.retract(move))
    before = _rows(energy, state.retract(Step(-move.frame, -move.shared)))
    return (after - before) / (2 * step)


def _assert_column(
    energy: Energy, unknown: str, closed: Tensor, numeric: Tensor, atol: float, rtol: float
) -> None:
    assert closed.shape == numeric.shape, (
        f"{_name(energy)}: Jacobian column of {unknown} has shape {tuple(closed.shape)}, "
        f"expected {tuple(numeric.shape)}"
    )
    closed, numeric = closed.detach(), numeric.detach()
    error = (closed - numeric).abs().nan_to_num(torch.inf)
    if bool((error <= atol + rtol * numeric.abs().max()).all()):
        return
    place = tuple(int(i) for i in torch.unravel_index(error.argmax(), error.shape))
    labels = "frame, entry" if isinstance(energy, WindowEnergy) else "frame, group, entry"
    raise AssertionError(
        f"{_name(energy)}: derivative of row [*batch, {labels}] = {list(place)} in {unknown} is "
        f"{float(closed[place]):.8g}, central differences give {float(numeric[place]):.8g} "
        f"({int((error > atol + rtol * numeric.abs().max()).sum())} entries of this column are off)"
    )


def _assert_close(energy: Energy, what: str, actual: Tensor, expected: Tensor) -> None:
    torch.testing.assert_close(
        actual,
        expected,
        rtol=1e-9,
        atol=1e-10,
        msg=lambda text: f"{_name(energy)}: {what} is wrong. {text}",
    )


def _single_frame(here: Step, frame: int) -> Step:
    random = torch.Generator().manual_seed(frame)
    move = torch.zeros_like(here.frame)
    move[..., frame, :] = 0.1 * _normal_like(move[..., frame, :], random)
    return Step(move, torch.zeros_like(here.shared))


def _normal_like(values: Tensor, random: torch.Generator) -> Tensor:
    return torch.randn(values.shape, generator=random, dtype=values.dtype)


def _name(energy: Energy) -> str:
    return type(energy).__name__
