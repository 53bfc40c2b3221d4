"""Products of numbers in the type that they have."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch

_EVERY: Any = torch.backends  # torch declares no types of these settings
_PRODUCTS = (_EVERY.cuda.matmul, _EVERY.mkldnn.matmul)
_LOCK = threading.Lock()
_WITHIN: list[int] = []  # threads
_KEPT: list[tuple[Any, str]] = []  # settings that come back when the last of them is out


@contextmanager
def own_precision(device: str) -> Iterator[None]:
    """Compute in the type of the numbers, whatever autocast and settings for a network say.

    ``torch.set_float32_matmul_precision("medium")`` has products of float32 rounded to bfloat16:
    solves then end beside their minimum, or stall, and those that stall have no gradient.

    Args:
        device: type of the one to compute on.
    """
    with _LOCK:
        _WITHIN.append(threading.get_ident())
        for products in _PRODUCTS:
            was = products.fp32_precision
            if was in ("tf32", "bf16"):
                # one that comes from the setting of all operations goes on following that
                _KEPT.append((products, "none" if was == _EVERY.fp32_precision else was))
                products.fp32_precision = "ieee"
    try:
        with torch.autocast(device, enabled=False):
            yield
    finally:
        with _LOCK:
            _WITHIN.remove(threading.get_ident())
            while _KEPT and not _WITHIN:
                products, was = _KEPT.pop()
                products.fp32_precision = was
