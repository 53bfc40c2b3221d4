"""When compiled kernels may read a tensor's memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch
from torch import Tensor
from torch.autograd import forward_ad

_FLOATS = (torch.float32, torch.float64)
_PLAIN_TYPES = (Tensor, torch.nn.Parameter)
_kernels = ContextVar("_kernels", default=True)


@contextmanager
def torch_only() -> Iterator[None]:
    """Within this block no compiled kernel runs: every computation is torch's.

    For looking at intermediate tensors, and for telling whether a kernel is to blame. Results
    agree but for rounding; a window solve takes two to three times as long. Holds for this thread
    and what it awaits.
    """
    before = _kernels.set(False)
    try:
        yield
    finally:
        _kernels.reset(before)


def is_plain(*tensors: Tensor | None) -> bool:
    """Whether all tensors are numbers in main memory, of one float type, and nothing watches them.

    Then a compiled kernel may stand in for torch operations. False on a GPU, where gradients are
    recorded, inside ``torch.func`` transforms and forward-mode differentiation, while torch
    compiles or traces, and within ``torch_only``. None is skipped.
    """
    if not _kernels.get() or torch.compiler.is_compiling():
        return False
    if torch._C._functorch.maybe_current_level() is not None:
        return False  # what is made inside of a transform has no memory, not even of constants
    recorded, dtype = torch.is_grad_enabled(), None
    tangents = forward_ad._current_level >= 0  # outside of its levels nothing has a tangent
    for tensor in tensors:  # a loop, as this is asked a dozen times a step
        if tensor is None:
            continue
        dtype = dtype or tensor.dtype
        if (
            tensor.dtype is not dtype
            or type(tensor) not in _PLAIN_TYPES
            or not tensor.is_cpu
            or (recorded and tensor.requires_grad)
            or torch._C._functorch.is_functorch_wrapped_tensor(tensor)
            or (tangents and _has_tangent(tensor))
        ):
            return False
    return dtype in _FLOATS


def is_readable(tensor: Tensor) -> bool:
    """Whether a check may look at a tensor's numbers, on whatever device they are.

    False inside ``torch.func`` transforms, where torch compiles or traces, and of tensors that hold
    none.
    """
    return (
        type(tensor) in _PLAIN_TYPES
        and not tensor.is_meta
        and not torch.compiler.is_compiling()
        and torch._C._functorch.maybe_current_level() is None
        and not torch._C._functorch.is_functorch_wrapped_tensor(tensor)
    )


def goes_forwards(*tensors: Tensor) -> bool:
    """Whether a ``torch.func`` transform is under way, or tensors have a tangent."""
    tangents = forward_ad._current_level >= 0
    inside = torch._C._functorch.maybe_current_level() is not None
    return inside or (tangents and any(map(_has_tangent, tensors)))


def _has_tangent(tensor: Tensor) -> bool:
    return forward_ad.unpack_dual(tensor).tangent is not None  # type: ignore[no-untyped-call]
