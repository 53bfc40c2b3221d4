"""One of the people who are followed from frame to frame, as of the last one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.motion import Motion
from perfcap.pipeline.autoregression import predict
from perfcap.pipeline.evidence import MaskRecord, contour_of
from perfcap.pipeline.extract_people import Seen
from perfcap.pipeline.frame_view import FrameView, Texture
from perfcap.pipeline.laplacian_surface import LaplacianConfig, LaplacianSurface
from perfcap.pipeline.local_global import FramePose, FrameSolver, LocalConfig
from perfcap.pipeline.pose_search import GlobalConfig
from perfcap.pipeline.sight import Sight, View
from perfcap.render.label_map import barycentric_at
from perfcap.segment import Contour, Matches, extract_contour
from perfcap.segment.silhouettes import decode_labels
from perfcap.segment.texture import Features, find_features, match_features
from perfcap.setting_checks import Settings

Floats = NDArray[np.float64]
Labels = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]

_REMEMBERED = 60  # frames from which the next pose is predicted


@dataclass(frozen=True)
class FramesConfig(Settings):
    """Settings of the frame-by-frame tracker.

    Attributes:
        local: of the local solve.
        search: of the search.
        surface: of the surface's refinement.
        memory: deviations of the autoregression's coefficients from a steady motion's.
        least: m, deviation of a part from where it is predicted.
        share: of how far a part is predicted to move, that is added to it.
        labels: whether a person is looked for in the pixels that are given to them; in those of
            everybody if not, to see what labels are good for (LIU-E6).
        reach: percent of the person's height in the image that texture may move in a frame.
    """

    local: LocalConfig = field(default_factory=LocalConfig)
    search: GlobalConfig = field(default_factory=GlobalConfig)
    surface: LaplacianConfig = field(default_factory=LaplacianConfig)
    memory: float = 0.5
    least: float = 0.015
    share: float = 0.5
    labels: bool = True
    reach: float = 12.0


@dataclass(frozen=True)
class Tracking:
    """How a person was followed.

    Attributes:
        errors: root mean squared distance of each limb from its contours after the local solve,
            (F, J) m.
        released: share of each frame's unknowns that were searched, (F,).
    """

    errors: Floats
    released: Floats

    def report(self) -> dict[str, list[float]]:
        """Plain values, a number a frame."""
        worst = 1000 * self.errors.max(1, initial=0.0)
        return {
            "worst_limb_mm": [round(float(value), 1) for value in worst],
            "released_share": [round(float(value), 3) for value in self.released],
        }


@dataclass(frozen=True)
class Follower:
    """One of the people.

    Attributes:
        actor: the person.
        sight: of the actor's mesh, cameras in pixels of the images.
        heights: of the upright person in every view, (C,) px.
        motion: from detections, of which the first frame counts, (F,).
        deviations: of each part in the first frame, (P,) m.
    """

    actor: Actor
    sight: Sight
    heights: Tensor
    motion: Motion
    deviations: Tensor


@dataclass(frozen=True, eq=False)
class Moved:
    """Features of the frame before that are seen again: places (P, 2) px before and now."""

    before: Floats
    now: Floats


@dataclass(frozen=True, eq=False)
class PersonView:
    """A person in one view of a frame."""

    contour: Contour
    mask: Mask
    moved: Moved | None


class PersonState:
    """One person as of the last frame."""

    def __init__(self, person: Follower, config: FramesConfig, refined: bool) -> None:
        self.person, self.config = person, config
        self.actor = person.actor
        self.detected = Seen(
            person.actor, person.sight, person.motion,
            person.deviations.expand(person.motion.frames, -1), person.heights,
        )  # fmt: skip
        self.seen = self.detected
        self.heights: list[float] = person.heights.tolist()
        self.solver = FrameSolver(
            person.actor, person.sight, self.heights, config.local, config.search
        )
        self.surface = LaplacianSurface(person.actor.template, config.surface) if refined else None
        self.history: list[Motion] = []
        self.before: _Before | None = None
        own = np.array(person.actor.skeleton.rig.without_clavicles)
        parts = torch.from_numpy(own[self.solver.owner.numpy(force=True)])
        self.parts = parts.to(person.motion.angles.device)
        self.features: dict[int, Features] = {}  # of the views in the last frame

    def predicted(self) -> Motion:
        """The next pose, (1,)."""
        if not self.history:
            return self.person.motion[:1]
        return predict(self.history, self.config.memory)

    def place(self, frame: int, motion: Motion) -> None:
        """Expect the person in a frame, with an uncertainty that grows with what moves."""
        rows = slice(frame, frame + 1)
        deviations = self.seen.deviations.clone()
        deviations[rows] = self._deviations(motion)
        expected = self.seen.motion
        parts = {
            name: getattr(expected, name).clone() for name in ("translation", "rotation", "angles")
        }
        for name, values in parts.items():
            values[rows] = getattr(motion, name)
            if self.history:
                values[frame - 1] = getattr(self.history[-1], name)[0]
        self.seen = Seen(
            self.actor, self.person.sight, Motion(**parts), deviations, self.person.heights
        )

    def _deviations(self, motion: Motion) -> Tensor:
        """Of each part from a predicted pose (1,), (P,) m."""
        if not self.history:
            return self.person.deviations
        with torch.no_grad():
            last, next_ = (self.actor.surface(each)[0] for each in (self.history[-1], motion))
        moved = (next_ - last).norm(dim=-1)
        count = len(JOINTS)
        total = moved.new_zeros(count).index_add(0, self.parts, moved)
        number = torch.bincount(self.parts, minlength=count).clamp(min=1)
        deviations: Tensor = self.config.least + self.config.share * total / number
        return deviations

    def look(
        self, view: int, label: int, record: MaskRecord, image: NDArray[np.uint8],
        before: NDArray[np.uint8] | None,
    ) -> PersonView:  # fmt: skip
        """The person in a view of the next frame."""
        labels = decode_labels(record.png)
        mask = self._shown(labels, label)
        contour = (
            contour_of(mask, record.confidence) if self.config.labels else extract_contour(mask)
        )
        if before is None or self.before is None or not any(self.config.local.texture):
            return PersonView(contour, mask, None)
        old = self.features.get(view)
        if old is None:
            old = find_features(before, self._shown(self.before.labels[view], label))
        new = find_features(image, mask)
        self.features[view] = new
        reach = 0.01 * self.config.reach * self.heights[view]
        pairs = match_features(old, new, reach)
        return PersonView(contour, mask, Moved(old.points[pairs[:, 0]], new.points[pairs[:, 1]]))

    def _shown(self, labels: Labels, label: int) -> Mask:
        """Where a person is looked for, (H, W), among labels of everybody."""
        shown: Mask = labels == label if self.config.labels else labels > 0
        return shown

    def solve(
        self, frame: int, views: Sequence[PersonView], predicted: Motion, seed: int
    ) -> tuple[FramePose, Tensor]:
        """Pose and surface (V, 3) of the next frame."""
        cameras = self.person.sight.cameras.every_frame(self.person.motion.frames)
        cameras = cameras.frames(slice(frame, frame + 1))
        joints = len(self.actor.skeleton.rig.joints)
        visible = np.ones((len(views), joints), np.bool_)
        texture: Texture | None = None
        if self.before is not None:
            visible = self.before.visible(self.solver.limbs, joints, self.config.search.visible)
            texture = self.before.texture(self.solver, [view.moved for view in views])
        contours = [view.contour for view in views]
        seen = FrameView(cameras, contours, [view.mask for view in views], texture, visible)
        if self.history and not any(view.mask.any() for view in views):
            # nobody sees them: they stay where they were, and do not walk off for ever
            none = predicted.angles.new_zeros(joints)
            pose = FramePose(self.history[-1], none, 0, predicted.frame_dim)
        else:
            pose = self.solver.pose(self.actor, frame, seen, predicted, seed)
        with torch.no_grad():
            posed = self.actor.surface(pose.motion)[0]
        if self.surface is None:
            return pose, posed.float()
        pairs = partial(self._pairs, frame, contours)
        found = self.surface.refine(
            posed.double().numpy(force=True), pairs, cameras.to(posed.double().cpu()), self.heights
        )
        return pose, torch.from_numpy(found).float()

    def _pairs(self, frame: int, contours: Sequence[Contour], surface: Floats) -> Sequence[Matches]:
        vertices = torch.from_numpy(surface)[None].to(self.actor.vertices)
        (drawn,) = self.person.sight.look(vertices, slice(frame, frame + 1))
        config = self.config.surface.contour
        return self.person.sight.correspond(drawn, contours, config, self.heights)

    def go_on(
        self, frame: int, motion: Motion, surface: Tensor, labels: Sequence[Labels], label: int
    ) -> None:
        """Begin the next frame with the pose (1,) of this one, and a share of its surface (V, 3).

        Args:
            frame: that was found.
            motion: its pose.
            surface: refined, m.
            labels: who is where, ``[C]``.
            label: the person's.
        """
        self.history = [*self.history[1 - _REMEMBERED :], motion]
        with torch.no_grad():
            posed = self.actor.surface(motion)
            if self.surface is not None:
                share = self.config.surface.carried
                posed = torch.lerp(posed, surface[None].to(posed), share)
                rest = self.person.actor.at_rest(motion, posed)[0]
                self.actor = self.person.actor.with_vertices(rest)
            (drawn,) = self.person.sight.look(posed, slice(frame, frame + 1))
        self.before = _Before(motion, posed[0], drawn, labels, label)


@dataclass(frozen=True, eq=False)
class _Before:
    """A person as they were seen in the last frame.

    Attributes:
        motion: pose, (1,).
        surface: (V, 3) m.
        drawn: the surface alone, ``[C]``.
        labels: who is where, ``[C]``.
        label: the person's.
    """

    motion: Motion
    surface: Tensor
    drawn: Sequence[View]
    labels: Sequence[Labels]
    label: int

    def visible(self, limbs: Tensor, joints: int, share: float) -> NDArray[np.bool_]:
        """Whether at least a share of each of J joints' limbs was not hidden by others, (C, J).

        What is outside of the image was not hidden by anybody.

        Args:
            limbs: the joint that each triangle follows, (T,).
            joints: J.
            share: of the pixels of a limb.
        """
        rows = []
        for drawn, labels in zip(self.drawn, self.labels, strict=True):
            limb = drawn.labels.label(limbs.cpu(), -1).numpy()
            there, part = limb >= 0, labels[drawn.part]
            others = there & (part > 0) & (part != self.label)
            total = np.bincount(limb[there], minlength=joints)
            hidden = np.bincount(limb[others], minlength=joints)
            rows.append(hidden <= (1 - share) * total)
        return np.stack(rows)

    def texture(self, solver: FrameSolver, moved: Sequence[Moved | None]) -> Texture | None:
        """Features that moved, on the limbs that they were seen on."""
        found = [
            self._on_surface(solver.faces, view, pairs) for view, pairs in enumerate(moved) if pairs
        ]
        found = [each for each in found if len(each[0])]
        if not found:
            return None
        points, triangles, view, pixels = (torch.cat(part) for part in zip(*found, strict=True))
        return solver.attached(self.motion, points, triangles, view, pixels)

    def _on_surface(
        self, faces: Tensor, view: int, pairs: Moved
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Points (N, 3), triangles (N,), view (N,) and places now (N, 2) of features on the model.

        Features where the drawn model is not, or somebody else was, are left out.
        """
        drawn, like = self.drawn[view], self.surface
        corner = drawn.labels.corner
        column, row = (np.rint(pairs.before).astype(np.int64) - corner[::-1]).T
        triangle = drawn.labels.triangle.numpy()
        height, width = triangle.shape
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        seen = np.where(inside, triangle[row.clip(0, height - 1), column.clip(0, width - 1)], -1)
        kept = np.flatnonzero(seen >= 0)
        triangles = torch.from_numpy(seen[kept].astype(np.int64))
        corners = faces[triangles]
        at = torch.from_numpy(pairs.before[kept])
        depth = torch.from_numpy(drawn.depth)[corners]
        weights = barycentric_at(at, torch.from_numpy(drawn.pixels)[corners], depth).to(like)
        points = (weights[..., None] * like[corners.to(like.device)]).sum(1)
        return (
            points, triangles, torch.full_like(triangles, view),
            torch.from_numpy(pairs.now[kept]).to(like),
        )  # fmt: skip
