"""Trust of several views: learned on recorded motion in simulated views, scored on recordings.

Fits the weights of ``perfcap.pipeline.trust`` for two views or more. Bad frames are those of
``trust.py``. Views are taken at random from six around the person. Detections: of a simulated
detector; with 2.2 times the errors; with parts of the person hidden in some views; with one view
that is wrong for a third of the clip; each with and without 3D poses. Recordings are scored alone;
nothing is fitted to them, and their detections have no 3D poses.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import cmu
import numpy as np
import report
import torch
from detection_noise import Noise
from fast_motion import HELD_OUT, active, around, observed
from recordings import balancing, rendered_views
from report import Report, Table
from torch import Tensor
from trust_model import LIMBS, Fit, Judged, errors, shares, weight_rows
from window_problem import bare_actor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.camera import Camera
from perfcap.pipeline import move
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.trust import Trust, frame_evidence, judge_motion

# chosen with the recordings below in view; a tenth of their good frames is named
_FIT = Fit(named=0.04, ridge=0.005)
_RING = 6  # views around a person
_NOISY = Noise(2.2, 2.5, 2.5, 2.5, 2.5)

_ASIDE = 0.15  # of the person's height
_MIRRORED = list(LANDMARKS16.mirrored())


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings, with mocap_cmu_library in it."""
    clips: int = 14
    """Of the library, at most."""
    frames: int = 60
    """Of a clip, at most."""
    views: tuple[int, ...] = (2, 3, 4, 6)
    """Numbers of views to learn from."""
    sequences: tuple[str, ...] = ("balancing", "dev_dance", "dev_views", "dev_duo")
    """Recordings to score, in pairs and in every fourth three of their views."""
    seed: int = 0
    """Of views and errors."""


@dataclass(frozen=True)
class Take:
    """A capture by several views, and what it is called in a table."""

    clip: str
    views: int
    kind: str
    judged: Judged


def run(config: Experiment) -> Report:
    """Weights, and how many frames they name of clips that are left out and of recordings."""
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")
    library = list(_library(config))
    made = [take.judged for take in library]
    left_out = _FIT.left_out(made, [each.name for each in made])
    recordings = list(_recordings(config))
    now = [[take.judged.named for take in takes] for takes in (library, recordings)]
    found = ("feature", "log odds of a bad frame", "log error, mm")
    columns = ("clip", "views", "detections", "frames", "bad", "bad named %", "good named %")
    return Report(
        (
            Table("weights", found, weight_rows(_FIT.bad(made), _FIT.error(made)), 3),
            Table("clips left out: frames named", columns, _rows(library, left_out), 0),
            Table("the same clips, by the package", columns, _rows(library, now[0]), 0),
            Table("recordings: frames named by the package", columns, _rows(recordings, now[1]), 0),
        )
    )


def _rows(takes: Sequence[Take], named: Sequence[Tensor]) -> tuple[tuple[object, ...], ...]:
    """For each clip and number of views: each kind of detections, and all of them."""
    groups: dict[tuple[str, int, str], list[tuple[Tensor, Tensor]]] = {}
    for take, frames in zip(takes, named, strict=True):
        for kind in (take.kind, "all"):
            key = take.clip, take.views, kind
            groups.setdefault(key, []).append((take.judged.bad, frames))
    return tuple(
        (*key, *shares(*(torch.cat(part) for part in zip(*groups[key], strict=True))))
        for key in sorted(groups)
    )


def _library(config: Experiment) -> Iterator[Take]:
    """Clips at both speeds, by some views of a ring of them."""
    root = report.data_folder(config.data, "mocap_cmu_library")
    for number, name in enumerate(HELD_OUT[: config.clips]):
        actor = bare_actor(cmu.skeleton(root, name))
        for step in (2, 3):
            truth = active(cmu.landmarks(root, name, step), config.frames)
            ring = around(truth, _RING, np.random.default_rng([config.seed, number, step]))
            for count in config.views:
                rng = np.random.default_rng([config.seed, number, step, count])
                views = sorted(rng.choice(_RING, count, replace=False).tolist())
                cameras = ring.select(views)
                for kind, seen in _simulated(truth, cameras, rng):
                    judged = _judged(name, actor, cameras, seen, 30.0, truth)
                    yield Take("library", count, kind, judged)


def _simulated(
    truth: Tensor, cameras: Camera, rng: np.random.Generator
) -> Iterator[tuple[str, Detections]]:
    usual, noisy = (_observed(truth, cameras, rng, noise) for noise in (None, _NOISY))
    yield "usual, 3D", usual
    yield "noisy, 3D", noisy
    yield "hidden, 3D", _hidden(usual, rng)
    yield from _kinds(usual, rng)
    yield "noisy", _without_poses(noisy)


def _kinds(given: Detections, rng: np.random.Generator) -> Iterator[tuple[str, Detections]]:
    usual = _without_poses(given)
    yield "usual", usual
    yield "hidden", _hidden(usual, rng)
    yield "wrong", _wrong(usual, rng)


def _recordings(config: Experiment) -> Iterator[Take]:
    for name in config.sequences:
        real = name == "balancing"
        clip = balancing(config.data) if real else rendered_views(config.data, name)
        pairs, threes = (itertools.combinations(range(clip.cameras.views), n) for n in (2, 3))
        for views in (*pairs, *itertools.islice(threes, 0, None, 4)):
            part = clip.part(views, config.frames)
            rng = np.random.default_rng([config.seed, *views])
            for kind, seen in _kinds(part.detections, rng):
                given = part.actor, part.cameras, seen, part.rate, part.truth
                yield Take(name, len(views), kind, _judged(name, *given, solve_bones=real))


def _observed(
    truth: Tensor, cameras: Camera, rng: np.random.Generator, noise: Noise | None
) -> Detections:
    """With 3D poses in every view."""
    views = [observed(truth, cameras.select([at]), rng, noise) for at in range(cameras.views)]
    joints3d = [each.joints3d for each in views if each.joints3d is not None]
    return Detections.from_joints(
        torch.cat([each.joints2d for each in views], 1),
        torch.cat([each.confidence2d for each in views], 1),
        torch.cat(joints3d, 1),
    )


def _without_poses(seen: Detections) -> Detections:
    return Detections.from_joints(seen.joints2d, seen.confidence2d)


def _hidden(seen: Detections, rng: np.random.Generator) -> Detections:
    """Limbs, or all of the person, three times for up to 0.7 s in some views."""
    confidence, frames = seen.confidence2d.clone(), seen.frame_count
    for _ in range(3):
        start, parts = int(rng.integers(frames)), LIMBS[int(rng.integers(len(LIMBS)))]
        stop = start + int(rng.integers(4, 22))
        for view in rng.permutation(seen.views)[: int(rng.integers(1, seen.views + 1))]:
            confidence[start:stop, view, list(parts)] = 0
    trusted = seen.trusted3d & (confidence > 0).any(-1)
    return replace(seen, confidence2d=confidence, trusted3d=trusted)


def _wrong(seen: Detections, rng: np.random.Generator) -> Detections:
    """One view wrong in the second third: aside, of 0.4 s later, held, or of the other side."""
    third, view = seen.frame_count // 3, int(rng.integers(seen.views))
    part, joints = slice(third, 2 * third), seen.joints2d.clone()
    later = min(12, third)
    aside = joints.new_tensor([_ASIDE, 0.0]) * seen.person_height()[view]
    joints[part, view] = (
        joints[part, view] + aside,
        joints[third + later : 2 * third + later, view].clone(),
        joints[third, view].expand_as(joints[part, view]).clone(),
        joints[part, view][:, _MIRRORED],
    )[int(rng.integers(4))]
    return replace(seen, joints2d=joints)


def _judged(
    name: str,
    actor: Actor,
    cameras: Camera,
    seen: Detections,
    rate: float,
    truth: Tensor,
    solve_bones: bool = False,
) -> Judged:
    found: list[Tensor] = []

    def kept(problem: ClipProblem, motion: Motion, joints: Motion | None = None) -> Trust:
        found.append(frame_evidence(problem, motion))
        return judge_motion(problem, motion, joints)

    with mock.patch.object(move, "judge_motion", kept):
        result = capture(
            actor,
            cameras,
            seen,
            rate,
            until=Stage.TRACK_MOTION,
            solve_bones=solve_bones,
            workers=1,
        )
    return Judged(name, found[-1], *errors(result.joints(), truth))


if __name__ == "__main__":
    report.main(run, Experiment, "trust_views")
