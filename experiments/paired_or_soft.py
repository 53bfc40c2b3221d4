"""Contours paired, or soft silhouettes overlapped: from how far, and at what price?

Poses of the demo clip are disturbed at random, and pulled back onto their own exact silhouettes
in two views at a right angle. Nothing but a weak hold on the joints helps.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import report
import torch
from recordings import demo, demo_motion
from report import Report, Table
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.silhouette_overlap import SilhouetteOverlap
from perfcap.geometry.camera import Camera
from perfcap.pipeline.objective import angle_bounds, kernel
from perfcap.pipeline.sight import Sight, View
from perfcap.pipeline.surface_config import ContourConfig
from perfcap.render import SoftSilhouette, look_at
from perfcap.segment import extract_contour, stack
from perfcap.solve import Adam, Energy, LevenbergMarquardt, Objective, Step, solve

_SIZE, _FOCAL, _DISTANCE = (400, 400), 600.0, 4.0  # px, px, m
_HOLD = 0.3  # m, a deviation of joints from where they start
_NEAR = 0.02  # m, mean error of the joints from which a pose counts as found


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    poses: int = 12
    """Of the demo clip, evenly spread."""
    disturbances: tuple[float, ...] = (0.05, 0.1, 0.2, 0.3)
    """Mean displacement of the joints, m."""
    band: float = 6.0
    """Half the width of the soft silhouettes' band, px."""
    rounds: int = 6
    """Searches for pairs."""
    seed: int = 0
    """Of the disturbances."""


def run(config: Experiment) -> Report:
    """Disturb, pull back, compare."""
    torch.set_num_threads(1)
    trial = _Trial(config)
    methods: dict[str, Callable[[Motion], Motion]] = {
        f"pairs of contours, {config.rounds} rounds": trial.paired,
        "soft silhouettes, Levenberg-Marquardt": partial(
            trial.soft, method=LevenbergMarquardt(max_steps=30)
        ),
        "soft silhouettes, Adam": partial(
            trial.soft, method=Adam(max_steps=150, learning_rate=0.01)
        ),
        "pairs, then soft": lambda start: trial.soft(
            trial.paired(start), LevenbergMarquardt(max_steps=30)
        ),
    }
    trial.paired(trial.truth[:1])  # compile
    trial.soft(trial.truth[:1], LevenbergMarquardt(max_steps=1))
    tables = []
    for size in config.disturbances:
        start = trial.disturbed(size)
        rows = [("disturbed", *trial.score(start), 0.0)]
        for name, method in methods.items():
            began = time.process_time()
            found = method(start)
            spent = 1e3 * (time.process_time() - began) / config.poses
            rows.append((name, *trial.score(found), spent))
        columns = ("method", "joints, median mm", "worst mm", "found %", "CPU ms a pose")
        tables.append(Table(f"disturbed by {100 * size:g} cm", columns, tuple(rows)))
    return Report(tuple(tables))


class _Trial:
    """Poses, their silhouettes, and ways back to them."""

    def __init__(self, config: Experiment) -> None:
        self.config, self.actor = config, demo().actor
        motion = demo_motion()
        self.truth = motion[:: motion.frames // config.poses][: config.poses]
        self.joints = self.actor.joints(self.truth)
        self.cameras = _cameras(self.joints)
        faces = torch.as_tensor(self.actor.template.faces.copy())
        self.weld = self.actor.template.weld()[0]
        self.sight = Sight(self.cameras, faces, self.weld)
        drawn = self._look(self.truth)
        self.masks = torch.stack(
            [torch.stack([torch.from_numpy(v.mask) for v in row]) for row in drawn]
        )
        self.contours = [[extract_contour(v.mask) for v in row] for row in drawn]
        self.heights = [float(_FOCAL / _DISTANCE * 1.75)] * 2

    def disturbed(self, size: float) -> Motion:
        """Poses with joints off by ``size`` in the mean, within the limits of angles."""
        rng = torch.Generator().manual_seed(self.config.seed)
        scale = torch.cat((torch.full((3,), 0.3), torch.full((3,), 0.3), torch.ones(27)))
        step = torch.randn(self.truth.frames, 33, generator=rng, dtype=torch.float64) * scale
        shift, moved = 0.5 * size, self.truth
        for _ in range(12):  # to the length wanted: displacement is nearly linear in the step
            moved = self._moved(step * shift)
            shift *= size / float(self._errors(moved).mean())
        return moved

    def _moved(self, step: Tensor) -> Motion:
        moved = self.truth.retract(Step(step, step.new_zeros(0)))
        limits = self.actor.skeleton
        angles = moved.angles.clamp(limits.lower, limits.upper)
        return Motion(moved.translation, moved.rotation, angles)

    def score(self, motion: Motion) -> tuple[float, float, float]:
        """Median and worst of the poses' mean joint errors, mm; share of poses found, %."""
        errors = self._errors(motion)
        return (
            1e3 * float(errors.median()),
            1e3 * float(errors.max()),
            100 * float((errors < _NEAR).double().mean()),
        )

    def _errors(self, motion: Motion) -> Tensor:
        apart: Tensor = (self.actor.joints(motion) - self.joints).norm(dim=-1)
        return apart.mean(-1)

    def _look(self, motion: Motion) -> list[list[View]]:
        with torch.no_grad():
            return self.sight.look(self.actor.surface(motion), slice(0, motion.frames))

    def paired(self, start: Motion) -> Motion:
        """Correspondences between contours, searched anew in every round."""
        config, motion = ContourConfig(), start
        unit = torch.tensor(self.heights, dtype=torch.float64) * 0.01 * config.deviation
        for _ in range(self.config.rounds):
            matches = [
                self.sight.correspond(row, lines, config, self.heights)
                for row, lines in zip(self._look(motion), self.contours, strict=False)
            ]
            pairs = stack(matches, motion.angles)
            corners, shares = pairs.vertices.flatten(-3, -2), pairs.weights.flatten(-3, -2)
            points = SkinnedPoints(self.actor, corners, shares)
            contour = ContourAlignment(
                points, self.cameras, pairs, config.weight, kernel(config.scale), unit
            )
            motion = self._solve(contour, start, motion, LevenbergMarquardt(max_steps=5))
        return motion

    def soft(self, start: Motion, method: LevenbergMarquardt | Adam) -> Motion:
        """The overlap of soft silhouettes with the masks."""
        weld = torch.as_tensor(self.weld)
        silhouette = SoftSilhouette(self.sight.faces, _SIZE, self.config.band, weld)
        overlap = SilhouetteOverlap(
            self.actor.surface,
            silhouette,
            self.cameras,
            self.masks[: start.frames],
            weight=3000.0,
            points=partial(SkinnedPoints, self.actor),
        )
        return self._solve(overlap, start, start, method)

    def _solve(
        self,
        silhouettes: Energy[Motion],
        held: Motion,
        start: Motion,
        method: LevenbergMarquardt | Adam,
    ) -> Motion:
        hold = JointTarget(
            self.actor.landmarks, self.actor.joints(held).unsqueeze(-3), weight=1 / 16, unit=_HOLD
        )
        objective = Objective({"silhouettes": silhouettes, "hold": hold}).to(start.angles)
        return solve(objective, start, method, angle_bounds(self.actor)).state


def _cameras(joints: Tensor) -> Camera:
    """Two fixed views at a right angle that see all poses."""
    middle = joints.mean((0, 1))
    eyes = middle + _DISTANCE * torch.eye(3).to(middle)[[2, 0]]
    rotation, translation = look_at(eyes, middle, torch.tensor([0.0, 1.0, 0.0]).to(middle))
    height, width = _SIZE
    intrinsics = torch.tensor(
        [[_FOCAL, 0.0, width / 2], [0.0, _FOCAL, height / 2], [0.0, 0.0, 1.0]]
    ).to(middle)
    return Camera(intrinsics.expand(2, 3, 3), rotation, translation, size=(_SIZE, _SIZE))


if __name__ == "__main__":
    report.main(run, Experiment, "paired_or_soft")
