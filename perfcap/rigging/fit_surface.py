"""Pose and shape of a body model in a bare mesh of a person in any clothes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import human_rig
from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.detect.joint_set import LANDMARKS
from perfcap.energy.prior import PosePrior, SharedPrior
from perfcap.rigging.surface_match import (
    Matches,
    SurfaceMatch,
    TargetSurface,
    spread,
    vertex_normals,
)
from perfcap.rigging.view_landmarks import SeenLandmarks
from perfcap.setting_checks import Settings
from perfcap.solve import Bounds, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.kernels import GemanMcClure

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_MOST_DEVIATIONS = 4.0


@dataclass(frozen=True)
class FitSettings(Settings):
    """How a body is fitted to a mesh; lengths in metres.

    Attributes:
        arms: angles between the upper arms and straight down that are tried first, degrees.
        screened: how many of them, the likeliest, are fitted in ``first`` rounds each.
        first: see there.
        rounds: of correspondence and solve from the best of those on.
        steps: of the solver a round.
        reach: residual at which a match begins to be ignored, in the first and the last round.
        samples: of the body, and of the mesh.
        beneath: trust of a body inside the mesh, against 1 for a body outside: clothes hide it.
        hands: trust of hands, which may be open or closed.
        landmarks: weight of the mean squared distance from landmarks that were seen, against 1 for
            that of the surfaces from each other.
        shape: weight of the squared coefficients of shape.
        pose: weight of the squared deviation of angles from where they start.
        deviation: of angles, radians.
        seed: of the samples.
    """

    arms: tuple[float, ...] = (90.0, 65.0, 40.0, 15.0)
    screened: int = 3
    first: int = 5
    rounds: int = 18
    steps: int = 3
    reach: tuple[float, float] = (0.20, 0.035)
    samples: tuple[int, int] = (800, 1200)
    beneath: float = 0.35
    hands: float = 0.25
    landmarks: float = 0.2
    shape: float = 1.0e-6
    pose: float = 2.0e-6
    deviation: float = 0.35
    seed: int = 0


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """A body in a mesh.

    Attributes:
        motion: its pose, (1,) frame, and coefficients of shape.
        joints: positions of the landmarks and joints by name, (3,) metres.
        outside: median distance of the body beyond the mesh where it sticks out, metres.
        distance: median distance between mesh and body, metres.
        far: share of the mesh that is farther than 0.15 m from the body.
    """

    motion: Motion
    joints: dict[str, Floats]
    outside: float
    distance: float
    far: float


class BodyFitter:
    """Fits one body model to meshes: y up, facing +z, about its size.

    Args:
        model: the body.
        settings: how.
    """

    def __init__(self, model: BodyModel, settings: FitSettings | None = None) -> None:
        self.settings = settings or FitSettings()
        self.model = model
        self.actor = model.actor(torch.zeros(0))
        self.surface = ShapedPoints.of_surface(model, self.actor)
        self.marks = ShapedPoints.of_landmarks(model, self.actor)
        wrists = [self.actor.skeleton.rig.joints.index(f"{side}_wrist") for side in "lr"]
        hands = self.surface.weights[:, wrists].sum(1)
        self.trust = 1 - (1 - self.settings.hands) * hands
        rng = np.random.default_rng(self.settings.seed)
        mean = model.surface.mean.numpy()
        self.seen_marks = self.marks.at(np.arange(len(LANDMARKS)))
        self.chosen = spread(mean, model.rig.faces, self.settings.samples[0], rng)

    def fit(self, vertices: Floats, faces: Integers) -> SurfaceFit:
        """Fit an upright mesh: vertices (V, 3) metres, faces (T, 3)."""
        target = self.target(vertices, faces)
        return self.refine(self.screen(target)[1], target)

    def target(self, vertices: Floats, faces: Integers) -> TargetSurface:
        """What ``screen`` and ``refine`` fit to."""
        return TargetSurface(vertices, faces, np.random.default_rng(self.settings.seed))

    def screen(
        self, target: TargetSurface, seen: SeenLandmarks | None = None
    ) -> tuple[float, Motion]:
        """The best of the likeliest starts after a few rounds each, and its distance, metres."""
        settings, rng = self.settings, np.random.default_rng(self.settings.seed)
        found: list[tuple[float, Motion]] = []
        for motion in self._ranked_starts(target)[: settings.screened]:
            for reach in np.geomspace(settings.reach[0], settings.reach[0] / 3, settings.first):
                motion = self._round(motion, target, float(reach), rng, seen)
            distance = two_way_distance(self.surface(motion)[0].numpy(), target)
            found.append((distance + self._missed(motion, seen), motion))
        return min(found, key=lambda pair: pair[0])

    def refine(
        self, motion: Motion, target: TargetSurface, seen: SeenLandmarks | None = None
    ) -> SurfaceFit:
        """Fit from a start."""
        settings, rng = self.settings, np.random.default_rng(self.settings.seed)
        for reach in np.geomspace(*settings.reach, settings.rounds):
            motion = self._round(motion, target, float(reach), rng, seen)
        return self._result(motion, target)

    def starts(self) -> list[Motion]:
        """Poses to start from: arms at the angles of the settings, legs as they rest."""
        return [self._posed(angle) for angle in self.settings.arms]

    def _posed(self, arms: float) -> Motion:
        angles = arm_pose(self.actor, arms)
        rest = self.actor.skeleton.rest_motion()
        shape = torch.zeros(self.model.components, dtype=torch.float64)
        return Motion(rest.translation, rest.rotation, angles[None], {BODY: shape})

    def _ranked_starts(self, target: TargetSurface) -> list[Motion]:
        """Poses with the stature of the mesh, standing where it stands, the best fit first."""
        low, high = target.points[:, 1].min(), target.points[:, 1].max()
        middle = np.median(target.points, axis=0)
        scored = []
        for motion in self.starts():
            motion = self._with_stature(motion, float(high - low))
            body = self.surface(motion)[0].numpy()
            shift = middle - np.median(body, axis=0)
            shift[1] = low - body[:, 1].min()
            placed = replace(motion, translation=motion.translation + torch.from_numpy(shift))
            scored.append((two_way_distance(body + shift, target), placed))
        return [motion for _, motion in sorted(scored, key=lambda pair: pair[0])]

    def _with_stature(self, motion: Motion, height: float) -> Motion:
        """Set the first coefficient, which is mostly stature, by the height."""
        model, one = self.model, torch.ones(1, dtype=torch.float64)
        extents = [np.ptp(model.vertices(s * one)[:, 1].numpy()) for s in (-1.0, 0.0, 1.0)]
        slope = (extents[2] - extents[0]) / 2
        shape = torch.zeros(model.components, dtype=torch.float64)
        if abs(slope) > 0.02:
            shape[0] = float(np.clip((height - extents[1]) / slope, -3, 3))
        return replace(motion, shared={BODY: shape})

    def _round(
        self,
        motion: Motion,
        target: TargetSurface,
        reach: float,
        rng: np.random.Generator,
        seen: SeenLandmarks | None,
    ) -> Motion:
        """Match, then solve."""
        settings, chosen = self.settings, self.chosen
        body = self.surface(motion)[0].numpy()
        normals = vertex_normals(body, self.model.rig.faces)
        picked = rng.choice(len(target.points), settings.samples[1], replace=False)
        nearest = cKDTree(body).query(target.points[picked])[1]
        at = target.nearest(body[chosen])[1]
        pairs = {"body": (chosen, at), "mesh": (nearest, picked)}
        energies = {} if seen is None else {"seen": self._pull(seen, reach)}
        for name, (rows, samples) in pairs.items():
            matches = self._matches(body, normals, rows, target, samples)
            kernel = GemanMcClure(reach)
            weight = 1 / len(rows)
            energies[name] = SurfaceMatch(self.surface.at(rows), matches, 0.3, weight, kernel)
        start = self._anchor(motion)
        objective = Objective(
            energies,
            shape=SharedPrior(self.model.components, weight=settings.shape),
            pose=PosePrior(start, settings.deviation, settings.pose),
        )
        method = LevenbergMarquardt(max_steps=settings.steps)
        state: Motion = solve(
            objective, motion, method, shape_bounds(self.actor, self.model.components)
        ).state
        return state

    def _pull(self, seen: SeenLandmarks, reach: float) -> SurfaceMatch:
        """Distance of the landmarks from where they were seen, in all directions alike."""
        matches = Matches(seen.places, torch.zeros_like(seen.places), seen.trust)
        weight = self.settings.landmarks / len(LANDMARKS)
        return SurfaceMatch(self.seen_marks, matches, 1.0, weight, GemanMcClure(reach))

    def _missed(self, motion: Motion, seen: SeenLandmarks | None) -> float:
        """Mean distance from landmarks that were seen, metres; what is far is as bad as 0.4 m."""
        if seen is None:
            return 0.0
        apart = (self.seen_marks(motion)[0] - seen.places).norm(dim=-1).clamp(max=0.4)
        return float((seen.trust * apart).sum() / seen.trust.sum().clamp(min=1e-12))

    def _anchor(self, motion: Motion) -> Tensor:
        """Angles that the prior prefers: the nearest of the starts in the arms."""
        angles = torch.stack([start.angles[0] for start in self.starts()])
        return angles[(angles - motion.angles[0]).square().sum(-1).argmin()]

    def _matches(
        self,
        body: Floats,
        normals: Floats,
        rows: Integers,
        target: TargetSurface,
        samples: Integers,
    ) -> Matches:
        place, normal = target.points[samples], target.normals[samples]
        sticks_out = ((body[rows] - place) * normal).sum(1) > 0
        agree = np.clip((normals[rows] * normal).sum(1), 0, 1)
        trust = agree * np.where(sticks_out, 1.0, self.settings.beneath)
        given = torch.from_numpy(trust) * self.trust[torch.from_numpy(rows)]
        return Matches(torch.from_numpy(place), torch.from_numpy(normal), given)

    def _result(self, motion: Motion, target: TargetSurface) -> SurfaceFit:
        body = self.surface(motion)[0].numpy()
        distance, at = cKDTree(body).query(target.points)
        out = ((body[at] - target.points) * target.normals).sum(1)
        marks = self.marks(motion)[0].numpy()
        names: Sequence[str] = (*LANDMARKS, *self.actor.skeleton.rig.joints)
        return SurfaceFit(
            motion=motion,
            joints=dict(zip(names, marks, strict=True)),
            outside=float(np.median(out[out > 0])) if (out > 0).any() else 0.0,
            distance=float(np.median(distance)),
            far=float((distance > 0.15).mean()),
        )


def shape_bounds(actor: Actor, components: int) -> Bounds:
    """Limits of the angles, and four deviations of every coefficient of shape."""
    lower, upper = actor.skeleton.bounds
    limit = lower.new_full((components,), _MOST_DEVIATIONS)
    return Bounds(Step(lower, -limit), Step(upper, limit))


def two_way_distance(body: Floats, target: TargetSurface) -> float:
    """Root mean square distance of body and mesh; what is far apart is as bad as 0.4 m."""
    there = target.nearest(body)[0]
    back = cKDTree(body).query(target.points[:: len(target.points) // 1500])[0]
    both = np.minimum(there, 0.4) ** 2, np.minimum(back, 0.4) ** 2
    return float(np.sqrt(0.5 * (both[0].mean() + both[1].mean())))


def arm_pose(actor: Actor, arms: float) -> Tensor:
    """Angles (A,) of the rest pose with straight arms at an angle from straight down, degrees."""
    skeleton = actor.skeleton
    rig = skeleton.rig
    at = {n: p.clone() for n, p in zip(rig.joints, rig.positions, strict=True)}
    at |= {n: p.clone() for n, p in zip(rig.landmarks, rig.landmark_positions, strict=True)}
    turn = np.radians(arms)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        along = torch.tensor([sign * np.sin(turn), -np.cos(turn), 0.0], dtype=torch.float64)
        shoulder, elbow, wrist = (at[f"{side}_{n}"] for n in ("shoulder", "elbow", "wrist"))
        upper, lower = (elbow - shoulder).norm(), (wrist - elbow).norm()
        at[f"{side}_elbow"] = shoulder + upper * along
        at[f"{side}_wrist"] = shoulder + (upper + lower) * along
    angles = [hinge.rest for hinge in human_rig(at).hinges]
    return torch.tensor(angles, dtype=torch.float64).clamp(skeleton.lower, skeleton.upper)
