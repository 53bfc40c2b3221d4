"""The worst masks of all clips on one page, to look at and to explain.

Rendered clips and the held-out clips of ``held_out_masks.py`` are captured up to the refined pose;
of all frames those whose masks overlap least with the truth are drawn: what was missed in red, what
was taken too much in green. ``--most`` of one clip, so that one bad clip does not fill the page.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import held_out_masks
import numpy as np
import report
from numpy.typing import NDArray
from recordings import rendered
from report import Report, Table, data_folder
from staged_people import staged
from surface_recordings import images_of, true_mask

from perfcap.app.networks import find_segmenter
from perfcap.detect import OnnxSegmenter
from perfcap.io.clip import FrameReader
from perfcap.metrics import MaskOverlap, mask_overlap
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.stage import Stage
from perfcap.train.motion_library import MotionLibrary

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_TILE, _ROW, _MARGIN = (300, 240), 5, 12  # px; tiles in a row; px around the person


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt", "dev_coat")
    """Of ``rendered``."""
    clips: int = 12
    """Held-out clips."""
    seed: int = 0
    """Of them."""
    network: str = "blazepose"
    """Of person masks."""
    count: int = 20
    """Masks on the page."""
    most: int = 4
    """Of one clip."""


@dataclass(frozen=True)
class _Scored:
    """One mask."""

    clip: str
    frame: int
    score: MaskOverlap
    named: bool
    trust: float
    tile: Image


def run(config: Experiment) -> Report:
    """Capture, score, sort, draw."""
    found: list[_Scored] = []
    for scored in _clips(config):
        found += sorted(scored, key=lambda one: one.score.iou)[: config.most]
        print(found[-1].clip, f"{100 * min(one.score.iou for one in scored):.2f}", flush=True)
    worst = sorted(found, key=lambda one: one.score.iou)[: config.count]
    report.RESULTS.mkdir(exist_ok=True)
    path = report.RESULTS / "worst_masks.png"
    cv2.imwrite(str(path), _page([one.tile for one in worst]))
    rows = tuple(
        (i, one.clip, one.frame, *(100 * getattr(one.score, k) for k in _SCORES),
         "yes" if one.named else "no", one.trust)
        for i, one in enumerate(worst, 1)
    )  # fmt: skip
    columns = ("", "clip", "frame", "IoU %", "precision %", "recall %", "named", "mean trust")
    return Report((Table("the worst masks", columns, rows, 2),), (f"drawn in {path}",))


_SCORES = ("iou", "precision", "recall")


def _clips(config: Experiment) -> Iterator[list[_Scored]]:
    network = OnnxSegmenter(find_segmenter(config.network))
    for name in config.sequences:
        recording = rendered(config.data, name)
        images = images_of(recording)
        found = capture(
            recording.actor, recording.cameras, recording.detections, recording.rate,
            images=type(images)(images.reader, images.cameras, network), until=Stage.REFINE_POSE,
        )  # fmt: skip
        yield _scored(name, found, images.reader, partial(true_mask, recording))
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    settings = held_out_masks.Experiment(config.data)
    for number in range(config.clips):
        with tempfile.TemporaryDirectory() as folder:
            clip = staged(
                Path(folder), library, number, settings.frames, settings.size, config.seed
            )
            found = held_out_masks.capture_staged(clip, config.network, settings.until)
            yield _scored(clip.name, found, clip.clip, clip.masks.__getitem__)


def _scored(
    name: str, found: Performance, reader: FrameReader, truth: Callable[[int], Mask]
) -> list[_Scored]:
    assert found.refinement is not None
    evidence, scored = found.refinement.evidence, []
    doubted = set(found.refinement.doubtful_masks.tolist())
    for frame in range(found.frames):
        mask, true = evidence.masks(frame)[0], truth(frame)
        image = reader.read_view(0, frame, frame + 1)[0]
        score = mask_overlap(mask, true)
        title = f"{name} {frame}: {100 * score.iou:.1f}"
        trust = float(np.mean(evidence.confidence[frame][0])) / 255
        scored.append(
            _Scored(name, frame, score, frame in doubted, trust, _tile(image, mask, true, title))
        )
    return scored


def _tile(image: Image, mask: Mask, true: Mask, title: str) -> Image:
    """The person, and beside it what is wrong about the mask."""
    shown = np.ascontiguousarray(image[..., ::-1])
    marked = shown.copy()
    marked[true & ~mask], marked[mask & ~true] = (0, 0, 255), (0, 255, 0)
    rows, columns = (np.nonzero((mask | true).any(axis))[0] for axis in (1, 0))
    part = tuple(
        slice(max(int(span[0]) - _MARGIN, 0), int(span[-1]) + _MARGIN) for span in (rows, columns)
    )
    pair = np.hstack([shown[part], marked[part]])
    scale = min(_TILE[0] / pair.shape[0], 2 * _TILE[1] / pair.shape[1])
    size = round(pair.shape[1] * scale), round(pair.shape[0] * scale)
    pair = cv2.resize(pair, size, interpolation=cv2.INTER_NEAREST)
    tile: Image = np.zeros((_TILE[0] + 18, 2 * _TILE[1], 3), np.uint8)
    tile[18 : 18 + pair.shape[0], : pair.shape[1]] = pair
    cv2.putText(tile, title, (3, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1)
    return tile


def _page(tiles: list[Image]) -> Image:
    blank = np.zeros_like(tiles[0])
    filled = [*tiles, *[blank] * (-len(tiles) % _ROW)]
    return np.vstack([np.hstack(filled[i : i + _ROW]) for i in range(0, len(filled), _ROW)])


if __name__ == "__main__":
    report.main(run, Experiment, "worst_masks")
