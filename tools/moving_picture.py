"""Videos side by side as one animated WebP: the moving pictures of the README and the gallery.

perfcap demo --out demo && perfcap render demo --orbit 50 --size 360 360 --out around.mp4
python tools/moving_picture.py demo.webp models/demo/video.mp4 demo/overlay.mp4 around.mp4
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io import Clip

QUALITY = 60  # of WebP, percent


def side_by_side(
    clips: list[Clip], frame: int, size: tuple[int, int], columns: int
) -> NDArray[np.uint8]:
    """One frame of every clip, (height * rows, width * columns, 3) RGB, row by row."""
    width, height = size
    pictures = [
        cv2.resize(clip.read(frame, frame + 1)[0, 0], (width, height), interpolation=cv2.INTER_AREA)
        for clip in clips
    ]
    blank = np.full((height, width, 3), 255, np.uint8)
    pictures += [blank] * (-len(pictures) % columns)
    rows = [
        np.concatenate(pictures[start : start + columns], 1)
        for start in range(0, len(pictures), columns)
    ]
    return np.concatenate(rows)


def write(path: Path, pictures: list[NDArray[np.uint8]], rate: float) -> None:
    """An animated WebP of RGB pictures that plays for ever."""
    animation = cv2.Animation()
    animation.frames = [cv2.cvtColor(picture, cv2.COLOR_RGB2BGR) for picture in pictures]
    animation.durations = np.full(len(pictures), round(1000 / rate), np.int32)
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwriteanimation(str(path), animation, [cv2.IMWRITE_WEBP_QUALITY, QUALITY]):
        raise SystemExit(f"{path}: the animation could not be written")


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="a .webp")
    parser.add_argument("videos", type=Path, nargs="+")
    parser.add_argument("--size", type=int, nargs=2, default=(300, 300), help="of each, px")
    parser.add_argument("--columns", type=int, help="all in one row when not given")
    parser.add_argument("--every", type=int, default=2, help="leave out frames between")
    arguments = parser.parse_args()
    clips = [Clip.open(video) for video in arguments.videos]
    frames = range(0, min(len(clip) for clip in clips), arguments.every)
    columns = arguments.columns or len(clips)
    pictures = [side_by_side(clips, frame, tuple(arguments.size), columns) for frame in frames]
    write(arguments.out, pictures, clips[0].fps / arguments.every)


if __name__ == "__main__":
    main()
