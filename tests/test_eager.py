"""A model that is compiled calls what solves, and does not trace it."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from perfcap.eager import eager
from perfcap.pipeline.pose_refiner import PoseRefiner
from perfcap.solve import Implicit, Objective, ResidualFunction, Vector, solve


class Found(nn.Module):
    """Solves for angles whose sines are a parameter."""

    def __init__(self) -> None:
        super().__init__()
        self.sines = nn.Parameter(torch.tensor([0.3, 0.2], dtype=torch.float64))

    def forward(self, factor: Tensor) -> Tensor:
        near = ResidualFunction(lambda x: torch.sin(x) - factor * self.sines)
        start = Vector(torch.zeros(2, dtype=torch.float64))
        found: Tensor = solve(Objective(near=near), start, adjoint=Implicit()).state.values
        return found


# the compiler looks at gradients of what solves return
@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor that is not a leaf")
def test_a_compiled_model_solves_as_it_would_without() -> None:
    """Steps were traced one by one: half a minute for two numbers."""
    model, factor = Found(), torch.tensor(2.0, dtype=torch.float64)
    values, slopes = [], []
    torch._dynamo.utils.counters.clear()
    compiled: Any = torch.compile(model, backend="eager")
    for each in (model, compiled):
        found = each(factor)
        values.append(found)
        slopes += torch.autograd.grad(found.sum(), model.sines)
    assert torch.equal(*values) and torch.equal(*slopes)
    assert torch._dynamo.utils.counters["stats"]["unique_graphs"] < 5  # without: dozens


def test_functions_stay_what_they_are() -> None:
    @eager
    def double(number: int, *, more: int = 0) -> int:
        """Twice."""
        return 2 * number + more

    assert (double(3, more=1), double.__name__, double.__doc__) == (7, "double", "Twice.")
    for function in (solve, PoseRefiner.forward):
        assert function.__wrapped__.__name__ == function.__name__


@pytest.mark.long
def test_the_compiler_is_not_loaded_with_perfcap() -> None:
    looked = "import sys, perfcap, perfcap.solve; print('torch._dynamo' in sys.modules)"
    command = [sys.executable, "-c", looked]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"
