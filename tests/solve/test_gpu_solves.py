"""Solves on a graphics card against those on the CPU, and how often the host waits for one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from block_toy import Chain, StiffChain, block_toy
from torch import Tensor
from torch.overrides import TorchFunctionMode
from toy import Frames, toy

from perfcap.geometry.plain import torch_only
from perfcap.solve import Bounds, Implicit, LevenbergMarquardt, Status, Step, TruncatedNewton, solve

KINDS = {
    "frames only": {"windows": 0},
    "windows": {"windows": 2, "frames": 20, "data": 1e-3, "batch": (3,)},
    "shared": {"windows": 1, "shared": 2},
}
METHOD = LevenbergMarquardt(100, 1e-12)
needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
READS = {Tensor.__bool__, Tensor.__int__, Tensor.__float__, Tensor.item, Tensor.tolist}
READS |= {Tensor.nonzero, torch.nonzero}  # sizes that depend on values


def on(device: str, state: Frames) -> Frames:
    return Frames(state.frame.to(device), state.shared.to(device))


def box(state: Frames) -> Bounds:
    frame, shared = (torch.full_like(x[..., 0, :], 0.3) for x in (state.frame, state.frame))
    free = torch.full_like(state.shared, torch.inf)
    return Bounds(Step(-frame.unsqueeze(-2), -free), Step(shared.unsqueeze(-2), free))


@pytest.mark.gpu
@needs_cuda
@pytest.mark.parametrize("kind", KINDS)
def test_a_gpu_solves_the_same(kind: str) -> None:
    objective, state = toy(**KINDS[kind])
    plain = solve(objective, state, METHOD, box(state))
    there = on("cuda", state)
    found = solve(objective.to("cuda"), there, METHOD, box(there))
    assert found.state.frame.is_cuda
    assert (found.status == Status.CONVERGED).all()
    torch.testing.assert_close(found.state.frame.cpu(), plain.state.frame, rtol=0, atol=1e-6)
    torch.testing.assert_close(found.energy.cpu(), plain.energy, rtol=1e-9, atol=1e-12)


@pytest.mark.gpu
@needs_cuda
@pytest.mark.parametrize("kind", KINDS)
def test_gradients_through_a_solve_are_the_same_on_a_gpu(kind: str) -> None:
    slopes = []
    for device in ("cpu", "cuda"):
        objective, state = toy(**KINDS[kind])
        objective, start = objective.to(device), on(device, state)
        target = next(b for n, b in objective.named_buffers() if n.endswith("target"))
        target.requires_grad_()
        found = solve(objective, start, METHOD, box(start), adjoint=Implicit())
        weight = torch.linspace(-1, 1, found.state.frame.numel(), dtype=torch.float64)
        loss = (found.state.frame.flatten() * weight.to(device)).sum()
        slopes.append(torch.autograd.grad(loss, target)[0].cpu())
    torch.testing.assert_close(slopes[1], slopes[0], rtol=1e-5, atol=1e-7)


class _Reads(TorchFunctionMode):
    """Counts what brings a number to the host."""

    count = 0

    def __torch_function__(
        self, func: Callable[..., Any], types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        self.count += func in READS
        return func(*args, **(kwargs or {}))


def reads_of(kind: str, bounded: bool) -> float:
    """Of a step in torch, beside those of a solve's beginning and end."""
    objective, state = toy(**KINDS[kind])
    counts = []
    for steps in (2, 6):
        with torch_only(), _Reads() as reads:
            method = LevenbergMarquardt(steps, 1e-12, damping=10)
            solve(objective, state, method, box(state) if bounded else None)
        counts.append(reads.count)
    return (counts[1] - counts[0]) / 4


def test_the_host_waits_thrice_a_step_without_bounds() -> None:
    """For what came of the step, whether its equations are finite, and (on a CPU) its factors."""
    assert 2 <= reads_of("frames only", bounded=False) <= 3
    assert reads_of("windows", bounded=False) <= 4


def test_bounds_make_the_host_wait_a_few_times_more() -> None:
    assert reads_of("windows", bounded=True) <= 24


@pytest.mark.parametrize("chain", [Chain, StiffChain])
def test_conjugate_gradients_make_the_host_wait_once_a_round(chain: type[Chain]) -> None:
    """And for the same as other steps, and whether a step is likely the last."""
    objective, state = block_toy(chain=chain, seed=10)
    counts = []
    for steps in (2, 6):
        with torch_only(), _Reads() as reads:
            solve(objective, state, TruncatedNewton(steps, 0.0, damping=1e-3, max_rounds=2))
        counts.append(reads.count)
    assert 3 <= (counts[1] - counts[0]) / 4 <= 5
