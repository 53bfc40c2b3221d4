"""Frames of a view some frames later: the right ones, and the last one beyond the end."""

from pathlib import Path

import cv2
import numpy as np

from perfcap.io.clip import Clip, open_source
from perfcap.io.late_source import LateSource


def test_frames_come_from_elsewhere_in_the_file(tmp_path: Path) -> None:
    for frame in range(8):
        cv2.imwrite(str(tmp_path / f"{frame:06d}.png"), np.full((4, 6, 3), 20 * frame, np.uint8))
    source = open_source(tmp_path)
    for late in (3, -2, 0, 20):
        moved = LateSource(source, late)
        expected = 20 * np.clip(np.arange(8) + late, 0, 7)
        assert moved.read(0, 8)[:, 0, 0, 0].tolist() == expected.tolist()
        assert moved.read(5, 7)[:, 0, 0, 0].tolist() == expected[5:7].tolist()
        assert moved.read(3, 3).shape == (0, 4, 6, 3) and len(moved) == 8
    clip = Clip([source, LateSource(source, 1)], 30.0)
    assert clip.read(2, 3)[0, :, 0, 0, 0].tolist() == [40, 60]
    assert clip.names == (source.name, source.name) and clip.sizes[1] == (4, 6)
