"""Masks that are moved or stretched, as by a resize with borders: how often that is named.

True masks of all rendered clips, of every view and person, as they are and spoiled. What is named
of right masks, and of such as are a little too large, too small or coarse, is a false alarm.
Thresholds were chosen with these clips in view. ``io.doctor.moved_outlines`` is what captures ask.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import report
from numpy.typing import NDArray
from recordings import stored_image
from report import Report, Table

from perfcap.io.doctor.moved_outlines import moved_sentences, register

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Change = Callable[[Mask, float], Mask]


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt", "dev_coat")
    """Of ``rendered``."""
    several: tuple[str, ...] = ("dev_views", "dev_dance", "dev_duo", "dev_trio", "dev_twins")
    """Of ``rendered_multi``."""
    frames: int = 12
    """Of a clip, spread over it; as many as captures look at."""


@dataclass(frozen=True)
class _Seen:
    """A person in a view."""

    images: tuple[Image, ...]
    masks: tuple[Mask, ...]

    @property
    def size(self) -> float:
        """Of the person, px."""
        return float(np.median([np.ptp(np.flatnonzero(mask.any(1))) for mask in self.masks]))


def _placed(
    mask: Mask, size: float, *, wide: float = 1.0, tall: float = 1.0, right: float = 0.0,
    down: float = 0.0,
) -> Mask:  # fmt: skip
    """Stretched about the middle of the image, and moved by shares of the person's size."""
    height, width = mask.shape
    across = [wide, 0.0, 0.5 * width * (1 - wide) + right * size]
    along = [0.0, tall, 0.5 * height * (1 - tall) + down * size]
    grey = cv2.warpAffine(mask.astype(np.uint8) * 255, np.array([across, along]), (width, height))
    moved: Mask = grey > 127
    return moved


def _grown(mask: Mask, size: float, *, by: int) -> Mask:
    """Larger by some pixels, or smaller."""
    change = cv2.dilate if by > 0 else cv2.erode
    grown: Mask = change(mask.astype(np.uint8), np.ones((2 * abs(by) + 1,) * 2, np.uint8)) > 0
    return grown


def _coarse(mask: Mask, size: float) -> Mask:
    """As a network of small masks has them."""
    small = cv2.resize(mask.astype(np.uint8) * 255, (160, 160), interpolation=cv2.INTER_AREA)
    coarse: Mask = cv2.resize(small, mask.shape[::-1]) > 127
    return coarse


CHANGES: dict[str, Change] = {
    "right": lambda mask, size: mask,
    "2 px larger": partial(_grown, by=2),
    "2 px smaller": partial(_grown, by=-2),
    "from 160 px": _coarse,
    "too flat by 6 % (16:9 with borders)": partial(_placed, tall=0.9375),
    "too flat by 3 %": partial(_placed, tall=0.967),
    "too narrow by 6 %": partial(_placed, wide=0.9375),
    "2 % down": partial(_placed, down=0.02),
    "3.5 % up": partial(_placed, down=-0.035),
    "2 % to the right": partial(_placed, right=0.02),
}


def run(config: Experiment) -> Report:
    """A row for each way of spoiling masks."""
    named = dict.fromkeys(CHANGES, 0)
    count = 0
    for seen in read(config):
        count += 1
        for name, change in CHANGES.items():
            masks = [change(mask, seen.size) for mask in seen.masks]
            found = register(zip(seen.images, masks, strict=True), seen.size)
            named[name] += any(moved_sentences("view", found))
    rows = tuple((name, count, some, 100 * some / count) for name, some in named.items())
    columns = ("masks", "people in views", "named", "%")
    return Report((Table("Masks moved or stretched", columns, rows, 0),))


def read(config: Experiment) -> Iterator[_Seen]:
    """Every person in every view in which they are seen in most frames."""
    for name in config.sequences:
        folder = config.data / "rendered" / name
        files = sorted((folder / "masks").glob("*.png"))
        masks: list[Mask] = [stored_image(path) > 127 for path in files]
        yield from _people(folder / "video.mp4", [masks], config.frames)
    for name in config.several:
        folder = config.data / "rendered_multi" / name
        for video in sorted((folder / "views").glob("cam*.mp4")):
            sheet = stored_image(folder / "labels" / f"{video.stem}.png")
            capture = cv2.VideoCapture(str(video))
            sides = (cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)
            height, width = (int(capture.get(side)) for side in sides)
            labels = sheet.reshape(-1, height, width)
            people = [list(labels == number) for number in range(1, int(labels.max()) + 1)]
            yield from _people(video, people, config.frames)


def _people(video: Path, people: list[list[Mask]], count: int) -> Iterator[_Seen]:
    """Those of a view, in frames spread over it."""
    capture = cv2.VideoCapture(str(video))
    wanted = set(np.linspace(0, len(people[0]) - 1, count).round().astype(int).tolist())
    images = {}
    for frame in range(len(people[0])):
        there, image = capture.read()
        if not there:
            break
        if frame in wanted:
            images[frame] = np.asarray(image, np.uint8)
    for masks in people:
        kept = [frame for frame in images if masks[frame].any()]
        if 2 * len(kept) > count:
            yield _Seen(
                tuple(images[frame] for frame in kept), tuple(masks[frame] for frame in kept)
            )


if __name__ == "__main__":
    report.main(run, Experiment, "moved_masks")
