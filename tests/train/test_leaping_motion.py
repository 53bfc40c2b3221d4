"""Recorded motion whose frames leap, as where lost ones are zeros."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from motion_files import write_library

from perfcap.train.motion_library import MotionLibrary


def doubts(folder: Path, lost: slice) -> list[str]:
    """Of a library of one person in whose frames so many are zeros."""
    write_library(folder, people=2, clips=1, frames=360)
    with np.load(folder / "clips.npz") as file:
        arrays = {name: file[name] for name in file.files}
    for name in ("euler_zyx_deg", "root_m"):
        arrays[f"01_01/{name}"][lost] = 0
    np.savez(folder / "clips.npz", **arrays)
    return [each for each in MotionLibrary.read(folder).doubts(["02"]) if "leap" in each]


@pytest.mark.long
@pytest.mark.parametrize(("lost", "leaps"), [(slice(0, 0), 0), (slice(20, None, 40), 1)])
def test_frames_of_zeros_are_named(tmp_path: Path, lost: slice, leaps: int) -> None:
    found = doubts(tmp_path, lost)
    assert len(found) == leaps
    assert all("subject 01: joints leap by 0.2 m" in each for each in found)
