"""Memory that nobody needs any more, back to the system."""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Return what was freed to the system, where its C library can (glibc); else do nothing.

    It keeps freed blocks of up to 32 MiB, for each thread, and images are such blocks: after a
    view of large ones the process would hold several times what it needs.
    """
    if not sys.platform.startswith("linux"):
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
