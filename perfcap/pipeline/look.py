"""The stages that look at images, in their order, as far as a preset has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from perfcap.actor.motion import Motion
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.keep_apart import keep_apart
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import (
    ImageJob,
    Moving,
    Refinement,
    StageContext,
    image_heights,
    refine,
)
from perfcap.pipeline.refine_contours import ContourRefinement, refine_contours
from perfcap.pipeline.refine_people import follow_people, refine_people
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames


@dataclass(frozen=True)
class Looked:
    """What images added to a motion.

    Attributes:
        motion: refined, (F,).
        surface: vertices of every frame; None where no image was looked at.
        contours: how contours met edges, where the preset has that.
        refinement: silhouettes and what they refined, where it has that.
    """

    motion: Motion
    surface: SurfaceFrames | None = None
    contours: ContourRefinement | None = None
    refinement: Refinement | None = None

    def seen_by(self, problem: ClipProblem) -> ClipProblem:
        """The problem of a motion with the cameras that images put elsewhere."""
        views = None if self.refinement is None else self.refinement.views
        if views is None:
            return problem
        return replace(problem, cameras=views.of_cameras(problem.cameras))


def look(people: Sequence[Moving], job: ImageJob) -> tuple[Looked, ...]:
    """Refine motions by images; several people are found in them together."""
    job = replace(job, images=job.images.checked())
    with torch.no_grad():
        contours = [_contours(each, job) for each in people]
        moved = [
            each if found is None else replace(each, motion=found.motion)
            for each, found in zip(people, contours, strict=True)
        ]
        if not job.config.segment:
            pairs = zip(moved, parted(moved, job.config, job.stage), contours, strict=True)
            return tuple(
                Looked(motion, SkinnedSurface(each.problem.actor, motion), lines)
                for each, motion, lines in pairs
            )
        refined = _segmented(moved, job)
    found = zip(refined, contours, strict=True)
    return tuple(Looked(each.motion, each.vertices, lines, each) for each, lines in found)


def parted(
    people: Sequence[Moving], config: CaptureConfig, stage: StageContext
) -> Sequence[Motion]:
    """Motions of people whose skins do not pass through each other."""
    motions = [each.motion for each in people]
    if len(people) == 1:
        return motions
    with stage("keep_apart"):
        return keep_apart([each.problem.actor for each in people], motions, config.apart)


def _segmented(people: Sequence[Moving], job: ImageJob) -> Sequence[Refinement]:
    if job.config.frames is not None:
        return follow_people(people, job)
    return refine_people(people, job) if len(people) > 1 else [refine(people[0], job)]


def _contours(person: Moving, job: ImageJob) -> ContourRefinement | None:
    """A motion (F,) refined by edges, where the preset has that."""
    if not job.config.contours.enabled:
        return None
    heights = image_heights(person.problem, person.motion, job.images)
    with person.stage("refine_contours") as tell:
        return refine_contours(
            *(person.problem, job.images, heights, person.motion),
            *(job.config.contours, job.workers, tell, person.checkpoint),
        )
