"""Silhouettes of people, rooms and cameras that nothing was developed on.

Twelve clips of random people in random clothes and rooms, four in skirts, four filmed by hand
(``staged_people.py``), each with and without the network's mask. Nothing was chosen on them: they
tell how good masks are elsewhere, and whether those that are bad are named.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import report
from numpy.typing import NDArray
from report import Report, Table, data_folder
from staged_people import RATE, Staged, staged

from perfcap.app.networks import NO_SEGMENTER, find_segmenter
from perfcap.detect import OnnxSegmenter
from perfcap.metrics import joint_errors, mask_overlap
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.stage import Stage
from perfcap.train.motion_library import MotionLibrary

_BAD = 0.9  # overlap below which a mask should be named


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    clips: int = 12
    """How many; every third in a skirt, every third by hand."""
    frames: int = 60
    """Of each."""
    size: int = 480
    """Side of the images, px."""
    seed: int = 0
    """Of the clips."""
    networks: tuple[str, ...] = ("blazepose", NO_SEGMENTER)
    """Of person masks, one run each."""
    until: str = "refine_pose"
    """Last stage: extract_silhouettes, refine_pose or refine_surface."""
    pictures: bool = False
    """Write the worst frame of every clip, with true and found outline."""


def run(config: Experiment) -> Report:
    """Masks of every clip and network, and which of them were named."""
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library"))
    scores: dict[str, list[NDArray[np.float64]]] = {name: [] for name in config.networks}
    named: dict[str, list[NDArray[np.bool_]]] = {name: [] for name in config.networks}
    rows: list[tuple[object, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(config.clips):
            clip = staged(Path(folder), library, number, config.frames, config.size, config.seed)
            for network in config.networks:
                found = capture_staged(clip, network, config.until)
                parts = np.array(list(_overlaps(clip, found)))
                overlaps = parts[:, 0]
                doubted = np.zeros(len(overlaps), bool)
                assert found.refinement is not None
                doubted[found.refinement.doubtful_masks] = True
                scores[network].append(overlaps)
                named[network].append(doubted)
                joints = joint_errors(found.joints(), clip.truth, RATE)
                sides = (100 * parts[:, 1:].mean(0)).tolist()
                rows.append((clip.name, network, *_row(overlaps, doubted), *sides,
                             float(joints.mpjpe_similarity)))  # fmt: skip
                if config.pictures:
                    _picture(clip, found, network, int(overlaps.argmin()))
                print(*rows[-1], sep="\t", flush=True)
    columns = (
        *("clip", "network", "IoU %", "worst frame %", "below 90 %", "named"),
        *("precision %", "recall %", "PA-MPJPE mm"),
    )
    means = tuple(_mean(name, scores[name], named[name]) for name in config.networks)
    summary = (
        *("network", "IoU %", "worst clip %", "still cameras %", "by hand %"),
        *("frames below 90 %", "of them named %", "others named %"),
    )
    title = f"{config.clips} clips of {config.frames} frames, {config.size} px, seed {config.seed}"
    return Report((Table(title, columns, tuple(rows), 2), Table("all", summary, means, 2)))


def capture_staged(clip: Staged, network: str, until: str) -> Performance:
    """Up to a stage, with a network of person masks or without."""
    segmenter = None if network == NO_SEGMENTER else OnnxSegmenter(find_segmenter(network))
    return capture(
        clip.actor,
        clip.cameras,
        clip.detections,
        RATE,
        images=Images(clip.clip, clip.cameras, segmenter=segmenter),
        until=Stage[until.upper()],
    )


def _overlaps(clip: Staged, found: Performance) -> Iterator[tuple[float, float, float]]:
    """Intersection over union, precision and recall of every frame."""
    assert found.refinement is not None
    for frame, mask in enumerate(clip.masks):
        scores = mask_overlap(found.refinement.evidence.masks(frame)[0], mask)
        yield scores.iou, scores.precision, scores.recall


def _row(overlaps: NDArray[np.float64], named: NDArray[np.bool_]) -> tuple[float, float, int, int]:
    low = overlaps < _BAD
    return (
        100 * float(overlaps.mean()),
        100 * float(overlaps.min()),
        int(low.sum()),
        int(named.sum()),
    )


def _mean(
    network: str, scores: list[NDArray[np.float64]], named: list[NDArray[np.bool_]]
) -> tuple[object, ...]:
    means = 100 * np.array([clip.mean() for clip in scores])
    held = np.arange(len(means)) % 3 == 2
    low, told = np.concatenate(scores) < _BAD, np.concatenate(named)
    return (
        network,
        float(means.mean()),
        float(means.min()),
        float(means[~held].mean()),
        float(means[held].mean()) if held.any() else "-",
        int(low.sum()),
        100 * float(told[low].mean()) if low.any() else "-",
        100 * float(told[~low].mean()),
    )


def _picture(clip: Staged, found: Performance, network: str, frame: int) -> None:
    """True outline green, found one red."""
    assert found.refinement is not None
    image = np.ascontiguousarray(clip.clip.read_view(0, frame, frame + 1)[0][..., ::-1])
    for mask, color in (
        (clip.masks[frame], (0, 255, 0)),
        (found.refinement.evidence.masks(frame)[0], (0, 0, 255)),
    ):
        lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(image, lines, -1, color, 1)
    report.RESULTS.mkdir(exist_ok=True)
    number = clip.name.split(":")[0]
    cv2.imwrite(str(report.RESULTS / f"held_out_{number}_{network}_{frame}.png"), image)


if __name__ == "__main__":
    report.main(run, Experiment, "held_out_masks")
