"""Named blocks of shared unknowns: derivatives land where the state has them."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import torch
from checks import check_energy
from torch import Tensor

from perfcap.solve import Energy, Objective, Residual, Step
from perfcap.solve.assembly import assemble
from perfcap.solve.stationarity import gradient, hessian


@dataclass(frozen=True)
class Blocks:
    """A frame's number and three named shared blocks, in the order given."""

    frame: Tensor
    parts: dict[str, Tensor]

    frame_dim = 1

    @property
    def shared_sizes(self):
        return {name: part.shape[-1] for name, part in self.parts.items()}

    def retract(self, step):
        moved = torch.split(step.shared, list(self.shared_sizes.values()), -1)
        parts = {n: p + m for (n, p), m in zip(self.parts.items(), moved, strict=True)}
        return Blocks(self.frame + step.frame, parts)

    def coordinates(self):
        return Step(self.frame, torch.cat(list(self.parts.values()), -1))


class Blockwise(Energy):
    """Couples the blocks it sees with each other and with the frames."""

    def __init__(self, sees):
        super().__init__(2.0)
        self.sees = tuple(sees)

    def residual(self, state):
        seen = [part for name, part in state.parts.items() if name in self.sees]
        rows = torch.cat(seen).sin() * state.frame  # F S'
        return Residual(torch.cat((rows, state.frame + rows.sum(-1, True)), -1).unsqueeze(-1))


@pytest.mark.parametrize(
    "sees", [("a",), ("b",), ("a", "c"), ("c", "a"), ("a", "b", "c", "absent")]
)
@pytest.mark.parametrize("order", ["abc", "cba", "bca"])
def test_blocks_land_where_the_state_has_them(sees, order):
    """Against the same problem differentiated as one vector."""
    sizes = {"a": 2, "b": 1, "c": 3}
    random = torch.Generator().manual_seed(0)
    parts = {n: torch.randn(sizes[n], generator=random, dtype=torch.float64) for n in order}
    state = Blocks(torch.randn(4, 1, generator=random, dtype=torch.float64), parts)
    energy = Blockwise(sees)
    check_energy(energy, state)
    found = assemble(Objective(one=energy), state)

    def rows(step):
        return energy.residual(state.retract(Step(step[:4, None], step[4:]))).value.flatten()

    zero = torch.zeros(10, dtype=torch.float64)
    jacobian = torch.func.jacfwd(rows)(zero)
    whole = 2.0 * jacobian.mT @ jacobian
    assert torch.allclose(found.shared_curvature[0], whole[4:, 4:], atol=1e-12)
    assert torch.allclose(found.border[0, :, 0], whole[:4, 4:], atol=1e-12)
    assert torch.allclose(found.gradient()[0], 2.0 * jacobian.mT @ rows(zero), atol=1e-12)

    def total(step):
        return energy(state.retract(Step(step[:4, None], step[4:])))

    exact = 0.5 * torch.func.hessian(total)(zero)
    layout = found.layout
    bent = hessian(Objective(one=energy), state, found)
    assert torch.allclose(bent.shared_curvature[0], exact[4:, 4:], atol=1e-9)
    assert torch.allclose(bent.border[0, :, 0], exact[:4, 4:], atol=1e-9)
    assert torch.allclose(
        gradient(Objective(one=energy), state, layout)[0], found.gradient()[0], atol=1e-12
    )
