"""The pose of one frame from that of the frame before (Liu et al. 2013, Sec. 4.1).

Local first: contours of silhouettes and texture that moved pull points of the limbs onto rays.
Where a limb stays away from its contours, its joint is released, and a search among many poses
decides by silhouettes alone.
"""

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
from perfcap.actor.surface_points import LimbPoints
from perfcap.energy.line_distance import LineDistance, limb_errors, line_through
from perfcap.energy.prior import PosePrior
from perfcap.errors import InputError
from perfcap.geometry.camera import NEAR, Camera
from perfcap.pipeline.objective import angle_bounds, kernel
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface_config import ContourConfig
from perfcap.segment import Contour, Matches, Matching
from perfcap.segment.silhouette_consistency import MISSED, CoarseSilhouette, Coverage
from perfcap.solve import Energy, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.particles import ParticleSettings, search_particles

Mask = NDArray[np.bool_]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class LocalConfig:
    """The local solve (LIU-4 to 6).

    Attributes:
        rounds: searches of pairs of contours, with a solve each.
        max_steps: of each solve.
        texture: weight of all texture of a frame, as a multiple of that of all contours: in the
            first round, and afterwards.
        outlier: percent of the person's height in the image; texture that is further off after the
            first round is dropped.
        unit: m, distance of a point from its ray that counts as one.
        scale: units where a Geman-McClure kernel lets go; None as in the paper.
        prediction: rad, deviation of angles from those predicted.
        contour: pairs of contours.
    """

    rounds: int = 5
    max_steps: int = 5
    texture: tuple[float, float] = (2.0, 0.1)
    outlier: float = 1.5
    unit: float = 0.01
    scale: float | None = 2.0
    prediction: float = 0.3
    contour: ContourConfig = field(
        default_factory=lambda: ContourConfig(matching=Matching(support=(0.3, 0.6)))
    )


@dataclass(frozen=True)
class GlobalConfig:
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

    def __post_init__(self) -> None:
        """Refuse a word that nobody reads."""
        if self.search not in ("never", "misaligned", "always"):
            raise InputError(f"search is {self.search!r}; expected never, misaligned or always")


@dataclass(frozen=True, eq=False)
class Texture:
    """Points of a person that were seen in the frame before and are again.

    Attributes:
        places: of the points at rest, (N, 3) m.
        joints: that each is rigid with, (N,).
        view: (N,).
        pixels: where they are now, (N, 2) px.
    """

    places: Tensor
    joints: Tensor
    view: Tensor
    pixels: Tensor

    def __len__(self) -> int:
        return len(self.view)

    def __getitem__(self, chosen: Tensor) -> Texture:
        parts = self.places, self.joints, self.view, self.pixels
        return Texture(*(each[chosen] for each in parts))

    def misses(self, actor: Actor, cameras: Camera, motion: Motion) -> Tensor:
        """How far from where they are seen a pose (1,) puts them, (N,) px."""
        with torch.no_grad():
            points = LimbPoints(actor, self.places, self.joints)(motion)
            shown = cameras.project_camera(cameras.to_camera(points))[0]  # C N 2
        own = shown[self.view, torch.arange(len(self.view))]
        missed: Tensor = (own - self.pixels).norm(dim=-1)
        return missed

    def lines(self, cameras: Camera) -> Tensor:
        """Direction and moment of the rays they are seen along, (N, 6)."""
        lines = self.places.new_empty(len(self.view), 6)
        for view in range(cameras.views):
            own = self.view == view
            lines[own] = _lines(cameras.select([view]), self.pixels[own])
        return lines


@dataclass(frozen=True, eq=False)
class FrameView:
    """What one frame shows of a person, in every view.

    Attributes:
        cameras: C views of the frame, (1, C), in pixels of the images.
        contours: of the person's silhouette, ``[C]``.
        masks: the silhouette, ``[C]`` of (H, W).
        texture: that moved since the frame before; None without any.
        visible: whether each joint's limb was seen in the frame before, (C, J).
    """

    cameras: Camera
    contours: Sequence[Contour]
    masks: Sequence[Mask]
    texture: Texture | None
    visible: Flags


@dataclass(frozen=True, eq=False)
class FramePose:
    """A pose, and how it was found.

    Attributes:
        motion: (1,).
        errors: root of each limb's mean squared distance from its contours before a search, (J,)
            m; zero where a limb has none.
        released: unknowns of the frame that were searched, of ``unknowns``.
        unknowns: 6 + A.
    """

    motion: Motion
    errors: Tensor
    released: int
    unknowns: int


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


class FrameSolver:
    """Poses of one person, frame by frame.

    Args:
        actor: the person; the vertices at rest may be other ones in every frame.
        sight: cameras in the pixels of the images.
        heights: of the upright person in every view, px.
        local: settings of the local solve.
        search: of the search.
    """

    def __init__(
        self,
        actor: Actor,
        sight: Sight,
        heights: Sequence[float],
        local: LocalConfig,
        search: GlobalConfig,
    ) -> None:
        self.actor, self.sight, self.heights = actor, sight, heights
        self.local, self.search = local, search
        self.coarse = CoarseMesh.of(actor, search.cell)
        self.method = LevenbergMarquardt(max_steps=local.max_steps)
        self.owner = actor.skin.rows()[2]
        self.faces = torch.as_tensor(actor.template.faces.copy())

    def pose(
        self, actor: Actor, frame: int, seen: FrameView, predicted: Motion, seed: int
    ) -> FramePose:
        """The pose of a frame.

        Args:
            actor: with the vertices at rest that it has in this frame.
            frame: its number in the clip.
            seen: what it shows.
            predicted: pose, (1,).
            seed: of the search's random numbers.
        """
        motion, errors = self._locally(actor, frame, seen, predicted, predicted)
        rig = self.actor.skeleton.rig
        if self.search.search == "never":
            joints = np.zeros(len(rig.joints), np.bool_)
        elif self.search.search == "always":
            joints = np.ones(len(rig.joints), np.bool_)
        else:
            off = (errors > self.search.misaligned).numpy(force=True)
            joints = released_joints(rig, off, self.search.share)
        chosen = released_unknowns(rig, joints)
        if len(chosen):
            motion = self._globally(actor, seen, motion, predicted, joints, chosen, seed)
            if self.search.polish:
                motion, _ = self._locally(actor, frame, seen, motion, predicted, 1)
        return FramePose(motion, errors, len(chosen), motion.frame_dim)

    # --- Local: points of limbs on rays -----------------------------------------------------------

    def _locally(
        self,
        actor: Actor,
        frame: int,
        seen: FrameView,
        motion: Motion,
        predicted: Motion,
        first: int = 0,
    ) -> tuple[Motion, Tensor]:
        """From a pose, in rounds of which the first ones may be left out; errors of limbs (J,)."""
        errors = predicted.angles.new_zeros(len(actor.skeleton.rig.joints))
        held = PosePrior(predicted.angles[0], self.local.prediction)
        texture = seen.texture
        for number in range(first, self.local.rounds):
            contours = self._contours(actor, frame, seen, motion)
            terms: dict[str, Energy[Motion]] = {"prediction": held}
            if contours is not None:
                terms["contours"] = contours
                texture = self._near(texture, actor, seen.cameras, motion) if number else texture
                total = self.local.texture[min(number, 1)] * float(contours.confidence.sum())
                if texture is not None and len(texture) and total > 0:
                    terms["texture"] = self._texture(texture, seen.cameras, total)
            objective = Objective(terms).to(motion.angles)
            motion = solve(objective, motion, self.method, angle_bounds(actor)).state
            if contours is not None:
                errors = self._errors(contours, motion)
        return motion, errors

    def _near(
        self, texture: Texture | None, actor: Actor, cameras: Camera, motion: Motion
    ) -> Texture | None:
        """Texture that a pose puts near to where it is seen."""
        if texture is None or not len(texture):
            return None
        limits = motion.angles.new_tensor(self.heights) * 0.01 * self.local.outlier
        return texture[texture.misses(actor, cameras, motion) < limits[texture.view]]

    def attached(
        self, motion: Motion, points: Tensor, triangles: Tensor, view: Tensor, pixels: Tensor
    ) -> Texture:
        """Points on the surface of a pose as texture of the limbs that they are on.

        Args:
            motion: where they were seen, (1,).
            points: (N, 3) m.
            triangles: of the template that they are on, (N,).
            view: in which they are seen again, (N,).
            pixels: where, (N, 2) px.
        """
        # two of a triangle's corners follow it at least, where two follow one
        joints = self.owner[self.faces[triangles]].sort(-1).values[:, 1]
        return Texture(_at_rest(self.actor, motion, points, joints), joints, view, pixels)

    def _texture(self, texture: Texture, cameras: Camera, total: float) -> LineDistance:
        """Texture that weighs ``total`` together."""
        share = texture.places.new_full(texture.view.shape, total / len(texture.view))
        lines = texture.lines(cameras)
        return self._on_rays(texture.places, texture.joints, lines, share)

    def _on_rays(
        self, places: Tensor, joints: Tensor, lines: Tensor, confidence: Tensor
    ) -> LineDistance:
        direction, moment = (part[None].contiguous() for part in lines.tensor_split(2, -1))
        points = LimbPoints(self.actor, places, joints)
        given = points, direction, moment, confidence[None]
        return LineDistance(*given, kernel=kernel(self.local.scale), unit=self.local.unit)

    def _contours(
        self, actor: Actor, frame: int, seen: FrameView, motion: Motion
    ) -> LineDistance | None:
        """Points of the limbs' contours and the rays of those that silhouettes have."""
        with torch.no_grad():
            surface = actor.surface(motion)
        (drawn,) = self.sight.look(surface, slice(frame, frame + 1))
        pairs = self.sight.correspond(drawn, seen.contours, self.local.contour, self.heights)
        found = [_rays(each, surface[0], seen.cameras.select([c])) for c, each in enumerate(pairs)]
        places, lines, confidence, heavier = (torch.cat(part) for part in zip(*found, strict=True))
        if not len(places):
            return None
        joints = self.owner[heavier]
        rest = _at_rest(actor, motion, places, joints)
        return self._on_rays(rest, joints, lines, confidence)

    def _errors(self, contours: LineDistance, motion: Motion) -> Tensor:
        """Root mean squared distance of each limb's contours, (J,) m (Eq. 5)."""
        with torch.no_grad():
            squared = contours.residual(motion).value.square().sum(-1)
        assert isinstance(contours.points, LimbPoints)
        joints = contours.points.get_buffer("pivots").expand_as(squared)
        count = len(self.actor.skeleton.rig.joints)
        mean = limb_errors(squared, contours.confidence, joints, count)
        return self.local.unit * mean[0].sqrt()

    # --- Global: many poses, and the silhouettes they cover ---------------------------------------

    def _globally(
        self,
        actor: Actor,
        seen: FrameView,
        motion: Motion,
        predicted: Motion,
        joints: Flags,
        chosen: NDArray[np.int64],
        seed: int,
    ) -> Motion:
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
            return covers.costs(posed(particles)) + self.search.smoothness * smooth

        place, turn, bend = self.search.spread
        spread = motion.angles.new_tensor(
            [*[place] * 3, *[turn] * 3, *[bend] * (motion.frame_dim - 6)]
        )[columns]
        random = torch.Generator(far.device).manual_seed(seed)
        start = torch.zeros_like(far), far
        found = search_particles(energy, start, spread, random, self.search.particles)
        return posed(found.value[None])


class _Covers:
    """What poses that differ in some joints cover of the silhouettes of a frame."""

    def __init__(
        self, solver: FrameSolver, actor: Actor, seen: FrameView, motion: Motion, joints: Flags
    ) -> None:
        self.actor, self.cameras, self.missed = actor, seen.cameras, solver.search.missed
        coarse, settings = solver.coarse, solver.search
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
    """Some vertices of a coarse mesh: at rest (U, 3) m, and their weights."""

    rest: Tensor
    skin: SkinWeights

    @classmethod
    def of(cls, actor: Actor, coarse: CoarseMesh, corners: NDArray[np.int64]) -> Self:
        rest = actor.vertices[torch.from_numpy(coarse.chosen[corners])]
        joints, weights, _ = coarse.skin.rows()
        index = torch.from_numpy(corners)
        return cls(rest, SkinWeights(weights[index], joints[index]).to(rest))

    @torch.no_grad()
    def projected(
        self, actor: Actor, cameras: Camera, motion: Motion
    ) -> tuple[NDArray[np.float32], Flags]:
        """Columns and rows in N poses, (C, 2, N, U) px, and what is in front, (C, N, U)."""
        placed = dual_quaternion_blend(self.rest, self.skin, *actor.joint_transforms(motion))
        shape = placed.shape[:2]
        points = placed.reshape(-1, 3).float()
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


# --- Rays of pixels, and points of limbs that should lie on them ----------------------------------


def _rays(pairs: Matches, surface: Tensor, camera: Camera) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Points (N, 3) m, lines (N, 6), confidence (N,) and heavier vertices (N,) of pairs."""
    vertices, weights = (torch.from_numpy(part) for part in (pairs.vertices, pairs.weights))
    points = (weights.to(surface)[..., None] * surface[vertices]).sum(1)
    heavier = vertices.gather(1, weights.argmax(1, keepdim=True)).squeeze(1)
    lines = _lines(camera, torch.from_numpy(pairs.target).to(surface))
    return points, lines, torch.from_numpy(pairs.confidence).to(surface), heavier


def _lines(camera: Camera, pixels: Tensor) -> Tensor:
    """Direction and moment (N, 6) of the rays of pixels (N, 2) of one view."""
    plane = camera.to_plane(pixels[None, None]).reshape(-1, 2)
    rotation = camera.rotation.reshape(3, 3)
    towards = torch.nn.functional.pad(plane, (0, 1), value=1.0) @ rotation
    centre = camera.centre.reshape(3).expand_as(towards)
    return torch.cat(line_through(centre, towards), -1)


def _at_rest(actor: Actor, motion: Motion, points: Tensor, joints: Tensor) -> Tensor:
    """Where points (N, 3) of a pose (1,) are at rest, each rigid with its joint, (N, 3)."""
    rotation, translation = (part[0, joints] for part in actor.joint_transforms(motion))
    return (rotation.mT @ (points - translation)[..., None]).squeeze(-1)
