"""A small video without a person, and a mask of each of its frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from perfcap.io.clip import Clip

SIZE = (30, 40)
FRAMES = 12


def black_clip(folder: Path) -> Clip:
    """Images in a folder that is made."""
    folder.mkdir()
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / f"{frame:04d}.png"), np.zeros((*SIZE, 3), np.uint8))
    return Clip.open(folder, fps=30.0)


def square(frame: int) -> np.ndarray:
    """Larger from frame to frame."""
    mask = np.zeros(SIZE, bool)
    mask[5 : 10 + frame, 8:20] = True
    return mask
