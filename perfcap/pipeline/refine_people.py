"""Several people from their motions to surfaces: silhouettes together, everything else alone.

As in Liu et al. 2013, Algorithm 2: once pixels are given to people, each is refined on their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from perfcap.actor.motion import Motion
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_people import Seen, extract_people
from perfcap.pipeline.images import Images
from perfcap.pipeline.pose_spread import part_deviations
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import Refinement, Refiner, StageContext
from perfcap.pipeline.stage import Stage
from perfcap.segment import SequenceSettings


@dataclass(frozen=True)
class Moving:
    """One of several people whose motion is known from joints.

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


def refine_people(
    people: Sequence[Moving],
    images: Images,
    config: CaptureConfig,
    until: Stage,
    stage: StageContext,
    workers: int | None,
    checkpoint: Checkpoint,
) -> tuple[Refinement, ...]:
    """Silhouettes of everybody, poses, silhouettes again, surfaces.

    A network that finds persons is not asked: it does not say whom it found.

    Args:
        people: K of them.
        images: F frames and the cameras in their pixels.
        config: settings of all stages.
        until: the last stage, ``REFINE_POSE`` or ``REFINE_SURFACE``.
        stage: entered around every stage of everybody.
        workers: threads; all cores when None.
        checkpoint: keeps finished blocks of these.
    """
    own = [
        Refiner.of(
            *(each.problem, each.motion, images, config),
            *(each.stage, workers, each.checkpoint),
        )
        for each in people
    ]
    deviations = [part_deviations(each.problem, each.motion) for each in people]

    def extract(
        name: str, motions: Sequence[Motion], settings: SequenceSettings
    ) -> tuple[Evidence, ...]:
        seen = [
            Seen(one.problem.actor, one.sight, motion, unsure, one.heights)
            for one, motion, unsure in zip(own, motions, deviations, strict=True)
        ]
        with stage(name) as tell:
            given = workers, tell, checkpoint, name
            return extract_people(seen, images.reader, settings, *given)

    motions = [each.motion for each in people]
    evidence = extract("extract_silhouettes", motions, config.silhouettes.first)
    poses = [
        one.pose(found, motion) for one, found, motion in zip(own, evidence, motions, strict=True)
    ]
    motions = [pose.motion for pose in poses]
    evidence = extract("extract_silhouettes_again", motions, config.silhouettes.again)
    rows = zip(own, evidence, poses, strict=True)
    return tuple(one.finish(found, pose, until) for one, found, pose in rows)
