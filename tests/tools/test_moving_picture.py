"""Animated pictures of videos side by side."""

import importlib.util
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from perfcap.io import Clip, models_folder

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "moving_picture", ROOT / "tools" / "moving_picture.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
def test_pictures_play_in_order_at_the_rate_of_the_video(tool: ModuleType, tmp_path: Path) -> None:
    clip = Clip.open(models_folder() / "demo" / "video.mp4")
    pictures = [tool.side_by_side([clip, clip, clip], frame, (40, 30), 2) for frame in (0, 40, 80)]
    assert pictures[0].shape == (60, 80, 3)
    np.testing.assert_array_equal(pictures[0][:30, :40], pictures[0][30:, :40])
    assert (pictures[0][30:, 40:] == 255).all()  # nothing is there
    tool.write(tmp_path / "a.webp", pictures, 10.0)
    read, animation = cv2.imreadanimation(str(tmp_path / "a.webp"))
    assert read and list(animation.durations) == [100, 100, 100] and animation.loop_count == 0
    for found, made in zip(animation.frames, pictures, strict=True):
        close = np.abs(found[..., 2::-1].astype(int) - made)
        assert close.mean() < 12  # lossy
        others = [np.abs(found[..., 2::-1].astype(int) - each).mean() for each in pictures]
        assert min(others) == close.mean()
