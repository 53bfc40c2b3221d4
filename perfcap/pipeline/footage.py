"""Videos of a clip with something painted on every frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.clip import Clip
from perfcap.io.video_segment import Packet, Segment
from perfcap.io.video_writer import VideoWriter
from perfcap.pipeline.checkpoint import NOTHING, Codec, Kept
from perfcap.workers import ordered_map

Image = NDArray[np.uint8]
# paints one picture (H, W, 3) from a frame within a span, a view, and the image seen there
Painter = Callable[[int, int, Image], Image]

_BATCH = 16  # frames in memory at once
_SEGMENT = 64  # pictures that a kill may cost, and frames between two key frames at most
_TALLEST, _WIDEST = 1080, 1920  # of the written video, pixels


def write_footage(
    path: Path,
    clip: Clip,
    frames: int,
    prepare: Callable[[slice], Painter],
    progress: Callable[[int, int], None] | None = None,
    kept: Kept = NOTHING,
) -> None:
    """Paint on the frames of a clip and write them; several views side by side.

    Args:
        path: of the video, H.264.
        clip: the frames.
        frames: how many of them at most.
        prepare: gives the painter of a span of frames, called span after span; painters are
            called from several threads.
        progress: called with (frames done, frames).
        kept: segments that are drawn already.
    """
    total = min(len(clip), frames)
    length = max(_BATCH, _SEGMENT // clip.views // _BATCH * _BATCH)
    starts = range(0, total, length)
    with VideoWriter(path, clip.fps, crf=21) as writer:

        def draw(start: int) -> Segment:
            stop = min(start + length, total)
            return writer.encoding.segment(pictures(start, stop))

        def pictures(first: int, last: int) -> Iterator[Image]:
            for start in range(first, last, _BATCH):
                stop = min(start + _BATCH, last)
                paint = prepare(slice(start, stop))
                for row in _painted(paint, clip.read_views(start, stop)):
                    yield _fit(_side_by_side(row))
                if progress is not None:
                    progress(stop, total)

        for segment in kept.each(_SEGMENTS, draw, starts):
            writer.append(segment)


def _pack(segment: Segment) -> dict[str, Any]:
    data, places, keys = zip(*segment.packets, strict=True)
    return {
        "data": np.frombuffer(b"".join(data), np.uint8),
        "sizes": np.array([len(each) for each in data]),
        "places": np.array(places),
        "keys": np.array(keys),
        "size": np.array(segment.size),
    }


def _unpack(record: dict[str, Any]) -> Segment:
    parts = np.split(record["data"], np.cumsum(record["sizes"])[:-1])
    packets = zip(parts, record["places"].tolist(), record["keys"].tolist(), strict=True)
    height, width = record["size"].tolist()
    return Segment(tuple(Packet(part.tobytes(), *more) for part, *more in packets), (height, width))


_SEGMENTS: Codec[Segment] = Codec(_pack, _unpack)


def _painted(paint: Painter, views: Sequence[Image]) -> Iterator[list[Image]]:
    """Pictures of all views, frame by frame."""
    tasks = [(f, c, views[c][f]) for f in range(len(views[0])) for c in range(len(views))]
    row: list[Image] = []
    for picture in ordered_map(lambda task: paint(*task), tasks):
        row.append(picture)
        if len(row) == len(views):
            yield row
            row = []


def _side_by_side(pictures: list[Image]) -> Image:
    if len(pictures) == 1:
        return pictures[0]
    height = min(picture.shape[0] for picture in pictures)
    scaled = [
        cv2.resize(
            p, (round(p.shape[1] * height / p.shape[0]), height), interpolation=cv2.INTER_AREA
        )
        for p in pictures
    ]
    joined: Image = np.concatenate(scaled, 1)
    return joined


def _fit(picture: Image) -> Image:
    """Shrunk to what a screen shows; never enlarged."""
    height, width = picture.shape[:2]
    scale = min(1.0, _TALLEST / height, _WIDEST / width)
    if scale == 1.0:
        return picture
    size = (round(width * scale), round(height * scale))
    shrunk: Image = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return shrunk
