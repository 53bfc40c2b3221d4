"""What goes on in a child that was forked from a process with threads.

Threads do not come along into a forked child (``os.fork``, workers of a ``DataLoader`` on Linux):
whoever waits for one there waits for ever, also to let go of it.
"""

from __future__ import annotations

import os
import sys
from typing import Any, Protocol
from weakref import WeakSet

import torch


class HasThreads(Protocol):
    """Holds something with threads of its own, such as a decoder or a network."""

    def abandon(self) -> object:
        """Give it up without closing it, and return it; what is needed again is opened anew."""


def abandon_after_fork(holder: HasThreads) -> None:
    """Have ``holder.abandon()`` called in every child that is forked while the holder lives."""
    note_threads()
    _HOLDERS.add(holder)


def note_threads() -> None:
    """Say that this process computes: from now on its forked children do so with one thread each.

    OpenMP and OpenCV would wait for the threads that the parent had. Children of a process that
    has not computed are left alone.
    """
    _COMPUTING.add(os.getpid())


_COMPUTING: set[int] = set()  # processes
_HOLDERS: WeakSet[Any] = WeakSet()
_ABANDONED: list[object] = []  # never collected: that would wait, too


def _in_child() -> None:
    _ABANDONED.extend([holder.abandon() for holder in list(_HOLDERS)])
    if _COMPUTING:
        torch.set_num_threads(1)
        if "cv2" in sys.modules:
            sys.modules["cv2"].setNumThreads(0)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
