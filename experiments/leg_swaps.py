"""Legs exchanged in one of four views for one to four frames (Huang et al. 2017, Fig. 3): undone?

Recorded motion on which no setting was chosen, in four views of a simulated detector that makes no
such mistakes of its own. In one view, both legs change sides in one stretch of a clip. A leg joint
of the result is swapped where it is nearer to the other side's truth than to its own, while these
are 10 cm apart or more. Of stretches without a plant, none should be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cmu
import numpy as np
import report
import torch
from detection_noise import Noise
from fast_motion import HELD_OUT, Take, active, around, observed, tracked
from report import Report, Table
from torch import Tensor
from window_problem import bare_actor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.triangulation import triangulate
from perfcap.pipeline.config import MUVS_POSE, PoseConfig

_LEGS = [[LANDMARKS.index(f"{s}_{n}") for n in ("knee", "ankle", "toe")] for s in "lr"]
_CHAIN = [[LANDMARKS.index(f"{s}_{n}") for n in ("hip", "knee", "ankle", "toe")] for s in "lr"]
_APART = 0.1  # m
_LENGTHS = (1, 2, 3, 4)


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    views: int = 4
    """Cameras."""
    seeds: int = 12
    """Of cameras, noise and plants; each takes another clip."""
    frames: int = 60
    """Of a clip, at most."""


def run(config: Experiment) -> Report:
    """A row for each method and length."""
    torch.set_num_threads(1)
    counts: dict[tuple[str, int], list[int]] = {}
    for seed in range(config.seeds):
        take, planted = plant(config, seed)
        for method, joints in _methods(take).items():
            wrong = exchanged(joints, take.truth)
            for length, (view_frames, shown) in planted.items():
                row = counts.setdefault((method, length), [0, 0])
                row[0] += int(shown.sum())
                row[1] += int((wrong[view_frames] & shown).sum())
            rest = torch.ones(len(joints), dtype=torch.bool)
            for view_frames, _ in planted.values():
                rest[max(0, view_frames.start - 2) : view_frames.stop + 2] = False
            made = counts.setdefault((method, 0), [0, 0])
            made[0] += int(rest.sum()) * 3
            made[1] += int(wrong[rest].sum())
    rows = []
    for method in ("capture", "muvs2017", "triangulation"):
        shares = [_share(counts[method, length]) for length in _LENGTHS]
        all_, kept = (sum(counts[method, n][i] for n in _LENGTHS) for i in (0, 1))
        made = counts[method, 0]
        undone = 100 * (1 - kept / max(1, all_))
        rows.append((method, *shares, undone, f"{made[1]} of {made[0]}"))
    columns = ("method", *(f"{n} frames" for n in _LENGTHS), "all, %", "made elsewhere")
    title = f"joints of exchanged legs undone, %, one of {config.views} views"
    return Report((Table(title, columns, tuple(rows)),))


def plant(config: Experiment, seed: int) -> tuple[Take, dict[int, tuple[slice, Tensor]]]:
    """A take, and by length the frames and the joints (n, 3) whose sides are told apart."""
    root = report.data_folder(config.data, "mocap_cmu_library")
    name = HELD_OUT[seed % len(HELD_OUT)]
    truth = active(cmu.landmarks(root, name, 2), config.frames)
    rng = np.random.default_rng([seed, 20])
    cameras = around(truth, config.views, rng)
    seen = observed(truth, cameras, rng, Noise(swaps=0))
    pixels = seen.joints2d.clone()
    planted = {}
    gap = len(truth) // (len(_LENGTHS) + 1)
    for place, length in enumerate(_LENGTHS):
        start = (place + 1) * gap - 2
        part = slice(start, start + length)
        view = int(rng.integers(config.views))
        for own, other in (_CHAIN, _CHAIN[::-1]):
            pixels[part, view, own] = seen.joints2d[part, view][:, other]
        planted[length] = part, _apart(truth[part])
    moved = replace(seen, joints2d=pixels)
    detections = Detections.from_joints(moved.joints2d, moved.confidence2d)
    actor = bare_actor(cmu.skeleton(root, name))
    return Take(name, actor, cameras, detections, truth), planted


def exchanged(joints: Tensor, truth: Tensor) -> Tensor:
    """Pairs (F, 3) of which a joint lies nearer to the other side's place, far enough apart."""
    own, other = (truth[:, legs] for legs in _LEGS)
    wrong = torch.zeros(len(truth), 3, dtype=torch.bool)
    for legs, (mine, theirs) in zip(_LEGS, ((own, other), (other, own)), strict=True):
        found = joints[:, legs].nan_to_num(1e3)
        wrong |= (found - theirs).norm(dim=-1) < (found - mine).norm(dim=-1)
    return wrong & _apart(truth)


def _apart(truth: Tensor) -> Tensor:
    left, right = (truth[:, legs] for legs in _LEGS)
    apart: Tensor = (left - right).norm(dim=-1)
    return apart > _APART


def _methods(take: Take) -> dict[str, Tensor]:
    plane = take.cameras.to_plane(take.detections.joints2d)
    points, _ = triangulate(take.cameras, plane, take.detections.confidence2d)
    configs = {"capture": PoseConfig(), "muvs2017": MUVS_POSE}
    found = {name: tracked(take, config) for name, config in configs.items()}
    return {**found, "triangulation": points}


def _share(count: list[int]) -> float:
    return 100 * (1 - count[1] / max(1, count[0]))


if __name__ == "__main__":
    report.main(run, Experiment, "leg_swaps")
