"""Left and right exchanged in 3D poses of short clips: how often that is named, and of right ones.

Stretches of clips of the CMU library, as a simulated detector of 2D and 3D joints sees them, and as
the shipped lifter makes poses of the 2D joints alone. What is named of right poses is a false
alarm. ``examine_sides`` is what captures and doctor ask. Its thresholds were chosen with the same
clips in view.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import late_poses
import report
import torch
from report import Report, Table
from torch import Tensor

from perfcap.app.networks import LIFTERS, find_model
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.lifter import OnnxLifter
from perfcap.io.doctor import Severity
from perfcap.io.doctor.sides import examine_sides

_MIRRORED = list(LANDMARKS16.mirrored())


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    clips: int = 1000
    """Of the library, at most."""
    lengths: tuple[int, ...] = (1, 2, 4, 5, 8, 16, 30, 60)
    """Frames of the stretches."""
    seed: int = 0
    """Of errors of the detector."""


def run(config: Experiment) -> Report:
    """A row for each length of stretches, and each origin of the poses."""
    torch.set_num_threads(1)
    lifter = OnnxLifter(find_model("cmu", LIFTERS))
    like = late_poses.Experiment(data=config.data, clips=config.clips, seed=config.seed)
    tracks = list(late_poses.read_tracks(like))
    rows = []
    for length in config.lengths:
        stretches = [part for track in tracks for part in _stretches(track, length)]
        given = [poses for poses, _, _ in stretches]
        lifted = [lifter.lift_tracks(*_seen(each))[0][0].double() for each in stretches]
        rows.append(("detector", length, len(given), *_named(given)))
        rows.append(("lifter", length, len(lifted), *_named(lifted)))
    kinds = ("refused", "warned")
    columns = (
        *("poses of a", "frames", "stretches"),
        *(f"{what}: {kind}, %" for what in ("right", "exchanged") for kind in kinds),
    )
    return Report((Table("left and right of 3D poses", columns, tuple(rows), 2),))


def _stretches(track: late_poses.Track, length: int) -> Iterator[late_poses.Track]:
    """Poses, joints on the plane and confidence of so many frames each, eight frames apart."""
    poses, plane, sure = track
    for start in range(0, len(poses) - length + 1, max(length, 8)):
        part = slice(start, start + length)
        known = poses[part].isfinite().flatten(1).all(-1)[:, None, None]
        yield torch.where(known, poses[part], torch.nan), plane[part], sure[part]


def _seen(stretch: late_poses.Track) -> tuple[Tensor, Tensor]:
    """Joints on the plane and confidence, as the lifter takes them."""
    return stretch[1][None].float(), stretch[2][None].float()


def _named(clips: list[Tensor]) -> Iterator[float]:
    """Percent of the clips that are refused, and warned of, as they are and exchanged."""
    for order in (list(range(len(_MIRRORED))), _MIRRORED):
        found = [[each.severity for each in examine_sides("", clip[:, order])] for clip in clips]
        for severity in (Severity.ERROR, Severity.WARNING):
            yield 100 * sum(severity in each for each in found) / len(clips)


if __name__ == "__main__":
    report.main(run, Experiment, "sides_of_clips")
