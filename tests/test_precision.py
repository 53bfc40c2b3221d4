"""What a network is computed with reaches no solve."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Thread
from typing import Any

import pytest
import torch
from torch import Tensor

from perfcap.precision import own_precision
from perfcap.solve import Implicit, Objective, ResidualFunction, Vector, solve

BACKENDS: Any = torch.backends
PRODUCTS = (BACKENDS.cuda.matmul, BACKENDS.mkldnn.matmul)


def settings() -> list[str]:
    return [products.fp32_precision for products in PRODUCTS]


@pytest.fixture(autouse=True)
def restored() -> Iterator[None]:
    before, every = settings(), BACKENDS.fp32_precision
    yield
    BACKENDS.fp32_precision = every
    for products, was in zip(PRODUCTS, before, strict=True):
        products.fp32_precision = was


def test_rounded_products_do_not_reach_a_solve() -> None:
    """Lines of a solve were rounded to bfloat16: it stalled, and had a gradient of zero."""
    seen = set()
    leaf = torch.tensor([1.0, 2.0], dtype=torch.float32, requires_grad=True)
    matrix = torch.tensor([[1.0, 0.0], [0.1, 1.0]], dtype=torch.float32)

    def residuals(x: Tensor) -> Tensor:
        seen.update(settings())
        return x @ matrix - leaf

    torch.set_float32_matmul_precision("medium")
    start = Vector(torch.zeros(2, dtype=torch.float32))
    solution = solve(Objective(near=ResidualFunction(residuals)), start, adjoint=Implicit())
    assert seen <= {"ieee", "none"}
    assert settings() == ["tf32", "bf16"]
    (gradient,) = torch.autograd.grad(solution.state.values.sum(), leaf)
    torch.testing.assert_close(gradient, torch.tensor([1.0, 0.9]).float())


def test_settings_come_back_with_the_last_thread() -> None:
    def other() -> None:
        with own_precision("cpu"):
            pass

    torch.set_float32_matmul_precision("high")
    with own_precision("cpu"):
        thread = Thread(target=other)
        thread.start()
        thread.join()
        with own_precision("cpu"):
            assert settings() == ["ieee", "ieee"]
        assert settings() == ["ieee", "ieee"]
    assert settings() == ["tf32", "tf32"]


def test_the_setting_of_all_operations_is_followed_again() -> None:
    for products in PRODUCTS:
        products.fp32_precision = "none"
    BACKENDS.fp32_precision = "bf16"
    with own_precision("cpu"):
        assert BACKENDS.mkldnn.matmul.fp32_precision == "ieee"
    assert BACKENDS.mkldnn.matmul.fp32_precision == "bf16"
    BACKENDS.fp32_precision = "ieee"
    assert BACKENDS.mkldnn.matmul.fp32_precision in ("ieee", "none")
