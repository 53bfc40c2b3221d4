"""Gradients through a bounded pose window reach all that it is made of, and are exact."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import pytest
import torch
from polish import minimum
from synthetic import actor, cameras, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy import JointPosition, JointTarget, PosePrior, Reprojection, Trajectory
from perfcap.pipeline.objective import angle_bounds
from perfcap.solve import GemanMcClure, Implicit, LevenbergMarquardt, Objective, Sensitivity, solve

F64 = torch.float64
FRAMES = 3
TIGHT = LevenbergMarquardt(300, 1e-14)


def normal(*shape: int, seed: int = 1) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


@dataclass(frozen=True)
class Window:
    """What a window is made of, any of which may carry a graph."""

    joints2d: Tensor
    confidence2d: Tensor
    joints3d: Tensor
    weight: Tensor
    intrinsics: Tensor
    rotation: Tensor
    translation: Tensor
    distortion: Tensor
    bones: Tensor
    unit: Tensor
    unit3d: Tensor
    smoothness: Tensor
    smooth_angles: Tensor
    mean: Tensor
    reference: Tensor

    def objective(self) -> Objective:
        person = actor()
        person.skeleton.tree.bone_vectors = self.bones
        camera = replace(
            cameras(2),
            intrinsics=self.intrinsics,
            rotation=self.rotation,
            translation=self.translation,
            distortion=self.distortion,
        )
        seen = Detections.from_joints(self.joints2d, self.confidence2d, self.joints3d)
        robust, joints = GemanMcClure(3.0), person.landmarks
        return Objective(
            joints2d=Reprojection(joints, camera, seen, self.weight, robust, self.unit),
            joints3d=JointPosition(joints, camera, seen, 0.5, robust, self.unit3d),
            trajectory=Trajectory(
                FRAMES, 2, self.smoothness, translation=50.0, rotation=20.0,
                angles=self.smooth_angles,
            ),
            prior=PosePrior(self.mean, 0.8, 0.3),
            hold=JointTarget(joints, self.reference.unsqueeze(-3), weight=0.5 / 16, unit=0.2),
        )  # fmt: skip


def window() -> tuple[Window, Motion]:
    """Two poses that slide along, some of whose angles are at their limits."""
    person = actor()
    skeleton = person.skeleton
    pose = random_motion(skeleton, 1, (2,), seed=3)
    move = 0.02 * torch.arange(FRAMES, dtype=F64)[:, None]
    truth = Motion(
        0.3 * pose.translation + move,
        0.4 * pose.rotation + move,
        # pose angles beyond the limits, so that the limits act
        skeleton.rest_angles + 1.3 * (pose.angles - skeleton.rest_angles) + move,
    )
    camera = replace(
        cameras(2), distortion=normal(2, 5) * torch.tensor([0.05, 0.02, 0.001, 0.001, 0.01])
    )
    joints = person.joints(truth)
    local = camera.to_camera(joints)
    root = 0.5 * (local[..., 8:9, :] + local[..., 12:13, :])
    pixels = camera.project(joints)
    values = Window(
        joints2d=pixels + 3 * normal(*pixels.shape),
        confidence2d=0.3 + 0.7 * normal(*pixels.shape[:-1]).sigmoid(),
        joints3d=local - root + 0.02 * normal(*local.shape),
        weight=torch.tensor([1.0, 0.7], dtype=F64),
        intrinsics=camera.intrinsics,
        rotation=camera.rotation,
        translation=camera.translation,
        distortion=camera.distortion,
        bones=skeleton.tree.bone_vectors.clone(),
        unit=torch.tensor([3.0, 4.0], dtype=F64),
        unit3d=torch.linspace(0.03, 0.06, 16, dtype=F64),
        smoothness=torch.tensor(0.2, dtype=F64),
        smooth_angles=torch.linspace(5, 15, 27, dtype=F64),
        mean=skeleton.rest_angles.clone(),
        reference=joints + 0.03 * normal(*joints.shape),
    )
    start = Motion(truth.translation, truth.rotation, truth.angles)
    return values, start


WINDOW, START = window()
BOUNDS = angle_bounds(actor())
NAMES = tuple(WINDOW.__dataclass_fields__)


@cache
def solved() -> Motion:
    with torch.no_grad():
        return minimum(WINDOW.objective(), START, BOUNDS)


def loss(state: Motion) -> Tensor:
    """Something that sees every unknown."""
    parts = state.translation, state.rotation, state.angles
    return sum((part * normal(*part.shape, seed=9)).sum() for part in parts)


def gradient(
    name: str, adjoint: Implicit, start: Motion | None = None
) -> tuple[Tensor, Sensitivity]:
    leaf = getattr(WINDOW, name).clone().requires_grad_()
    objective = replace(WINDOW, **{name: leaf}).objective()
    solution = solve(objective, start or solved(), LevenbergMarquardt(0), BOUNDS, adjoint)
    (found,) = torch.autograd.grad(loss(solution.state), leaf)
    return found, solution.sensitivity


def difference(name: str, direction: Tensor, size: float) -> float:
    """Central difference of the loss at minima that are found anew."""

    def at(change: float) -> Tensor:
        moved = getattr(WINDOW, name) + change * direction
        return loss(minimum(replace(WINDOW, **{name: moved}).objective(), solved(), BOUNDS))

    return float((at(size) - at(-size)) / (2 * size))


def test_bounds_act() -> None:
    lower, upper = BOUNDS.lower.frame, BOUNDS.upper.frame
    here = solved().coordinates().frame
    assert int(((here <= lower) | (here >= upper)).sum()) >= 10


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_full_hessian_is_exact(name: str) -> None:
    value = getattr(WINDOW, name)
    direction = normal(*value.shape, seed=5) * value.abs().mean()
    if name == "bones":
        direction[0] = 0  # the root has no bone
    if name == "intrinsics":
        direction[..., 2, :] = 0  # of any camera 0 0 1
    slope, sensitivity = gradient(name, Implicit())
    assert (sensitivity == Sensitivity.EXACT).all()
    along = float((slope * direction).sum())
    expected = difference(name, direction, 1e-4)
    assert abs(along - expected) <= 1e-4 * abs(expected), (along, expected)
