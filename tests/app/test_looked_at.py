"""The frames that are held for checks are those that they look at."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.app.looked_at import fixed_frames, gravity_frames
from perfcap.io.doctor.fields import examine_fields
from perfcap.io.doctor.footage import examine_blank
from perfcap.io.doctor.rest import background_shift
from perfcap.io.doctor.shots import background_changes


class Noted:
    """One view of a camera at rest, and which frames of it were read."""

    def __init__(self, count: int) -> None:
        rough = np.random.default_rng(0).integers(0, 256, (30, 40, 3)).astype(np.uint8)
        self.count, self.read = count, set[int]()
        self.image = np.asarray(cv2.resize(rough, (320, 240), interpolation=cv2.INTER_CUBIC))

    def __len__(self) -> int:
        return self.count

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        self.read |= set(range(start, stop))
        return np.repeat(self.image[None], stop - start, 0)


@pytest.mark.parametrize("count", [2, 12, 100, 230, 1801])
@pytest.mark.parametrize("rate", [24.0, 59.94])
def test_checks_of_a_camera_at_rest_read_nothing_else(count: int, rate: float) -> None:
    clip = Noted(count)
    joints = np.tile(np.random.default_rng(1).uniform(100, 140, (16, 2)), (count, 1, 1))
    seen = np.ones((count, 16))
    assert examine_blank(clip, ["view"]) == examine_fields(clip, ["view"]) == []
    assert background_shift(clip, 0, rate, joints, seen) is None
    assert background_changes(clip, 0, rate, joints, seen) == []
    held = set(fixed_frames(count, rate))
    assert clip.read <= held
    assert held <= clip.read | set(gravity_frames(count)) or count < 12
    assert len(held) <= 45


@pytest.mark.parametrize("count", [1, 2, 5])
def test_short_clips(count: int) -> None:
    assert fixed_frames(count, 30.0) == list(range(count))
