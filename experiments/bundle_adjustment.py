"""Cameras and points together from 20 000 observations: many unknowns that frames share.

Points are the frames of the state (three unknowns each) and cameras what they share: a point is
seen by all cameras, a camera by all points. The first two cameras hold the frame of reference
through a prior on their poses.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import report
import torch
from report import Report, Table
from torch import Tensor

from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.solve import (
    Energy,
    LevenbergMarquardt,
    Linearization,
    Objective,
    Residual,
    Status,
    Step,
    solve,
)

_FOCAL = 1000.0  # px


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    cameras: int = 20
    points: int = 1000
    noise: float = 0.5
    """Of observations, px."""
    seed: int = 0


@dataclass(frozen=True)
class Scene:
    """Points (F, 3) in metres; cameras (6 C,) as rotation vector and translation from the world."""

    points: Tensor
    cameras: Tensor

    @property
    def frame_dim(self) -> int:
        """Coordinates of a point."""
        return 3

    @property
    def shared_sizes(self) -> dict[str, int]:
        """Numbers of all cameras."""
        return {"cameras": self.cameras.shape[-1]}

    def retract(self, step: Step) -> Scene:
        """Add."""
        return Scene(self.points + step.frame, self.cameras + step.shared)

    def local(self, other: Scene) -> Step:
        """Subtract."""
        return Step(other.points - self.points, other.cameras - self.cameras)

    def coordinates(self) -> Step:
        """The numbers themselves."""
        return Step(self.points, self.cameras)

    def project(self) -> Tensor:
        """Pixels (F, C, 2) relative to the principal point."""
        rotation, translation = self.cameras.reshape(-1, 2, 3).unbind(1)
        local = torch.einsum("cij,fj->fci", rotvec_to_matrix(rotation), self.points) + translation
        return _FOCAL * local[..., :2] / local[..., 2:]


class Observed(Energy[Scene]):
    """Squared pixels between projection and observation (F, C, 2)."""

    sees = ("cameras",)

    def __init__(self, seen: Tensor) -> None:
        super().__init__()
        self.register_buffer("seen", seen)
        self.seen: Tensor

    def residual(self, state: Scene) -> Residual:
        """One group a camera, (F, C, 2)."""
        return Residual(state.project() - self.seen)

    def linearize(self, state: Scene) -> Linearization:
        """A row sees one camera, so one tangent of six numbers serves all cameras at once."""

        def moved(tangent: Tensor) -> Tensor:
            cameras = state.cameras + tangent[3:].repeat(len(state.cameras) // 6)
            return Scene(state.points + tangent[:3], cameras).project()

        own = torch.func.jacfwd(moved)(state.points.new_zeros(9))  # F C 2 9
        frames, views = own.shape[:2]
        shared = own.new_zeros(frames, views, 2, views, 6)
        each = torch.arange(views)
        shared[:, each, :, each] = own[..., 3:].transpose(0, 1)
        return Linearization(self.residual(state), own[..., :3], shared.flatten(-2))


class Anchored(Energy[Scene]):
    """The first two cameras stay where they are; every frame carries its share."""

    sees = ("cameras",)

    def __init__(self, scene: Scene) -> None:
        super().__init__(weight=1e6 / len(scene.points))
        self.register_buffer("held", scene.cameras[:12].clone())
        self.held: Tensor

    def residual(self, state: Scene) -> Residual:
        """One group, (F, 1, 12)."""
        off = state.cameras[:12] - self.held
        return Residual(off.expand(len(state.points), 1, 12))


def run(config: Experiment) -> Report:
    """Adjust once, from a start half a metre and some degrees off."""
    torch.set_num_threads(1)
    random = torch.Generator().manual_seed(config.seed)
    truth = _scene(config, random)
    seen = truth.project()
    seen = seen + config.noise * torch.randn(seen.shape, generator=random, dtype=seen.dtype)
    start = _disturbed(truth, random)
    objective = Objective(seen=Observed(seen), anchored=Anchored(truth))
    wall, began = time.perf_counter(), time.process_time()
    found = solve(objective, start, LevenbergMarquardt(tolerance=1e-6))
    cpu, wall = time.process_time() - began, time.perf_counter() - wall
    count = seen[..., 0].numel()
    error = 1e3 * (found.state.points - truth.points).norm(dim=-1).median()
    pixels = (found.state.project() - seen).square().mean().sqrt()
    row = (
        count,
        int(found.steps),
        Status(int(found.status)).name,
        cpu,
        wall,
        float(pixels),
        float(error),
    )
    columns = ("observations", "steps", "status", "CPU s", "wall s", "RMS px", "points, median mm")
    return Report((Table("one thread", columns, (row,), digits=2),))


def _scene(config: Experiment, random: torch.Generator) -> Scene:
    """Cameras on a circle of 5 m around points in a cube of 2 m."""
    points = 2 * torch.rand(config.points, 3, generator=random, dtype=torch.float64) - 1
    turns = torch.arange(config.cameras, dtype=torch.float64) * 2 * math.pi / config.cameras
    rotation = torch.stack((0 * turns, turns - math.pi, 0 * turns), -1)
    translation = torch.tensor([0.0, 0.0, 5.0], dtype=torch.float64).expand_as(rotation)
    return Scene(points, torch.cat((rotation, translation), -1).flatten())


def _disturbed(scene: Scene, random: torch.Generator) -> Scene:
    """Everything moved but the cameras that hold the frame of reference."""
    camera = torch.randn(scene.cameras.shape, generator=random, dtype=torch.float64)
    camera = camera.reshape(-1, 6) * torch.tensor([*3 * [0.05], *3 * [0.2]], dtype=torch.float64)
    camera[:2] = 0
    point = 0.3 * torch.randn(scene.points.shape, generator=random, dtype=torch.float64)
    return replace(scene, points=scene.points + point, cameras=scene.cameras + camera.flatten())


if __name__ == "__main__":
    report.main(run, Experiment, "bundle_adjustment")
