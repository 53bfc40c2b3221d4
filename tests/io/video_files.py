"""Videos whose frames carry their number."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from perfcap.io.video_writer import VideoWriter


def picture(i: int, height: int = 48, width: int = 64) -> np.ndarray:
    """A frame that tells its number, as eight bars of binary digits, and where its top left is."""
    frame = np.full((height, width, 3), 40, np.uint8)
    for digit in range(8):
        bar = slice(digit * (width // 8), (digit + 1) * (width // 8))
        frame[height // 2 :, bar] = 220 if i >> digit & 1 else 20
    frame[: height // 4, : width // 4] = 235
    return frame


def number(frame: np.ndarray) -> int:
    height, width = frame.shape[:2]
    bars = frame[height // 2 + 4 :, : width // 8 * 8].mean((0, 2)).reshape(8, -1).mean(1)
    return sum(1 << digit for digit, level in enumerate(bars) if level > 120)


def make_video(path: Path, frames: int = 80, size: tuple[int, int] = (48, 64)) -> Path:
    with VideoWriter(path, 30, crf=5, preset="ultrafast") as writer:
        for i in range(frames):
            writer.write(picture(i, *size))
    return path


def write_frames(
    path: Path,
    frames: list[tuple[np.ndarray, int]],
    tick: Fraction,
    options: dict[str, str] | None = None,
) -> None:
    with av.open(str(path), "w", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream("libx264", 30, options=options or {"crf": "5"})
        stream.height, stream.width = frames[0][0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.time_base = stream.codec_context.time_base = tick
        for image, pts in frames:
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = pts, tick
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
