"""When compiled kernels may read a tensor's memory."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.autograd import forward_ad

_FLOATS = (torch.float32, torch.float64)


def is_plain(*tensors: Tensor | None) -> bool:
    """Whether all tensors are numbers in main memory, of one float type, and nothing watches them.

    Then a compiled kernel may stand in for torch operations. False on a GPU, where gradients are
    recorded, inside ``torch.func`` transforms and forward-mode differentiation, and while torch
    compiles or traces. None is skipped.
    """
    given = [tensor for tensor in tensors if tensor is not None]
    dtype = given[0].dtype
    return (
        dtype in _FLOATS
        and not torch.compiler.is_compiling()
        and all(tensor.dtype == dtype and _is_plain(tensor) for tensor in given)
    )


def _is_plain(tensor: Tensor) -> bool:
    return (
        tensor.is_cpu
        and type(tensor) in (Tensor, torch.nn.Parameter)
        and not (tensor.requires_grad and torch.is_grad_enabled())
        and not torch._C._functorch.is_functorch_wrapped_tensor(tensor)
        and forward_ad.unpack_dual(tensor).tangent is None  # type: ignore[no-untyped-call]
    )
