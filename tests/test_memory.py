"""Freed memory goes back to the system."""

import sys
from pathlib import Path

import numpy as np
import pytest

from perfcap.memory import give_back


def resident() -> int:
    """Pages of the process in main memory."""
    return int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems do not say")
def test_what_is_freed_goes_back() -> None:
    blocks = [np.ones(1 << 14, np.uint8) for _ in range(8000)]  # 125 MiB, from the heap
    kept = blocks[::1000]
    held = resident()
    del blocks
    give_back()
    assert held - resident() > 25_000  # pages of 4 KiB; 4 000 without it
    assert all(block.all() for block in kept)


def test_systems_that_cannot_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "elsewhere")
    give_back()
