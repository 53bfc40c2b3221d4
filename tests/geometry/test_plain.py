"""Compiled kernels stand in for torch only where nobody can tell."""

import pytest
import torch
from torch import Tensor
from torch.autograd import forward_ad

from perfcap.geometry.plain import is_plain, torch_only
from perfcap.geometry.product import multiply_views


def test_numbers_are_plain() -> None:
    for dtype in (torch.float32, torch.float64):
        assert is_plain(torch.zeros(3, dtype=dtype), None, torch.ones(1, dtype=dtype))


def test_other_numbers_are_not() -> None:
    assert not is_plain(torch.zeros(3, dtype=torch.float16))
    assert not is_plain(torch.zeros(3, dtype=torch.long))
    assert not is_plain(torch.zeros(3), torch.zeros(3, dtype=torch.float64))
    assert not is_plain(torch.zeros(3, device="meta"))


def test_recorded_gradients_are_seen() -> None:
    leaf = torch.nn.Parameter(torch.zeros(3))
    assert not is_plain(leaf)
    assert not is_plain(torch.zeros(3), 2 * leaf)
    with torch.no_grad():
        assert is_plain(leaf, 2 * leaf)
    assert is_plain(leaf.detach())


def test_kernels_can_be_left_out() -> None:
    with torch_only():
        assert not is_plain(torch.zeros(3))
    assert is_plain(torch.zeros(3))


def test_forward_mode_is_seen() -> None:
    with forward_ad.dual_level():
        assert not is_plain(forward_ad.make_dual(torch.zeros(3), torch.ones(3)))
        assert is_plain(torch.zeros(3))


@pytest.mark.parametrize("transform", ["grad", "vmap", "jvp", "jacrev", "jacfwd"])
def test_function_transforms_are_seen(transform: str) -> None:
    seen = []

    def watched(x: Tensor) -> Tensor:
        seen.append(is_plain(x))
        seen.append(is_plain(torch.zeros(3)))  # a kernel's result would have no memory
        return x.sum()

    point = torch.ones(3)
    if transform == "jvp":
        torch.func.jvp(watched, (point,), (point,))
    else:
        getattr(torch.func, transform)(watched)(point)
    assert seen == [False, False]


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("batch", [(), (2, 5)])
def test_product_of_views_is_the_product(dtype: torch.dtype, batch: tuple[int, ...]) -> None:
    random = torch.Generator().manual_seed(1)
    left = torch.randn(*batch, 3, 4, 2, 3, generator=random, dtype=dtype)
    right = torch.randn(*batch, 4, 3, 7, generator=random, dtype=dtype)
    found, expected = multiply_views(left, right), left @ right.unsqueeze(-4)
    assert found.dtype == dtype
    assert (found - expected).abs().max() < 10 * torch.finfo(dtype).eps
    assert torch.allclose(multiply_views(left.requires_grad_(), right), expected, atol=1e-5)
    shared = multiply_views(left[..., :1, :, :, :].detach().mT.contiguous().mT, right)
    assert torch.allclose(shared, expected[..., :1, :, :, :], atol=1e-5)


def test_products_that_compiled_loops_cannot_take_are_torch_s():
    """They read beyond the end of arrays."""
    left = torch.rand(2, 2, 6, 2, 3)
    one = torch.rand(2, 1, 3, 4)
    assert torch.allclose(multiply_views(left, one), left @ one.unsqueeze(-4))
    with pytest.raises(RuntimeError):
        multiply_views(left, torch.rand(2, 3, 3, 4))
