"""Limits of angles: large published ones, or what is usual among healthy adults.

A hard limit that a person goes beyond is paid for elsewhere: the pelvis tilts, feet and hips move
off. The recorded motion of ``fast_motion.py``, and
rendered people; detections with errors, and exact ones, where limits are all that is left besides
the rig and the temporal prior.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import fast_motion
import numpy as np
import report
import torch
from detection_noise import Noise
from recordings import Recording, exact_detections, rendered, rendered_views
from report import Report, Table
from torch import Tensor
from window_problem import bare_actor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import usual_ranges
from perfcap.actor.rig import Rig, with_limits
from perfcap.actor.skeleton import Skeleton
from perfcap.errors import InputError
from perfcap.io.moving_rig import MovingRig, read_moving_rig
from perfcap.metrics import joint_errors
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.jobs import capture

_SEQUENCES = ("dev_tight", "dev_skirt", "dev_coat")
_SEVERAL = ("dev_dance", "dev_views", "dev_duo/1", "dev_duo/2")


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    clips: int = 14
    """Of the library, at most."""
    views: tuple[int, ...] = (1, 4, 8)
    """Numbers of views of recorded motion."""
    frames: int = 60
    """Of a clip of recorded motion."""
    sequences: tuple[str, ...] = (*_SEQUENCES, *_SEVERAL)
    """Rendered, in one view or several."""
    unseen: int = 1000
    """Recordings of another library, at most; no limit was chosen with them in view."""


def run(config: Experiment) -> Report:
    """Both limits on everything."""
    torch.set_num_threads(1)
    recorded = [
        row for exact in (False, True) for views in config.views
        for row in _recorded(config, views, exact)
    ]  # fmt: skip
    seen = [_rendered(recording) for recording in _recordings(config)]
    columns = ("views", "detections", "limits", "median, mm", "90 %", "clips not worse")
    each = ("sequence", "usual, mm", "largest", "exact, usual", "largest ")
    notes = (
        "Distances in the world, of one view after a similarity; not worse than with usual limits.",
    )
    columns_unseen = ("views", "detections", "clips", "usual, mm", "largest ", "not worse")
    unseen = [
        _unseen(config, views, exact)
        for exact in (False, True) for views in config.views if config.unseen
    ]  # fmt: skip
    tables = (
        Table("recorded motion of another library", columns_unseen, tuple(unseen), 2),
        Table("recorded motion", columns, tuple(recorded), 2),
        Table("rendered people", each, tuple(seen), 2),
    )
    return Report(tables, notes)


def _recorded(config: Experiment, views: int, exact: bool) -> Iterator[tuple[object, ...]]:
    setting = fast_motion.Experiment(
        data=config.data, clips=config.clips, frames=config.frames, exact=exact
    )
    found: dict[str, list[float]] = {"usual": [], "largest": []}
    for take in fast_motion.takes(setting, views):
        usual = replace(take, actor=bare_actor(Skeleton(usual_limits(take.actor.skeleton.rig))))
        for name, each in (("usual", usual), ("largest", take)):
            error = joint_errors(fast_motion.tracked(each, PoseConfig()), take.truth, 30.0)
            found[name].append(float(error.mpjpe if views > 1 else error.mpjpe_similarity))
    kept = sum(a <= b for a, b in zip(found["largest"], found["usual"], strict=True))
    for name, errors in found.items():
        share = f"{kept} of {len(errors)}" if name == "largest" else ""
        kind = "exact" if exact else "with errors"
        yield views, kind, name, *np.quantile(errors, (0.5, 0.9)).tolist(), share


def _unseen(config: Experiment, views: int, exact: bool) -> tuple[object, ...]:
    """Medians of both over clips of Bandai Namco, at 30 Hz, but for those that are refused."""
    paths = sorted(report.data_folder(config.data, "mocap_bandai_bvh").glob("*.bvh"))
    errors = []
    for number, path in enumerate(paths[: config.unseen]):
        try:
            rig = read_moving_rig(path)
        except InputError:  # a figure that stands upright in no frame
            continue
        truth = fast_motion.active(_landmarks(rig), config.frames)
        rng = np.random.default_rng([number, views])
        cameras = fast_motion.around(truth, views, rng)
        noise = Noise(0, 0, 0, 0, 0) if exact else None
        seen = fast_motion.observed(truth, cameras, rng, noise)
        pair = []
        for own in (usual_limits(rig.actor.skeleton.rig), rig.actor.skeleton.rig):
            take = fast_motion.Take(path.stem, bare_actor(Skeleton(own)), cameras, seen, truth)
            error = joint_errors(fast_motion.tracked(take, PoseConfig()), truth, 30.0)
            pair.append(float(error.mpjpe if views > 1 else error.mpjpe_similarity))
        errors.append(pair)
    usual, largest = np.array(errors).T
    kept = f"{int((largest <= usual).sum())} of {len(errors)}"
    kind = "exact" if exact else "with errors"
    return views, kind, len(errors), float(np.median(usual)), float(np.median(largest)), kept


def _landmarks(moving: MovingRig) -> Tensor:
    """Landmarks that ride on a rig's joints, (F, 16, 3) m, 30 a second."""
    rig = moving.actor.skeleton.rig
    joints = list(rig.landmark_joints)
    offsets = (rig.landmark_positions - rig.positions[joints]).double()
    step = max(1, round(moving.rate / 30))
    turn, place = (
        torch.tensor(each[::step][:, joints]) for each in (moving.rotation, moving.position)
    )
    return place.double() + (turn.double() @ offsets[..., None])[..., 0]


def usual_limits(rig: Rig) -> Rig:
    """The rig with what is usual as hard limits."""
    ends = zip(rig.hinges, *(each.tolist() for each in usual_ranges(rig)), strict=True)
    return with_limits(rig, {hinge.name: (low, high) for hinge, low, high in ends})


def _recordings(config: Experiment) -> Iterator[Recording]:
    for name in config.sequences:
        folder, _, person = name.partition("/")
        if name in _SEQUENCES:
            yield rendered(config.data, name)
        else:
            several = rendered_views(config.data, folder, int(person or 1))
            yield replace(several, name=name)


def _rendered(recording: Recording) -> tuple[object, ...]:
    own = recording.actor
    usual = Actor(own.template, usual_limits(own.skeleton.rig))
    errors = []
    for detections in (recording.detections, exact_detections(recording)):
        for actor in (usual, own):
            found = capture(actor, recording.cameras, detections, recording.rate)
            distance = found.joints() - recording.truth
            errors.append(1e3 * float(distance.norm(dim=-1).nanmean()))
    return recording.name, *errors


if __name__ == "__main__":
    report.main(run, Experiment, "angle_limits")
