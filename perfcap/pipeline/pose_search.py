"""Poses searched among many, where local solves went astray (Liu et al. 2013, Sec. 4.1.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.coarse_mesh import CoarseMesh
from perfcap.actor.motion import Motion
from perfcap.actor.rig import Rig
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.geometry.camera import NEAR, Camera
from perfcap.pipeline.frame_view import Flags, FrameView, Mask
from perfcap.segment.silhouette_consistency import MISSED, CoarseSilhouette, Coverage
from perfcap.setting_checks import Settings
from perfcap.solve import Step
from perfcap.solve.particles import ParticleSettings, search_particles


@dataclass(frozen=True)
class GlobalConfig(Settings):
    """The search (LIU-7 to 9).

    Attributes:
        search: whether never, where limbs are misaligned, or always.
        misaligned: m, root of a limb's mean squared distance from its contours above which it is.
        share: of the joints above which all are released.
        missed: cost of a silhouette of which nothing is covered (lambda).
        pixel: percent of the person's height that counts as a pixel beyond the silhouette.
        smoothness: weight of the squared distance from the prediction (gamma).
        polish: whether a local solve follows; none in the paper.
        height: px of the upright person where poses are compared.
        cell: m, of the mesh that is compared.
        visible: share of a limb that must be seen for what of it is beyond the silhouette to cost.
        spread: deviations of the first particles: place, m, rotation and angles, rad.
        particles: how many, and how often.
    """

    search: Literal["never", "misaligned", "always"] = "misaligned"
    misaligned: float = 0.02
    share: float = 0.5
    missed: float = MISSED
    pixel: float = 0.2
    smoothness: float = 0.01
    polish: bool = True
    height: float = 100.0
    cell: float = 0.03
    visible: float = 0.5
    spread: tuple[float, float, float] = (0.03, 0.1, 0.15)
    particles: ParticleSettings = field(default_factory=ParticleSettings)


def released_joints(rig: Rig, misaligned: Flags, share: float) -> Flags:
    """Joints (J,) whose angles are searched where the limbs (J,) of some are not where they should.

    A limb moves with its joint; where that has less than three angles, the limb before it may be
    what is wrong, and its joint is released too (Liu et al. 2013, Fig. 3). Above a share of the
    joints, all are.
    """
    angles = np.zeros(len(rig.joints), np.int64)
    np.add.at(angles, [rig.joints.index(hinge.joint) for hinge in rig.hinges], 1)
    released = np.zeros(len(rig.joints), np.bool_)
    for joint in np.flatnonzero(misaligned).tolist():
        while joint >= 0 and not released[joint]:
            released[joint] = True
            if angles[joint] >= 3:
                break
            joint = rig.parents[joint]
    movable = angles > 0
    movable[0] = True
    if (released & movable).sum() > share * movable.sum():
        released[:] = True
    return released


def released_unknowns(rig: Rig, joints: Flags) -> NDArray[np.int64]:
    """Which of a frame's 6 + A unknowns those of some joints (J,) are; the root has the first 6."""
    root = list(range(6)) if joints[0] else []
    index = {name: number for number, name in enumerate(rig.joints)}
    hinges = [6 + i for i, hinge in enumerate(rig.hinges) if joints[index[hinge.joint]]]
    return np.array(root + hinges, np.int64)


class PoseSearch:
    """Poses of one person, judged by the silhouettes that they cover.

    Args:
        actor: the person; the vertices at rest may be other ones in every frame.
        heights: of the upright person in every view, px.
        config: settings.
    """

    def __init__(self, actor: Actor, heights: Sequence[float], config: GlobalConfig) -> None:
        self.heights, self.config = heights, config
        self.coarse = CoarseMesh.of(actor, config.cell, doubled=True)

    def search(
        self,
        actor: Actor,
        seen: FrameView,
        hypotheses: tuple[Motion, Motion],
        joints: Flags,
        seed: int,
    ) -> Motion:
        """The best pose (1,) that differs from the first hypothesis in some joints alone.

        Args:
            actor: with the vertices at rest that it has in this frame.
            seen: what the frame shows.
            hypotheses: poses between which particles begin: the local optimum, the prediction.
            joints: whose angles are searched, (J,); with the root's all six of it.
            seed: of random numbers.
        """
        motion, predicted = hypotheses
        chosen = released_unknowns(actor.skeleton.rig, joints)
        columns = torch.from_numpy(chosen).to(motion.angles.device)
        lower, upper = actor.skeleton.bounds
        covers = _Covers(self, actor, seen, motion, joints)
        far = motion.local(predicted).frame[0, columns]

        def posed(particles: Tensor) -> Motion:
            step = particles.new_zeros(len(particles), motion.frame_dim)
            step[:, columns] = particles
            many = motion[torch.zeros(len(particles), dtype=torch.int64)]
            moved = many.retract(Step(step, step.new_zeros(0)))
            angles = moved.angles.clamp(lower[6:], upper[6:])
            return Motion(moved.translation, moved.rotation, angles)

        def energy(particles: Tensor) -> Tensor:
            smooth = (particles - far).square().sum(-1)
            return covers.costs(posed(particles)) + self.config.smoothness * smooth

        place, turn, bend = self.config.spread
        spread = motion.angles.new_tensor(
            [*[place] * 3, *[turn] * 3, *[bend] * (motion.frame_dim - 6)]
        )[columns]
        random = torch.Generator(far.device).manual_seed(seed)
        start = torch.zeros_like(far), far
        found = search_particles(energy, start, spread, random, self.config.particles)
        return posed(found.value[None])

    def costs(
        self, actor: Actor, seen: FrameView, joints: Flags, poses: Sequence[Motion]
    ) -> list[float]:
        """Cost by silhouettes (Eq. 7) of poses (1,) that differ in some joints (J,) alone."""
        covers = _Covers(self, actor, seen, poses[0], joints)
        return [float(covers.costs(pose)) for pose in poses]


class _Covers:
    """What poses that differ in some joints cover of the silhouettes of a frame."""

    def __init__(
        self, solver: PoseSearch, actor: Actor, seen: FrameView, motion: Motion, joints: Flags
    ) -> None:
        self.actor, self.cameras, self.missed = actor, seen.cameras, solver.config.missed
        coarse, settings = solver.coarse, solver.config
        moved = coarse.moved_by(_below(actor.skeleton.rig, joints))
        whole = _Posed.of(actor, coarse, np.arange(len(coarse.chosen)))
        corners, faces = np.unique(coarse.faces[moved], return_inverse=True)
        self.posed, self.faces = _Posed.of(actor, coarse, corners), faces.reshape(-1, 3)
        self.seen = [np.ascontiguousarray(row[coarse.limbs[moved]]) for row in seen.visible]
        pixels, usable = whole.projected(actor, seen.cameras, motion)
        self.covered = []
        for view, (mask, height) in enumerate(zip(seen.masks, solver.heights, strict=True)):
            part = _around(mask, pixels[view, :, 0, usable[view, 0]], 0.5 * height)
            scale = max(1.0, height / settings.height)
            silhouette = CoarseSilhouette.of(mask, part, scale, 0.01 * settings.pixel * height)
            still = np.ascontiguousarray(coarse.faces[~moved])
            limbs = np.ascontiguousarray(seen.visible[view][coarse.limbs[~moved]])
            given = pixels[view, :, 0], usable[view, 0], still, limbs
            self.covered.append(Coverage.of(silhouette, *given))

    def costs(self, motion: Motion) -> Tensor:
        """Mean over views (N,), of N poses (Eq. 7)."""
        pixels, usable = self.posed.projected(self.actor, self.cameras, motion)
        costs = [
            covered.costs(pixels[view], usable[view], self.faces, self.seen[view], self.missed)
            for view, covered in enumerate(self.covered)
        ]
        return torch.from_numpy(np.mean(costs, 0)).to(motion.angles)


@dataclass(frozen=True, eq=False)
class _Posed:
    """Some vertices of a coarse mesh: at rest (U, 3) m float32, and their weights."""

    rest: Tensor
    skin: SkinWeights

    @classmethod
    def of(cls, actor: Actor, coarse: CoarseMesh, corners: NDArray[np.int64]) -> Self:
        rest = actor.vertices[torch.from_numpy(coarse.chosen[corners])].float()
        joints, weights, _ = coarse.skin.rows()
        index = torch.from_numpy(corners)
        return cls(rest, SkinWeights(weights[index], joints[index]).to(rest))

    @torch.no_grad()
    def projected(
        self, actor: Actor, cameras: Camera, motion: Motion
    ) -> tuple[NDArray[np.float32], Flags]:
        """Columns and rows in N poses, (C, 2, N, U) px, and what is in front, (C, N, U)."""
        rotation, translation = actor.joint_transforms(motion)
        transforms = rotation.to(self.rest), translation.to(self.rest)
        placed = dual_quaternion_blend(self.rest, self.skin, *transforms)
        shape = placed.shape[:2]
        points = placed.reshape(-1, 3)
        views = cameras.to(points)
        rotation, translation = views.rotation.reshape(-1, 3), views.translation.reshape(-1, 1)
        local = torch.addmm(translation, rotation, points.mT).reshape(-1, 3, len(points))
        if cameras.distortion is None:  # coordinate by coordinate, which is what processors like
            plane = local[:, :2] / local[:, 2:].clamp(min=NEAR)
            lens = views.intrinsics.reshape(-1, 3, 3)
            pixels = torch.baddbmm(lens[:, :2, 2:], lens[:, :2, :2], plane)
        else:
            pixels = views.project_camera(local.mT[None])[0].mT
        found: NDArray[np.float32] = pixels.contiguous().numpy(force=True)
        front: Flags = (local[:, 2] > NEAR).numpy(force=True)
        return found.reshape(-1, 2, *shape), front.reshape(-1, *shape)


def _below(rig: Rig, joints: Flags) -> Flags:
    """Joints (J,) that move where the angles of some do: these, and all that hang on them."""
    moved = joints.copy()
    for joint, parent in enumerate(rig.parents):
        if parent >= 0:
            moved[joint] |= moved[parent]
    return moved


def _around(mask: Mask, pixels: NDArray[np.floating], margin: float) -> tuple[slice, slice]:
    """Rows and columns that hold a silhouette and a model, and a margin."""
    rows, columns = np.nonzero(mask.any(1))[0], np.nonzero(mask.any(0))[0]
    inside = (pixels >= 0).all(1) & (pixels < mask.shape[::-1]).all(1)
    places = np.concatenate(
        [
            pixels[inside],
            np.array([[c, r] for c, r in zip(columns[[0, -1]], rows[[0, -1]], strict=True)])
            if len(rows)
            else np.zeros((0, 2)),
        ]
    )
    if not len(places):
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    low = np.floor(places.min(0) - margin).astype(int).clip(0)
    high = np.ceil(places.max(0) + margin).astype(int) + 1
    return (
        slice(int(low[1]), int(min(high[1], mask.shape[0]))),
        slice(int(low[0]), int(min(high[0], mask.shape[1]))),
    )
