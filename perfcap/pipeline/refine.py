"""From a skeleton motion to a surface on the silhouettes: the stages that look at images."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import NEAR
from perfcap.geometry.surface_topology import surface_topology
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_silhouettes import extract_silhouettes
from perfcap.pipeline.followed_person import Tracking
from perfcap.pipeline.gaps import ranges
from perfcap.pipeline.images import Images
from perfcap.pipeline.lost_limbs import find_lost_limbs
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine_cameras import can_refine_cameras, mask_offsets, refine_cameras
from perfcap.pipeline.refine_pose import PoseRefinement, refine_pose
from perfcap.pipeline.refine_surface import SurfaceRefinement, refine_surface
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames
from perfcap.pipeline.track_motion import Progress
from perfcap.pipeline.view_errors import ViewErrors
from perfcap.segment import SequenceSettings

# a context in which a stage runs, by name; it gives what to tell progress to
StageContext = Callable[[str], AbstractContextManager[Progress]]

TRUNK = 0
_ARM = ("shoulder", "elbow", "wrist")
_LIMBS = (("l", True), ("r", True), ("l", False), ("r", False))  # side, arm; numbered from 1


@dataclass(frozen=True)
class Refinement:
    """What the images added to the motion.

    Attributes:
        motion: refined, (F,).
        evidence: silhouettes, the second time they were extracted.
        pose: how the motion was refined.
        surface: how the surface was; None where the capture ended before.
        vertices: of every frame.
        mesh: what may be wrong with the actor's mesh, counted by name.
        tracking: how the person was followed from frame to frame, where they were.
        views: where cameras stand, where silhouettes moved them.
        offsets: how far masks lie beside the posed body in each view, (C, 2), see
            ``mask_offsets``; None of one view, cameras that move, several people.
    """

    motion: Motion
    evidence: Evidence
    pose: PoseRefinement
    surface: SurfaceRefinement | None
    vertices: SurfaceFrames
    mesh: Mapping[str, int]
    tracking: Tracking | None = None
    views: ViewErrors | None = None
    offsets: NDArray[np.float64] | None = None

    @property
    def doubtful_masks(self) -> NDArray[np.int64]:
        """Frames whose masks are probably wrong, by a network or by all else that is known."""
        unsure = np.union1d(self.evidence.doubtful, self.evidence.odd(self.pose.after))
        found: NDArray[np.int64] = np.union1d(unsure, self.evidence.beside).astype(np.int64)
        return found

    def report(self, first_frame: int = 0) -> dict[str, Any]:
        """Overlap with the masks and frames without a refinement, as plain values."""
        parts: dict[str, PoseRefinement | SurfaceRefinement] = {"pose": self.pose}
        if self.surface is not None:
            parts["surface"] = self.surface
        report: dict[str, Any] = {
            name: {
                "overlap_before": _plain(part.before),
                "overlap_after": _plain(part.after),
                "not_refined": [
                    [a + first_frame, b + first_frame]
                    for a, b in ranges(torch.from_numpy(~part.kept))
                ],
            }
            for name, part in parts.items()
        }
        if self.surface is not None:
            report["surface"]["folded_share"] = _plain(self.surface.folded)
        if self.pose.limbs:
            report["lost_limbs"] = [each.report(first_frame) for each in self.pose.limbs]
        if self.tracking is not None:
            report["tracking"] = self.tracking.report()
        if self.views is not None:
            report["cameras"] = self.views.report(self.views.numbers)
        if self.offsets is not None:
            pairs = self.offsets.round(2).tolist()
            report["mask_offsets"] = [None if np.isnan(x).any() else x for x in pairs]
        doubtful = {"doubtful_masks": (self.doubtful_masks + first_frame).tolist()}
        return {**report, **self.evidence.report(first_frame), **doubtful, "mesh": self.mesh}


@dataclass(frozen=True)
class Moving:
    """A person whose motion is known from joints.

    Attributes:
        problem: what the motion was found from.
        motion: (F,).
        stage: entered around every stage of this person alone.
        checkpoint: keeps finished blocks of these.
    """

    problem: ClipProblem
    motion: Motion
    stage: StageContext
    checkpoint: Checkpoint


@dataclass(frozen=True)
class ImageJob:
    """Images of people, and what is to be done with them.

    Attributes:
        images: F frames and the cameras in their pixels.
        config: settings of all stages.
        until: the last stage, ``REFINE_POSE`` or ``REFINE_SURFACE``.
        stage: entered around every stage of everybody.
        workers: threads; all cores when None.
        checkpoint: keeps finished blocks of these.
    """

    images: Images
    config: CaptureConfig
    until: Stage
    stage: StageContext
    workers: int | None
    checkpoint: Checkpoint


def refine(person: Moving, job: ImageJob) -> Refinement:
    """Silhouettes, pose refinement, silhouettes again, surface refinement (Xu 2018, Sec. 5)."""
    own, settings = Refiner.of(person, job), job.config.silhouettes
    evidence = own.extract("extract_silhouettes", person.motion, settings.first)
    views = own.cameras(evidence)
    own = own if views is None else own.seen_by(views)
    pose = own.pose(evidence)
    evidence = own.extract("extract_silhouettes_again", pose.motion, settings.again)
    found = replace(own.finish(evidence, pose), views=views)
    if not can_refine_cameras(own.sight):
        return found
    posed = SkinnedSurface(own.actor, pose.motion)
    return replace(found, offsets=mask_offsets(posed, own.sight, evidence))


@dataclass(frozen=True)
class Refiner:
    """The steps of ``refine``, and what they share.

    Attributes:
        person: who is refined.
        job: in which images, and how.
        sight: of the actor's mesh.
        heights: of the upright person in each image, (C,) px.
    """

    person: Moving
    job: ImageJob
    sight: Sight
    heights: Tensor

    @classmethod
    def of(cls, person: Moving, job: ImageJob) -> Refiner:
        """Of a person in images."""
        template, cameras = person.problem.actor.template, job.images.cameras
        faces = torch.as_tensor(template.faces.copy())
        sight = Sight(cameras.to(person.motion.angles), faces, template.weld()[0])
        heights = image_heights(person.problem, person.motion, job.images)
        return cls(person, job, sight, heights)

    @property
    def actor(self) -> Actor:
        """The person's."""
        return self.person.problem.actor

    def seen_by(self, views: ViewErrors) -> Refiner:
        """The same with cameras as they stand."""
        problem, images = self.person.problem, self.job.images
        problem = replace(problem, cameras=views.of_cameras(problem.cameras))
        images = replace(images, cameras=views.of_cameras(images.cameras))
        sight = self.sight.through(views.of_cameras(self.sight.cameras))
        person, job = replace(self.person, problem=problem), replace(self.job, images=images)
        return replace(self, person=person, job=job, sight=sight)

    def cameras(self, evidence: Evidence) -> ViewErrors | None:
        """Where cameras stand by silhouettes; None where that is not asked for, or not to know."""
        settings = self.job.config.refine_cameras
        if not settings.enabled or not can_refine_cameras(self.sight):
            return None
        with self.person.stage("refine_cameras") as tell:
            return refine_cameras(
                *(self.person.problem, self.sight, evidence, self.person.motion, settings),
                *(self.job.workers, tell, self.person.checkpoint),
            )

    def extract(self, name: str, motion: Motion, settings: SequenceSettings) -> Evidence:
        """Silhouettes about a motion, (F,)."""
        images = self.job.images
        with self.person.stage(name) as tell:
            return extract_silhouettes(
                self.actor,
                *(self.sight, images.reader, motion, self.heights, settings),
                *(self.job.workers, tell, self.person.checkpoint),
                name=name,
                network=images.segmenter,
                known=images.masks,
            )

    def pose(self, evidence: Evidence) -> PoseRefinement:
        """The motion (F,) pulled towards silhouettes, after limbs that detectors lost."""
        person, settings = self.person, self.job.config.refine_pose
        with person.stage("refine_pose") as tell:
            lost = find_lost_limbs(
                *(person.problem, self.sight, evidence, person.motion),
                *(self.job.config.lost_limbs, self.job.workers, person.checkpoint),
            )
            refined = refine_pose(
                *(lost.problem, self.sight, evidence, lost.motion, settings),
                *(self.job.workers, tell, person.checkpoint),
            )
        return replace(refined, limbs=lost.found)

    def finish(
        self, evidence: Evidence, pose: PoseRefinement, name: str = "refine_surface"
    ) -> Refinement:
        """The surface pulled towards silhouettes, as far as the job goes.

        Args:
            evidence: silhouettes of F frames.
            pose: with the motion, (F,).
            name: of this one; another one keeps its blocks apart.
        """
        actor, settings = self.actor, self.job.config.refine_surface
        mesh = surface_topology(actor.template.vertices, actor.template.faces).counts()
        if self.job.until < Stage.REFINE_SURFACE:
            vertices = SkinnedSurface(actor, pose.motion)
            return Refinement(pose.motion, evidence, pose, None, vertices, mesh)
        kept = self.person.checkpoint
        kept = kept if name == "refine_surface" else kept.of(name)
        with self.person.stage(name) as tell:
            limbs = limb_of_triangles(actor)  # they keep their width
            faces = self.sight.faces
            sight = Sight(self.sight.cameras, faces, actor.template.weld()[0], limbs)
            graph = DeformationGraph.build(actor.vertices, faces, settings.nodes)
            surface = refine_surface(
                *(actor, graph, sight, evidence, pose.motion),
                *(settings, self.job.workers, tell, kept),
            )
        return Refinement(pose.motion, evidence, pose, surface, surface.surface, mesh)


def limb_of_triangles(actor: Actor) -> NDArray[np.int64]:
    """Trunk and head 0, left and right arm 1 and 2, left and right leg 3 and 4, by triangle, (T,).

    A vertex belongs to the limb of the joint that moves it most, a triangle to that of two of its
    vertices; where all three differ, to the one numbered in between.
    """
    heaviest = actor.skin.rows()[2].cpu().numpy()
    of_joint = np.array([_limb(joint) for joint in actor.skeleton.rig.joints])
    corners = of_joint[heaviest][actor.template.faces]
    limbs: NDArray[np.int64] = np.sort(corners, 1)[:, 1]
    return limbs


def _limb(joint: str) -> int:
    side, _, name = joint.partition("_")
    limb = (side, name in _ARM)
    return _LIMBS.index(limb) + 1 if name and limb in _LIMBS else TRUNK


def image_heights(problem: ClipProblem, motion: Motion, images: Images) -> Tensor:
    """Height of the upright person in each image, (C,), pixels.

    That of the detections; in views that have none, that of the joints of the motion (F,).
    """
    seen = problem.detections.views_with_person()
    scale = [
        torch.linalg.det(cameras.intrinsics[..., :2, :2]).abs().sqrt()
        for cameras in (images.cameras.to(problem.pixel_unit), problem.cameras)
    ]
    ratio = scale[0] / scale[1]
    heights: Tensor = 100 * problem.pixel_unit * ratio.reshape(-1, ratio.shape[-1]).mean(0)
    if bool(seen.all()):
        return heights
    return torch.where(seen, heights, _expected(problem.actor, images, motion).person_height())


def _expected(actor: Actor, images: Images, motion: Motion) -> Detections:
    """Where the joints of the motion (F,) are in the images, whether or not they were detected."""
    cameras = images.cameras.to(motion.angles)
    local = cameras.to_camera(actor.joints(motion))
    in_front = (local[..., 2] > NEAR).to(local)
    return Detections.from_joints(cameras.project_camera(local), in_front)


def _plain(values: NDArray[np.float64]) -> list[float]:
    return [round(float(value), 4) for value in values]
