"""The stages that look at images, in their order, as far as a preset has them."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from perfcap.actor.motion import Motion
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.images import Images
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import Refinement, StageContext, image_heights, refine
from perfcap.pipeline.refine_contours import ContourRefinement, refine_contours
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
    contours: ContourRefinement | None = None
    with torch.no_grad():
        if config.contours.enabled:
            heights = image_heights(problem, motion, images)
            given = (config.contours, workers)
            with stage("refine_contours") as tell:
                contours = refine_contours(
                    problem, images, heights, motion, *given, tell, checkpoint
                )
            motion = contours.motion
        if not config.segment:
            return Looked(motion, SkinnedSurface(problem.actor, motion), contours)
        found = refine(problem, motion, images, config, until, stage, workers, checkpoint)
    return Looked(found.motion, found.vertices, contours, found)
