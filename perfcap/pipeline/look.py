"""The stages that look at images, in their order, as far as a preset has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from perfcap.actor.motion import Motion
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.images import Images
from perfcap.pipeline.keep_apart import keep_apart
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import Refinement, StageContext, image_heights, refine
from perfcap.pipeline.refine_contours import ContourRefinement, refine_contours
from perfcap.pipeline.refine_people import Moving, follow_people, refine_people
from perfcap.pipeline.stage import Stage
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


def look(
    problem: ClipProblem,
    motion: Motion,
    images: Images | None,
    config: CaptureConfig,
    until: Stage,
    stage: StageContext,
    workers: int | None,
    checkpoint: Checkpoint,
) -> Looked:
    """Refine a motion (F,) by images; as it is where there are none or none are wanted.

    Args:
        problem: what the motion was found from.
        motion: (F,).
        images: F frames and the cameras in their pixels.
        config: settings of all stages, and which there are.
        until: the last stage.
        stage: entered around every stage.
        workers: threads; all cores when not given.
        checkpoint: keeps finished blocks of every stage.
    """
    if images is None or not until.needs_images:
        return Looked(motion)
    images = images.checked()
    with torch.no_grad():
        contours = _contours(problem, motion, images, config, stage, workers, checkpoint)
        motion = motion if contours is None else contours.motion
        if not config.segment:
            return Looked(motion, SkinnedSurface(problem.actor, motion), contours)
        given = images, config, until, stage, workers, checkpoint
        if config.frames is not None:
            (found,) = follow_people([Moving(problem, motion, stage, checkpoint)], *given)
        else:
            found = refine(problem, motion, *given)
    return Looked(found.motion, found.vertices, contours, found)


def look_at_people(
    people: Sequence[Moving],
    images: Images,
    configs: Sequence[CaptureConfig],
    until: Stage,
    stage: StageContext,
    workers: int | None,
    checkpoint: Checkpoint,
) -> tuple[Looked, ...]:
    """The same of several people, who are found in the images together.

    Args:
        people: with their motions, (F,) each.
        images: F frames and the cameras in their pixels.
        configs: settings of each; those of images are the first one's.
        until: the last stage, which needs images.
        stage: entered around every stage of everybody.
        workers: threads; all cores when not given.
        checkpoint: keeps finished blocks of these.
    """
    images, config = images.checked(), configs[0]
    with torch.no_grad():
        contours = [
            _contours(
                *(each.problem, each.motion, images, own), each.stage, workers, each.checkpoint
            )
            for each, own in zip(people, configs, strict=True)
        ]
        moved = [
            each if found is None else replace(each, motion=found.motion)
            for each, found in zip(people, contours, strict=True)
        ]
        if not config.segment:
            with stage("keep_apart"):
                actors, motions = zip(*((m.problem.actor, m.motion) for m in moved), strict=True)
                apart = keep_apart(actors, motions, config.apart)
            return tuple(
                Looked(motion, SkinnedSurface(actor, motion), lines)
                for actor, motion, lines in zip(actors, apart, contours, strict=True)
            )
        together = refine_people if config.frames is None else follow_people
        refined = together(moved, images, config, until, stage, workers, checkpoint)
    pairs = zip(refined, contours, strict=True)
    return tuple(Looked(each.motion, each.vertices, lines, each) for each, lines in pairs)


def _contours(
    problem: ClipProblem,
    motion: Motion,
    images: Images,
    config: CaptureConfig,
    stage: StageContext,
    workers: int | None,
    checkpoint: Checkpoint,
) -> ContourRefinement | None:
    """A motion (F,) refined by edges, where the preset has that."""
    if not config.contours.enabled:
        return None
    heights = image_heights(problem, motion, images)
    with stage("refine_contours") as tell:
        given = heights, motion, config.contours, workers, tell, checkpoint
        return refine_contours(problem, images, *given)
