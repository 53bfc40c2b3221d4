"""Trust: how many bad frames a capture names, and how many good ones it names by mistake.

A frame is bad where the error after a similarity is above 120 mm, or a joint is 0.3 m off beside
the middle of the hips. The model was fitted to captures of 14 clips of the CMU library; the
recordings here are others. Detections: as given; as a simulated detector with 2.2 times the errors
makes them; with parts of the person hidden; one view without 3D poses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from detection_noise import Noise
from fast_motion import observed
from recordings import Recording, balancing, demo, rendered, rendered_views
from report import Report, Table
from torch import Tensor
from trust_model import LIMBS, bad_frames, shares

from perfcap.detect.detections import Detections
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.trust import THRESHOLD


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    seed: int = 0
    """Of simulated errors."""


def run(config: Experiment) -> Report:
    """Every clip with every kind of detections, and all of a kind together."""
    torch.set_num_threads(1)
    rows: list[tuple[object, ...]] = []
    sums: dict[str, list[Tensor]] = {}
    for clip in _clips(config.data):
        for kind, detections in _detections(clip, config.seed):
            bad, named = _judged(clip, detections)
            sums.setdefault(kind, []).append(torch.stack((bad, named)))
            rows.append((clip.name, kind, *shares(bad, named)))
    for kind, parts in sums.items():
        rows.append(("all", kind, *shares(*torch.cat(parts, 1))))
    columns = ("clip", "detections", "frames", "bad", "bad named %", "good named %")
    return Report((Table("frames named by trust", columns, tuple(rows), 0),))


def _clips(data: Path) -> Iterator[Recording]:
    yield from (rendered(data, name) for name in ("dev_tight", "dev_skirt", "dev_coat"))
    yield demo()
    yield from (rendered_views(data, name) for name in ("dev_dance", "dev_views", "dev_duo"))
    man = balancing(data)
    for view in range(man.cameras.views):
        rig = man.rig.select([view])
        seen = man.detections.select([view])
        yield replace(man, name=f"balancing view {view}", rig=rig, detections=seen)


def _detections(clip: Recording, seed: int) -> Iterator[tuple[str, Detections]]:
    yield "given", clip.detections
    if not bool(clip.truth.isfinite().all()):
        return
    rng = np.random.default_rng([seed, clip.truth.shape[0]])
    if not clip.cameras.moving:
        noise = Noise(2.2, 2.5, 2.5, 2.5, 2.5)
        yield "noisy", observed(clip.truth, clip.cameras, rng, noise)
    given = clip.detections
    confidence, frames = given.confidence2d.clone(), given.frame_count
    for _ in range(3):
        start, parts = int(rng.integers(frames)), LIMBS[int(rng.integers(len(LIMBS)))]
        confidence[start : start + int(rng.integers(4, 22)), :, list(parts)] = 0
    trusted = given.trusted3d & (confidence > 0).any(-1)
    yield "parts hidden", replace(given, confidence2d=confidence, trusted3d=trusted)
    if given.views == 1:
        yield "no 3D", Detections.from_joints(given.joints2d, given.confidence2d)


def _judged(clip: Recording, detections: Detections) -> tuple[Tensor, Tensor]:
    """Frames that are bad, and frames that are named, each (F,) bool."""
    found = capture(
        clip.actor, clip.cameras, detections, clip.rate, until=Stage.TRACK_MOTION, workers=1
    )
    assert found.trust is not None
    return bad_frames(found.joints(), clip.truth), found.trust.value < THRESHOLD


if __name__ == "__main__":
    report.main(run, Experiment, "trust")
