"""Linear shape: recovery of coefficients, principal components, gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from perfcap.actor.shape_space import ShapeSpace
from perfcap.errors import InputError


def space(components: int = 3, points: int = 12) -> ShapeSpace:
    random = torch.Generator().manual_seed(1)
    mean = torch.randn(points, 3, generator=random, dtype=torch.float64)
    basis = torch.randn(components, points, 3, generator=random, dtype=torch.float64)
    return ShapeSpace(mean, basis)


def test_coefficients_are_recovered_for_a_batch() -> None:
    linear = space()
    shape = torch.tensor([[0.3, -1.0, 2.0], [0.0, 0.5, -0.5]], dtype=torch.float64)
    assert torch.allclose(linear.coefficients(linear(shape), ridge=1e-12), shape, atol=1e-9)


def test_fewer_coefficients_leave_the_rest_at_zero() -> None:
    linear = space()
    short, full = torch.tensor([0.7]).double(), torch.tensor([0.7, 0.0, 0.0]).double()
    assert torch.equal(linear(short), linear(full))
    assert torch.equal(linear(torch.zeros(0).double()), linear.mean)


def test_deviation_scales_the_basis() -> None:
    linear = space()
    scaled = ShapeSpace(linear.mean, linear.basis, torch.tensor([2.0, 1.0, 0.5]).double())
    expected = linear(torch.tensor([2.0, 1.0, 0.5]).double())
    assert torch.allclose(scaled(torch.ones(3).double()), expected)


def test_is_differentiable_in_shape() -> None:
    linear = space()
    shape = torch.zeros(2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(linear, shape)


def test_principal_components_of_a_linear_population() -> None:
    linear = space(components=2, points=30)
    random = np.random.default_rng(3)
    shapes = torch.tensor(random.normal(size=(200, 2)))
    samples = linear(shapes).numpy()
    found = ShapeSpace.from_samples(samples, 2)
    rebuilt = found(found.coefficients(torch.tensor(samples), ridge=0.0))
    assert torch.allclose(rebuilt, torch.tensor(samples), atol=1e-9)
    deviations = found.coefficients(torch.tensor(samples), ridge=0.0).std(0)
    assert torch.allclose(deviations, torch.ones(2).double(), atol=1e-9)
    assert found.basis[0].norm() > found.basis[1].norm()


@pytest.mark.parametrize("components", [0, 5])
def test_needs_more_samples_than_components(components: int) -> None:
    with pytest.raises(InputError, match="more samples"):
        ShapeSpace.from_samples(np.zeros((5, 4, 3)), components)


def test_refuses_what_does_not_fit() -> None:
    linear = space()
    with pytest.raises(InputError, match="4 coefficients"):
        linear(torch.zeros(4).double())
    with pytest.raises(InputError, match="expected"):
        ShapeSpace(linear.mean, linear.basis[:, :3])
    with pytest.raises(InputError, match="positive"):
        ShapeSpace(linear.mean, linear.basis, torch.zeros(3).double())
