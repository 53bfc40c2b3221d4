"""Videos of a clip with something painted on every frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.clip import Clip
from perfcap.io.video_writer import VideoWriter
from perfcap.workers import ordered_map

Image = NDArray[np.uint8]
# paints one picture (H, W, 3) from a frame within a span, a view, and the image seen there
Painter = Callable[[int, int, Image], Image]

_BATCH = 16  # frames in memory at once
_TALLEST, _WIDEST = 1080, 1920  # of the written video, pixels


def write_footage(
    path: Path,
    clip: Clip,
    frames: int,
    prepare: Callable[[slice], Painter],
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Paint on the frames of a clip and write them; several views side by side.

    Args:
        path: of the video, H.264.
        clip: the frames.
        frames: how many of them at most.
        prepare: gives the painter of a span of frames, called span after span; painters are
            called from several threads.
        progress: called with (frames done, frames).
    """
    total = min(len(clip), frames)
    done = 0
    with VideoWriter(path, clip.fps, crf=21) as writer:
        for views in clip.iter_views(_BATCH):
            count = min(len(views[0]), total - done)
            paint = prepare(slice(done, done + count))
            for row in _painted(paint, [view[:count] for view in views]):
                writer.write(_fit(_side_by_side(row)))
            done += count
            if progress is not None:
                progress(done, total)
            if done >= total:
                break


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
