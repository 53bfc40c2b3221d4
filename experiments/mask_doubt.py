"""Which masks are probably wrong? What a capture knows of a mask, against the truth.

Clips of random people in random clothes and rooms (``staged_people.py``), with and without a
network's mask. One set of clips is learned from: the logarithm of what the overlap lacks is linear
in clues, and masks are named below the overlap at which a tenth of the good ones would be. Another
set is scored: of the frames whose overlap is below 0.9, how many are named, and of the others.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
from held_out_masks import capture_staged
from numpy.typing import NDArray
from report import Report, Table, data_folder
from staged_people import Staged, staged

from perfcap.app.networks import NO_SEGMENTER
from perfcap.metrics import mask_overlap
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.performance import Performance
from perfcap.train.motion_library import MotionLibrary

Floats = NDArray[np.float64]

_BAD = 0.9  # overlap below which a mask should be named
_LACK = 0.01  # what an overlap lacks at least
_NAMES = ("network", "against usual", "posed model", "against usual", "confidence",
          "against usual", "area")  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    learned: int = 12
    """Clips to learn from."""
    held_out: int = 12
    """Clips to score on; those of ``held_out_masks.py``."""
    frames: int = 40
    """Of each."""
    size: int = 480
    """Side of the images, px."""
    seed: int = 7
    """Of the clips to learn from."""
    networks: tuple[str, ...] = ("blazepose", NO_SEGMENTER)
    """Of person masks, one run each."""


@dataclass(frozen=True)
class Seen:
    """Clues (F, K) and true overlaps (F,) of a clip's masks."""

    name: str
    network: str
    clues: Floats
    overlaps: Floats
    named: NDArray[np.bool_]


def run(config: Experiment) -> Report:
    """Weights, and what they name."""
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    learned = _seen(config, library, config.learned, config.seed)
    held_out = _seen(config, library, config.held_out, 0)
    report.RESULTS.mkdir(exist_ok=True)
    kept = {f"{kind}_{i}_{part}": getattr(each, part)
            for kind, clips in (("learned", learned), ("held_out", held_out))
            for i, each in enumerate(clips) for part in ("clues", "overlaps", "named")}  # fmt: skip
    np.savez(report.RESULTS / "mask_doubt.npz", **kept)
    rows, weights = [], []
    for network in config.networks:
        own, other = ([e for e in clips if e.network == network] for clips in (learned, held_out))
        weight, limit = _fitted(own)
        weights.append((network, *weight, limit))
        for title, clips in (("learned from", own), ("held out", other)):
            score = np.concatenate([each.clues for each in clips]) @ weight[:-1] + weight[-1]
            low = np.concatenate([each.overlaps for each in clips]) < _BAD
            before = np.concatenate([each.named for each in clips])
            rows.append((network, title, len(low), int(low.sum()), *_shares(low, before),
                         *_shares(low, score > limit)))  # fmt: skip
    columns = ("network", "clips", "frames", "below 90 %", "named now", "others", "named", "others")
    return Report((
        Table("frames with masks below 90 %, and others, named, %", columns, tuple(rows), 1),
        Table("weights", ("network", *_NAMES, "offset", "limit"), tuple(weights), 4),
    ))  # fmt: skip


def _shares(low: NDArray[np.bool_], named: NDArray[np.bool_]) -> tuple[float | str, float]:
    return (100 * float(named[low].mean()) if low.any() else "-"), 100 * float(named[~low].mean())


def _fitted(clips: Sequence[Seen]) -> tuple[Floats, float]:
    """Weights of the clues and an offset, and the score above which masks are named."""
    clues = np.concatenate([each.clues for each in clips])
    overlaps = np.concatenate([each.overlaps for each in clips])
    rows = np.column_stack((clues, np.ones(len(clues))))
    ridge = 1e-2 * len(rows) * np.diag([*clues.var(0) + 1e-9, 0.0])
    lack = np.log(np.maximum(1 - overlaps, _LACK))
    weight: Floats = np.linalg.solve(rows.T @ rows + ridge, rows.T @ lack)
    return weight, float(np.quantile((rows @ weight)[overlaps >= _BAD], 0.9))


def _seen(config: Experiment, library: MotionLibrary, count: int, seed: int) -> list[Seen]:
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            clip = staged(Path(folder), library, number, config.frames, config.size, seed)
            for network in config.networks:
                capture = capture_staged(clip, network, "refine_pose")
                each = _look(clip, network, capture)
                found.append(each)
                low = each.overlaps < _BAD
                print(clip.name, network, f"{100 * each.overlaps.mean():.1f}", int(low.sum()),
                      int((each.named & low).sum()), int(each.named.sum()), flush=True)  # fmt: skip
    return found


def _look(clip: Staged, network: str, capture: Performance) -> Seen:
    refinement = capture.refinement
    assert refinement is not None and refinement.pose is not None
    evidence, named = refinement.evidence, np.zeros(capture.frames, bool)
    named[refinement.doubtful_masks] = True
    pairs = enumerate(clip.masks)
    overlaps = [mask_overlap(evidence.masks(frame)[0], mask).iou for frame, mask in pairs]
    clues = mask_clues(evidence, np.asarray(refinement.pose.after))
    return Seen(clip.name, network, clues, np.array(overlaps), named)


def mask_clues(evidence: Evidence, model: Floats) -> Floats:
    """Of masks of one view (F, K), from the overlap with the refined pose (F,)."""
    agreement = np.nan_to_num(evidence.agreement, nan=1.0)
    sure = np.array([np.mean(row[0]) / 255 if len(row[0]) else 0.0 for row in evidence.confidence])
    area = np.array([evidence.masks(f)[0].sum() for f in range(len(model))], float)
    parts: list[Floats] = []
    for lack in (1 - agreement, 1 - model, 1 - sure):
        log = np.log(np.maximum(lack, _LACK))
        parts += [log, log - np.median(log)]
    parts.append(np.abs(np.log(np.maximum(area, 1)) - np.log(np.maximum(_smooth(area), 1))))
    return np.stack(parts, -1)


def _smooth(values: Floats) -> Floats:
    """Medians of nine frames."""
    padded = np.pad(values, 4, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 9)
    found: Floats = np.median(windows, -1)
    return found


if __name__ == "__main__":
    report.main(run, Experiment, "mask_doubt")
