"""How many threads a budget of main memory has room for."""

from __future__ import annotations

import re
import resource
from collections.abc import Sequence
from pathlib import Path

from perfcap.errors import InputError
from perfcap.workers import usable_cores

_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
_PROGRAM = 1 << 30  # bytes of libraries, kernels and models, which come later than this is asked
# bytes for each pixel of the largest view, rounded up from `experiments/image_memory.py`
_SHARED = 200  # samples of a stretch, their models, the plate
_THREAD = 170  # a block of images and what is made of it


def threads_within(
    memory: str | None,
    sizes: Sequence[tuple[int, int]],
    people: int = 1,
    cores: int | None = None,
) -> int | None:
    """Threads, at most one a core, with which stages that look at images stay within a budget.

    Args:
        memory: of the whole process, such as 800M or 2G; None: as much as there is.
        sizes: (height, width) of every view's images.
        people: that are looked for in them.
        cores: those the process may use, if not given.

    Returns:
        None for a thread a core.

    Raises:
        InputError: it is no size, or there is not room for one thread.
    """
    if memory is None:
        return None
    budget, pixels = _bytes(memory), max(height * width for height, width in sizes)
    used = max(_resident(), _PROGRAM) + _SHARED * pixels
    each = _THREAD * pixels * people
    threads = (budget - used) // each
    if threads < 1:
        least = -(-(used + each) // _UNITS["M"])
        raise InputError(
            f"--memory {memory}: has no room for images of {pixels / 1e6:.1f} million pixels; "
            f"expected {least}M or more; smaller videos need less"
        )
    return int(min(threads, usable_cores() if cores is None else cores))


def _bytes(text: str) -> int:
    found = re.fullmatch(r"(\d{1,12}(?:\.\d{1,6})?)([KMGT]?)", text.strip().upper())
    size = 0 if found is None else int(float(found[1]) * _UNITS[found[2]])
    if size < 1:
        raise InputError(f"--memory {text}: is no size; expected one such as 800M or 2G")
    return size


def _resident() -> int:
    """Bytes of the process in main memory now, where the system says."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:  # no Linux
        return 0
    return pages * resource.getpagesize()
