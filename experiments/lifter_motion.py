"""A lifter on recorded motion of people it has not learned from, with simulated detections."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import report
import torch
from report import Report, Table, data_folder

from perfcap.detect.lifter import OnnxLifter
from perfcap.geometry.alignment import similarity_align
from perfcap.train.config import DetectorNoise, LiftingData
from perfcap.train.detector_noise import corrupt
from perfcap.train.lifting_data import STANDING, look_at, root_relative
from perfcap.train.motion_library import MotionLibrary, Recording

_MM = 1000.0
# as measured on a real recording (``detector_noise.py``), and a half more
_MEASURED = replace(DetectorNoise(), spread=0.0, slips=0.0, absent=0.0, hidden=0.0)
_NOISES = (("measured", _MEASURED), ("as trained", DetectorNoise()))
_BANDS = (0.0, 0.03, 0.05, 0.08, 0.12, 0.2, 10.0)  # m, of expected errors


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    lifter: Path = Path(__file__).parents[1] / "models" / "lifters" / "cmu"
    """The lifter's folder."""
    people: tuple[str, ...] = ("06", "07")
    """Whom it has not learned from; the best weights were chosen by 07."""
    cameras: int = 8
    """Random ones that see each clip."""


@dataclass(frozen=True)
class Errors:
    """Of one clip in all cameras, metres: distances, aligned ones, expected ones, (N, F, 16)."""

    root: torch.Tensor
    aligned: torch.Tensor
    expected: torch.Tensor


def run(config: Experiment) -> Report:
    """Errors of each clip, and how errors go with what is expected."""
    library = MotionLibrary.read(data_folder(config.data, "mocap_cmu_library")).of(config.people)
    lifter = OnnxLifter(config.lifter)
    found = {
        name: {clip: _errors(lifter, clip, noise, config.cameras) for clip in library.recordings}
        for name, noise in _NOISES
    }
    people = [
        (f"{person}, {name}", *_means([e for clip, e in errors.items() if clip.subject == person]))
        for person in config.people
        for name, errors in found.items()
    ]
    measured = found[_NOISES[0][0]]
    clips = [(clip.name, len(clip.landmarks) // 2, *_means([e])) for clip, e in measured.items()]
    columns = ("MPJPE", "PA-MPJPE", "expected")
    notes = (
        "Errors as measured are OpenPose's on a real recording, and a half more. As trained: their "
        "size also differs by a factor of exp(0.5 N(0, 1)) from clip to clip, and crown, toes or a "
        "limb may be unseen for a whole clip.",
    )
    return Report(
        (
            Table("root-relative, mm, at 30 Hz", ("person, detections", *columns), tuple(people)),
            Table("detections as measured, mm", ("clip", "frames", *columns), tuple(clips)),
            _calibration(list(measured.values())),
        ),
        notes,
    )


def _errors(lifter: OnnxLifter, clip: Recording, noise: DetectorNoise, cameras: int) -> Errors:
    generator = torch.Generator().manual_seed(int(clip.name.replace("_", "")))
    world = clip.landmarks[::2].expand(cameras, -1, -1, -1)
    camera = look_at(world, LiftingData(), generator)
    plane = camera[..., :2] / camera[..., 2:]
    unit = 0.01 * STANDING / camera[..., 2].mean(-1)
    tracks, confidence = corrupt(plane, unit, noise, generator)
    joints, spread = lifter.lift_tracks(tracks, confidence)
    truth = root_relative(camera)
    return Errors(
        (joints - truth).norm(dim=-1),
        (similarity_align(joints, truth) - truth).norm(dim=-1),
        spread,
    )


def _means(errors: list[Errors]) -> tuple[float, ...]:
    """Means over all frames and cameras, mm."""
    parts = (
        [getattr(e, name).flatten() for e in errors] for name in ("root", "aligned", "expected")
    )
    return tuple(_MM * float(torch.cat(part).mean()) for part in parts)


def _calibration(errors: list[Errors]) -> Table:
    """Errors of joints by what is expected of them."""
    expected = torch.cat([e.expected.flatten() for e in errors])
    actual = torch.cat([e.root.flatten() for e in errors])
    rows = []
    for low, high in pairwise(_BANDS):
        inside = (expected >= low) & (expected < high)
        if inside.any():
            name = f"{_MM * low:.0f} to {_MM * high:.0f}" if high < 1 else f"over {_MM * low:.0f}"
            share = 100 * float(inside.float().mean())
            mean, guess = (_MM * float(v[inside].mean()) for v in (actual, expected))
            rows.append((name, share, guess, mean))
    columns = ("expected, mm", "share of joints, %", "mean expected, mm", "mean error, mm")
    return Table("how far the expected error can be trusted", columns, tuple(rows))


if __name__ == "__main__":
    report.main(run, Experiment, "lifter_motion")
