"""Loops that are compiled when they are first called, and kept on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core.registry import CPUDispatcher

# calls are not checked: arrays of many kinds and tuples unpacked pass through them
Function = Callable[..., Any]


class _Inner(CPUDispatcher):  # type: ignore[misc]
    """Python would jump to an address that is not there."""

    def __call__(self, *_args: Any, **_options: Any) -> Any:
        name = self.py_func.__qualname__
        raise TypeError(f"{name} is called by other kernels alone; decorate it with kernel() else")


def kernel(**options: Any) -> Callable[[Function], Any]:
    """Compile a function that Python calls; it runs without the interpreter's lock.

    Args:
        **options: of ``numba.njit``, as ``fastmath``.
    """

    def compiled(function: Function) -> Any:
        return numba.njit(nogil=True, cache=True, **options)(function)

    return compiled


def inner(**options: Any) -> Callable[[Function], Any]:
    """Compile a function that other kernels alone call.

    There is no way in from Python, which would take long to compile.

    Args:
        **options: of ``numba.njit``, as ``fastmath``.
    """
    no_way_in = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

    def compiled(function: Function) -> Any:
        made = kernel(**no_way_in, **options)(function)
        if isinstance(made, CPUDispatcher):  # not where compiling is switched off
            made.__class__ = _Inner
        return made

    return compiled
