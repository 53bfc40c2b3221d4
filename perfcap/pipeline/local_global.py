"""The pose of one frame from that of the frame before (Liu et al. 2013, Sec. 4.1).

Local first: contours of silhouettes and texture that moved pull points of the limbs onto rays.
Where a limb stays away from its contours, its joint is released, and a search among many poses
decides by silhouettes alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import LimbPoints
from perfcap.energy.line_distance import LineDistance, limb_errors
from perfcap.energy.prior import PosePrior
from perfcap.geometry.camera import Camera
from perfcap.pipeline.frame_view import FrameView, Texture, pixel_lines
from perfcap.pipeline.objective import angle_bounds, kernel
from perfcap.pipeline.pose_search import (
    GlobalConfig,
    PoseSearch,
    released_joints,
    released_unknowns,
)
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface_config import ContourConfig
from perfcap.segment import Matches, Matching
from perfcap.setting_checks import Settings, require_metres, require_radians, require_sizes
from perfcap.solve import Energy, LevenbergMarquardt, Objective, solve

Mask = NDArray[np.bool_]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class LocalConfig(Settings):
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

    def __post_init__(self) -> None:
        super().__post_init__()
        require_metres(self, "unit")
        require_radians(self, "prediction")
        require_sizes(self, "outlier", *(() if self.scale is None else ("scale",)))


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
        self.wider = PoseSearch(actor, heights, search)
        self.method = LevenbergMarquardt(max_steps=local.max_steps)
        self.owner = actor.skin.rows()[2]
        self.faces = torch.as_tensor(actor.template.faces.copy())
        # of each triangle: two of its corners follow it at least, where two follow one
        self.limbs = self.owner[self.faces].sort(-1).values[:, 1]

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
            motion = self.wider.search(actor, seen, (motion, predicted), joints, seed)
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
        joints = self.limbs[triangles]
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


# --- Rays of pixels, and points of limbs that should lie on them ----------------------------------


def _rays(pairs: Matches, surface: Tensor, camera: Camera) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Points (N, 3) m, lines (N, 6), confidence (N,) and heavier vertices (N,) of pairs."""
    vertices, weights = (torch.from_numpy(part) for part in (pairs.vertices, pairs.weights))
    points = (weights.to(surface)[..., None] * surface[vertices]).sum(1)
    heavier = vertices.gather(1, weights.argmax(1, keepdim=True)).squeeze(1)
    lines = pixel_lines(camera, torch.from_numpy(pairs.target).to(surface))
    return points, lines, torch.from_numpy(pairs.confidence).to(surface), heavier


def _at_rest(actor: Actor, motion: Motion, points: Tensor, joints: Tensor) -> Tensor:
    """Where points (N, 3) of a pose (1,) are at rest, each rigid with its joint, (N, 3)."""
    rotation, translation = (part[0, joints] for part in actor.joint_transforms(motion))
    return (rotation.mT @ (points - translation)[..., None]).squeeze(-1)
