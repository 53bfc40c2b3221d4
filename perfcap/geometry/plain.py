"""When compiled kernels may read a tensor's memory."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.autograd import forward_ad

_FLOATS = (torch.float32, torch.float64)
_PLAIN_TYPES = (Tensor, torch.nn.Parameter)


def is_plain(*tensors: Tensor | None) -> bool:
    """Whether all tensors are numbers in main memory, of one float type, and nothing watches them.

    Then a compiled kernel may stand in for torch operations. False on a GPU, where gradients are
    recorded, inside ``torch.func`` transforms and forward-mode differentiation, and while torch
    compiles or traces. None is skipped.
    """
    given = [tensor for tensor in tensors if tensor is not None]
    dtype, recorded = given[0].dtype, torch.is_grad_enabled()
    tangents = forward_ad._current_level >= 0  # outside of its levels nothing has a tangent
    return (
        dtype in _FLOATS
        and not torch.compiler.is_compiling()
        and all(
            tensor.dtype == dtype
            and tensor.is_cpu
            and type(tensor) in _PLAIN_TYPES
            and not (recorded and tensor.requires_grad)
            and not torch._C._functorch.is_functorch_wrapped_tensor(tensor)
            and not (tangents and _has_tangent(tensor))
            for tensor in given
        )
    )


def _has_tangent(tensor: Tensor) -> bool:
    return forward_ad.unpack_dual(tensor).tangent is not None  # type: ignore[no-untyped-call]
