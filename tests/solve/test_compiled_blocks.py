"""Compiled loops of the solver against their twins in torch, which run where gradients are."""

from __future__ import annotations

import pytest
import torch
from toy import toy

from perfcap.solve.assembly import add_rows, assemble
from perfcap.solve.factorization import factorize
from perfcap.solve.frame_factors import factorize_frames

SIZES = [(1, 1), (4, 4), (9, 10), (17, 3), (24, 33), (33, 34)]
ROUNDING = {torch.float32: 1e-4, torch.float64: 1e-13}


def normal(*shape, dtype=torch.float64, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed)).to(dtype)


@pytest.mark.parametrize("dtype", ROUNDING)
@pytest.mark.parametrize(("groups", "entries"), [(0, 2), (1, 1), (5, 3), (16, 2)])
@pytest.mark.parametrize(("dim", "constant"), [(1, False), (7, True), (33, False)])
def test_rows_add_up_to_the_same_blocks(dtype, groups, entries, dim, constant):
    jacobian = normal(2, 3, groups, entries, dim, dtype=dtype)
    jacobian = jacobian * (normal(*jacobian.shape[:-2], 1, dim, dtype=dtype, seed=1) > 0)
    residual = normal(2, 3, groups, entries, dtype=dtype, seed=2)
    weight = normal(2, 3, groups, dtype=dtype, seed=3).abs()
    if constant:
        jacobian = jacobian[:1, :1].expand_as(jacobian)
    sums = []
    for watched in (False, True):
        blocks = torch.ones(2, 3, dim, dim, dtype=dtype), torch.ones(2, 3, dim, dtype=dtype)
        rows = jacobian.clone().requires_grad_() if watched else jacobian
        add_rows(rows, residual, weight, *blocks)
        sums.append([block.detach() for block in blocks])
    for compiled, plain in zip(*sums, strict=True):
        torch.testing.assert_close(compiled, plain, rtol=ROUNDING[dtype], atol=ROUNDING[dtype])


@pytest.mark.parametrize("dtype", ROUNDING)
@pytest.mark.parametrize(("dim", "features"), [*SIZES, (5, 0)])
def test_factors_of_frames_are_the_same(dtype, dim, features):
    root = normal(2, 3, dim, dim, dtype=dtype)
    curvature = 1e-2 * root @ root.mT
    jacobian = normal(2, 3, features, dim, dtype=dtype, seed=1)
    jacobian = jacobian * (normal(features, dim, dtype=dtype, seed=2) > 0)
    damping = torch.full((2, 3, dim), 0.1, dtype=dtype)
    compiled = factorize_frames(curvature, damping, jacobian)
    plain = factorize_frames(curvature.clone().requires_grad_(), damping, jacobian)
    for own, other in zip(compiled[:3], plain[:3], strict=True):
        bound = ROUNDING[dtype] * (1 + float(other.detach().abs().sum()))
        torch.testing.assert_close(own, other.detach(), rtol=0, atol=bound)
    assert compiled[3].all() and plain[3].all()


@pytest.mark.parametrize("dtype", ROUNDING)
@pytest.mark.parametrize("data", [1e-6, 1.0, 1e3])
def test_orthogonal_features_have_the_same_factors(dtype, data):
    turn = torch.linalg.qr(normal(2, 3, 5, 4, dtype=dtype)).Q
    jacobian = torch.zeros(2, 3, 9, 8, dtype=dtype)
    jacobian[..., :4, :4] = torch.diag(torch.tensor([3.0, 0.5, 7.0, 1.0], dtype=dtype))
    jacobian[..., 4:, 4:] = 2 * turn
    root = normal(2, 3, 8, 8, dtype=dtype, seed=1)
    curvature, damping = data * root @ root.mT, torch.full((2, 3, 8), 0.1 * data, dtype=dtype)
    compiled = factorize_frames(curvature, damping, jacobian)
    plain = factorize_frames(curvature.clone().requires_grad_(), damping, jacobian)
    for own, other in zip(compiled[:3], plain[:3], strict=True):
        bound = ROUNDING[dtype] * max(1.0, float(other.detach().abs().max()))
        torch.testing.assert_close(own, other.detach(), rtol=0, atol=bound)
    assert compiled[3].all()


@pytest.mark.parametrize("kind", [{"windows": 1}, {"windows": 2}, {"windows": 2, "data": 1e-6}])
def test_newton_steps_are_the_same(kind, monkeypatch):
    objective, state = toy(batch=(2,), **kind)
    equations = assemble(objective, state)
    damping = torch.full_like(equations.gradient(), 1e-4 * kind.get("data", 1.0))
    compiled = factorize(equations, damping)
    step = compiled.newton_step(equations)
    monkeypatch.setattr("perfcap.solve.factorization.is_plain", lambda *_: False)
    plain = factorize(equations, damping)
    twin = plain.newton_step(equations)
    torch.testing.assert_close(step, twin, rtol=0, atol=1e-9 * float(twin.abs().max()))
    roots = compiled.window.cholesky, plain.window.cholesky
    torch.testing.assert_close(*(root.tril() for root in roots), rtol=1e-9, atol=1e-12)


def test_small_defects_keep_their_digits():
    jacobian = 1e3 * torch.eye(6, dtype=torch.float64).expand(1, 2, 6, 6)
    curvature = 1e-6 * torch.eye(6, dtype=torch.float64).expand(1, 2, 6, 6)
    damping = torch.zeros(1, 2, 6, dtype=torch.float64)
    defect = factorize_frames(curvature, damping, jacobian)[2]
    exact = 1e-12 / (1 + 1e-12) * torch.eye(6, dtype=torch.float64)
    torch.testing.assert_close(defect, exact.expand_as(defect), rtol=1e-9, atol=1e-24)


@pytest.mark.usefixtures("both_twins")
def test_frames_that_are_not_positive_definite_are_marked_and_finite():
    curvature = torch.eye(5, dtype=torch.float64).repeat(1, 4, 1, 1)
    curvature[0, 1, 3, 3] = -2
    curvature[0, 2, 2, 2] = torch.nan
    jacobian, damping = normal(1, 4, 3, 5), torch.zeros(1, 4, 5, dtype=torch.float64)
    damping[0, 3, 0] = torch.inf
    *parts, valid = factorize_frames(curvature, damping, 0.1 * jacobian)
    assert valid.tolist() == [[True, False, False, False]]
    assert all(part.isfinite().all() for part in parts)
