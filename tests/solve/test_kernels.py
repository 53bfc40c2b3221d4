"""Robust kernels."""

from __future__ import annotations

import pytest
import torch

from perfcap.errors import InputError
from perfcap.solve import GemanMcClure, Huber, Quadratic

KERNELS = [Quadratic(), Huber(0.5), GemanMcClure(0.5)]


@pytest.mark.parametrize("kernel", KERNELS)
def test_slope_is_the_derivative(kernel):
    squared = torch.logspace(-8, 6, 200, dtype=torch.float64).requires_grad_()
    (expected,) = torch.autograd.grad(kernel.value(squared).sum(), squared)
    torch.testing.assert_close(kernel.slope(squared.detach()), expected, rtol=1e-8, atol=1e-20)


@pytest.mark.parametrize("kernel", KERNELS)
def test_small_residuals_count_in_full(kernel):
    zero = torch.zeros(3, dtype=torch.float64).requires_grad_()
    assert (kernel.value(zero) == 0).all()
    assert (kernel.slope(zero) == 1).all()
    (gradient,) = torch.autograd.grad(kernel.value(zero).sum(), zero)
    assert (gradient == 1).all()


@pytest.mark.parametrize("kernel", KERNELS)
def test_cost_rises_and_its_slope_falls(kernel):
    squared = torch.linspace(0, 100, 500, dtype=torch.float64)
    assert (kernel.value(squared).diff() > 0).all()
    assert (kernel.slope(squared).diff() <= 0).all()


def test_scales_are_residuals():
    assert Huber(2.0).slope(torch.tensor(4.0)) == 1
    assert Huber(2.0).slope(torch.tensor(16.0)) == 0.5
    assert GemanMcClure(2.0).slope(torch.tensor(4.0)) == 0.25
    assert GemanMcClure(2.0).value(torch.tensor(1e12)) == pytest.approx(4.0)


@pytest.mark.parametrize("kind", [Huber, GemanMcClure])
@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan")])
def test_scales_that_are_none_are_named(kind, scale):
    with pytest.raises(InputError, match=f"scale of {kind.__name__} is"):
        kind(scale)
