"""A device that is no CPU, on the CPU: what mixes devices fails on it as on a graphics card.

``CARD`` holds tensors that compute on the CPU and say that they do not: they refuse other tensors
of the CPU as operands, and ``numpy`` and compiled loops cannot read them. So tests show on any
machine whether code follows the device of what it is given. Numbers of a real card differ in their
last bits, and its random generators, limits and speed are its own: tests marked ``gpu`` use one,
and where there is one, ``CARD`` is that.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils import backend_registration
from torch.utils._pytree import tree_leaves, tree_map

aten = torch.ops.aten

# Operations whose indices, or whose source, may be tensors of the CPU.
_MIXED = {
    aten._to_copy.default,
    aten.copy_.default,
    aten.index.Tensor,
    aten.index_put.default,
    aten.index_put_.default,
    aten._index_put_impl_.default,
}


class _Backend(backend_registration._DummyBackendModule):
    def get_amp_supported_dtype(self) -> list[torch.dtype]:
        return [torch.float16, torch.bfloat16]


_REAL = torch.cuda.is_available()  # whose gradients fail in a process that pretends another
if not _REAL:
    backend_registration._setup_privateuseone_for_python_backend("card", _Backend())
CARD = torch.device("cuda" if _REAL else "card", 0)


class CardTensor(Tensor):
    """A tensor of the device, around one of the CPU."""

    held: Tensor
    __torch_function__ = torch._C._disabled_torch_function_impl  # methods keep the class

    @staticmethod
    def __new__(cls, held: Tensor, requires_grad: bool = False) -> CardTensor:
        made: CardTensor = torch.Tensor._make_wrapper_subclass(
            cls,
            held.size(),
            **({"strides": held.stride()} if held.layout == torch.strided else {}),
            dtype=held.dtype,
            device=CARD,
            requires_grad=requires_grad,
        )
        made.held = held
        return made

    def __repr__(self, **_: Any) -> str:
        return f"CardTensor({self.detach().cpu()!r})"

    def __deepcopy__(self, memo: dict[int, Any]) -> Tensor:
        return self.detach().clone().requires_grad_(self.requires_grad)

    def tolist(self) -> Any:
        return self.detach().cpu().tolist()

    def numpy(self, *, force: bool = False) -> np.ndarray:
        if not force:
            raise TypeError("can't convert card:0 device type tensor to numpy")
        return self.detach().cpu().numpy()

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        return self.numpy()

    @classmethod
    def __torch_dispatch__(
        cls, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        return _compute(func, args, kwargs or {})


def _compute(func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Run an operation on what the tensors hold."""
    tensors = [each for each in tree_leaves((args, kwargs)) if isinstance(each, Tensor)]
    theirs = [each for each in tensors if isinstance(each, CardTensor)]
    # numbers without dimensions may come from the CPU, as on a card
    others = [each for each in tensors if not isinstance(each, CardTensor) and each.dim()]
    of_card = isinstance(args[0], CardTensor) if func in _MIXED else not others
    if not of_card and func not in (aten.copy_.default, aten._to_copy.default):
        raise RuntimeError(f"{func}: expected all tensors to be on the same device, card and cpu")
    device = kwargs.get("device")
    if device is not None:
        of_card = torch.device(device).type == CARD.type
        kwargs = {**kwargs, "device": torch.device("cpu")}
    args, kwargs = tree_map(_held, (args, kwargs))
    made = func(*args, **kwargs)
    known = {id(each.held): each for each in theirs}  # what changes in place stays itself
    if not of_card:
        return made

    def held_again(each: Any) -> Any:
        if not isinstance(each, Tensor) or isinstance(each, CardTensor):
            return each
        return known[id(each)] if id(each) in known else CardTensor(each)

    return tree_map(held_again, made)


def _held(value: Any) -> Any:
    return value.held if isinstance(value, CardTensor) else value


def _make(operation: Any, *args: Any, **kwargs: Any) -> Tensor:
    """What makes a tensor of no other."""
    return CardTensor(operation(*args, **{**kwargs, "device": torch.device("cpu")}))


def _copy_from(source: Tensor, target: Tensor, non_blocking: bool = False) -> Tensor:
    _held(target).copy_(_held(source))
    return target


if not _REAL:
    # what is called before there is a tensor of the device to dispatch on
    _library = torch.library.Library("aten", "IMPL")
    _library.impl("_copy_from", _copy_from, "PrivateUse1")
    _library.impl("_efficientzerotensor", partial(_make, aten.zeros.default), "PrivateUse1")
    for _name in (
        "empty.memory_format",
        "empty_strided",
        "arange",
        "arange.start",
        "arange.start_step",
        "eye",
        "eye.m",
        "linspace",
        "randperm",
        "randperm.generator",
        "tril_indices",
        "triu_indices",
    ):
        _packet, _, _overload = _name.partition(".")
        _operation = getattr(getattr(aten, _packet), _overload or "default")
        _library.impl(_name, partial(_make, _operation), "PrivateUse1")
