"""Functions that ``torch.compile`` calls and does not trace."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar, cast

import torch

_In = ParamSpec("_In")
_Out = TypeVar("_Out")


def eager(function: Callable[_In, _Out]) -> Callable[_In, _Out]:
    """Run a function as it is, also of a model that is compiled.

    Solves go on until they converge: tracing their steps takes minutes and gains nothing.
    ``torch.compiler.disable`` as decorator would load the compiler with perfcap, which takes
    seconds.
    """

    @wraps(function)
    def run(*args: _In.args, **options: _In.kwargs) -> _Out:
        if torch.compiler.is_compiling():
            disabled = torch.compiler.disable(function)  # type: ignore[no-untyped-call]
            return cast(_Out, disabled(*args, **options))
        return function(*args, **options)

    return run
