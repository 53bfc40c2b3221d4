"""Frames and limbs that no detector sees: how far off, and how long after (MPC-E11; X12)."""

from __future__ import annotations

from dataclasses import dataclass

import report
import torch
from report import Report
from sweep import Cell, Scores, run_cells, tables
from torch import Tensor
from trials import MotionSweep, recording_of, simulated, track

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.metrics.alignment import root_aligned

_LIMBS = {
    "arm": ("r_elbow", "r_wrist"),
    "both arms": ("r_elbow", "r_wrist", "l_elbow", "l_wrist"),
    "leg": ("l_knee", "l_ankle", "l_toe"),
    "lower body": ("r_knee", "r_ankle", "r_toe", "l_knee", "l_ankle", "l_toe"),
}
_RECOVERED = 1.2  # times the error of the same frame had nothing been hidden, and 10 mm
_SLACK = 10.0  # mm
_STEADY = 5  # frames


@dataclass(frozen=True)
class Experiment(MotionSweep):
    """What to run."""

    lengths: tuple[int, ...] = (1, 5, 15, 30)
    """Frames for which somebody, or a limb, is not seen."""


def run_cell(config: Experiment, cell: Cell) -> Scores:
    """One capture with something hidden in the middle, against one with nothing hidden."""
    recording = recording_of(config, cell.sequence, config.frames)
    what, length = cell.variant.rsplit(", ", 1)
    frames, seen = len(recording.truth), simulated(recording, cell.seed)
    start = (frames - int(length)) // 2
    span = slice(start, start + int(length))
    joints = [LANDMARKS.index(n) for n in _LIMBS[what]] if what in _LIMBS else range(16)
    errors = []
    for detections in (seen, hidden(seen, span, list(joints))):
        found = track(recording, detections).joints()
        apart = root_aligned(found) - root_aligned(recording.truth)
        errors.append(1000 * apart.norm(dim=-1)[:, list(joints)].mean(-1))
    plain, spoiled = errors
    bad = spoiled > _RECOVERED * plain + _SLACK
    return {
        "hidden, mm": float(spoiled[span].mean()),
        "else, mm": float(plain[span].mean()),
        "peak, mm": float(spoiled[span].max()),
        "frames to recover": float(_recovery(bad[span.stop :])),
    }


def _recovery(bad: Tensor) -> int:
    """Frames (F,) until some in a row are good again; all of them if they never are."""
    for frame in range(len(bad) - _STEADY + 1):
        if not bool(bad[frame : frame + _STEADY].any()):
            return frame
    return len(bad)


def hidden(detections: Detections, span: slice, joints: list[int]) -> Detections:
    """Detections without some joints in some frames; their 3D poses are gone as a whole."""
    confidence = detections.confidence2d.clone()
    confidence[span, :, joints] = 0
    places = None
    if detections.joints3d is not None:
        places = detections.joints3d.clone()
        places[span] = torch.nan
    return Detections.from_joints(detections.joints2d, confidence, places)


def run(config: Experiment) -> Report:
    """The table."""
    variants = [f"{what}, {n}" for what in ("person", *_LIMBS) for n in config.lengths]
    found = run_cells("occlusion", config, variants, run_cell)
    notes = (
        "Mean error of the hidden joints, root-relative, in the frames in which they are hidden "
        "and had they been seen; the worst frame; and how many frames after the gap it takes until "
        f"{_STEADY} in a row have at most {_RECOVERED:g} times the error they would have, or "
        f"{_SLACK:g} mm more.",
    )
    return Report(tables("hidden for n frames", found), notes)


if __name__ == "__main__":
    report.main(run, Experiment, "occlusion")
