"""The picture of the README: frames of a clip above the same frames with the capture drawn on.

perfcap demo --out demo
python tools/readme_picture.py models/demo/video.mp4 demo/overlay.mp4 docs/images/demo.jpg
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from perfcap.io import Clip

SIZE = 340  # pixels of one square picture
COUNT = 5


def strip(clip: Clip, frames: list[int]) -> np.ndarray:
    """Frames side by side, (SIZE, SIZE * len(frames), 3) RGB."""
    pictures = [clip.read(frame, frame + 1)[0, 0] for frame in frames]
    return np.concatenate(
        [cv2.resize(p, (SIZE, SIZE), interpolation=cv2.INTER_AREA) for p in pictures], 1
    )


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("video", type=Path)
    parser.add_argument("overlay", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=int, nargs="+", help="evenly spread when not given")
    arguments = parser.parse_args()
    clips = [Clip.open(arguments.video), Clip.open(arguments.overlay)]
    length = min(len(clip) for clip in clips)
    frames = arguments.frames or np.linspace(0, length - 1, COUNT + 2)[1:-1].round().astype(int)
    picture = np.concatenate([strip(clip, [int(f) for f in frames]) for clip in clips])
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    coded, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 82])
    if not coded:
        raise SystemExit(f"{arguments.out}: the picture could not be encoded")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_bytes(data.tobytes())


if __name__ == "__main__":
    main()
