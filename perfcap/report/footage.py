"""Input videos made small enough to lie inside a page."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from fractions import Fraction

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.clip import Clip

LONGEST_SIDE = 640  # px of a shown video
BUDGET = 12_000_000  # bytes of all videos of a page, for long clips
_MOST = 100_000_000  # bits a second, more than any quality needs; the encoder counts to 2^31
_BATCH = 8  # frames in memory at once
_QUALITY = {"crf": "25", "preset": "medium", "profile": "baseline"}
# Key frames close together and no frames that are shown in another order: scrubbing is quick,
# and frame i is shown at its own time.
_SEEKABLE = {"g": "12", "bf": "0"}

Image = NDArray[np.uint8]


def shown_size(size: tuple[int, int]) -> tuple[int, int]:
    """Height and width of a shown video, even as H.264 needs them; never enlarged."""
    scale = min(1.0, LONGEST_SIDE / max(size))
    height, width = (max(2, 2 * round(side * scale / 2)) for side in size)
    return height, width


def encode_view(
    clip: Clip, view: int, rate: float, progress: Callable[[int, int], None] | None = None
) -> bytes:
    """A view of a clip as an H.264 file that browsers decode (baseline profile, yuv420p).

    Args:
        clip: the frames.
        view: which.
        rate: frames a second.
        progress: called with (frames done, frames).

    Raises:
        InputError: a frame can no longer be read.
    """
    height, width = shown_size(clip.sizes[view])
    most = min(int(8 * BUDGET * rate / (len(clip) * clip.views)), _MOST)  # bits a second
    options = {**_QUALITY, **_SEEKABLE, "maxrate": str(most), "bufsize": str(2 * most)}
    sink = io.BytesIO()
    with av.open(sink, "w", format="mp4") as container:
        stream = container.add_stream(
            "libx264", Fraction(rate).limit_denominator(1001), options=options
        )
        stream.height, stream.width, stream.pix_fmt = height, width, "yuv420p"
        for done, image in enumerate(_images(clip, view), 1):
            small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(small, format="rgb24")))
            if progress is not None:
                progress(done, len(clip))
        container.mux(stream.encode())
    return sink.getvalue()


def _images(clip: Clip, view: int) -> Iterator[Image]:
    for start in range(0, len(clip), _BATCH):
        yield from clip.read_view(view, start, min(start + _BATCH, len(clip)))
