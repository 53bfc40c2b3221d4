"""Masks of a view that is late: numbered as the frames of its own video, written and read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from square_masks import FRAMES, black_clip, square

from perfcap.io.clip import Clip
from perfcap.io.late_source import LateSource
from perfcap.io.mask_files import MaskFolders, save_masks
from perfcap.segment.silhouettes import encode_labels


@pytest.fixture
def video(tmp_path: Path) -> Clip:
    return black_clip(tmp_path / "video")


@pytest.mark.parametrize("late", [-2, 0, 1])
@pytest.mark.parametrize("part", [(0, FRAMES), (3, 9), (0, 6)])
def test_masks_of_a_late_view_come_back(
    video: Clip, tmp_path: Path, late: int, part: tuple[int, int]
) -> None:
    clip = Clip([LateSource(video.sources[0], late)], 30.0, start=part[0], stop=part[1])
    own = clip.file_frames(0)
    there = own >= 0
    shown = np.clip(np.arange(*part) + late, 0, FRAMES - 1)
    assert clip.late(0) == late and np.array_equal(own[there], shown[there])
    assert there.sum() == len(set(shown.tolist()))  # those that repeat are not of their time
    masks = [encode_labels(square(frame)) for frame in shown]
    folder = tmp_path / "masks"
    assert save_masks(folder, {"one": masks}, part[0], [own.tolist()]) == there.sum()
    read = MaskFolders.open([folder], clip)
    assert read.complete() == np.flatnonzero(there).tolist()
    for frame in read.complete():
        np.testing.assert_array_equal(read.mask(0, frame), square(int(shown[frame])))
    alone = MaskFolders.open([folder], video)  # as anybody reads them who knows the video only
    assert alone.complete() == own[there].tolist()
    for frame in alone.complete():
        np.testing.assert_array_equal(alone.mask(0, frame), square(frame))
