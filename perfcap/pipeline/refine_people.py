"""Several people from their motions to surfaces: silhouettes together, everything else alone.

As in Liu et al. 2013, Algorithm 2: once pixels are given to people, each is refined on their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perfcap.actor.motion import Motion
from perfcap.geometry.surface_topology import surface_topology
from perfcap.pipeline.checkpoint import Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_people import Seen, extract_people
from perfcap.pipeline.followed_person import Follower
from perfcap.pipeline.frame_by_frame import Followed, follow
from perfcap.pipeline.images import Images
from perfcap.pipeline.keep_apart import keep_apart
from perfcap.pipeline.overlap import clip_overlaps
from perfcap.pipeline.pose_spread import part_deviations, pose_factors
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.refine import Refinement, Refiner, StageContext
from perfcap.pipeline.refine_pose import PoseRefinement
from perfcap.pipeline.refine_surface import SurfaceRefinement
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames
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
    """Silhouettes, poses kept apart, silhouettes again, surfaces; both once more where they meet.

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
    own = _refiners(people, images, config, workers)
    deviations = [part_deviations(each.problem, each.motion) for each in people]
    sampled = config.silhouettes.people.samples is not None
    factors = [pose_factors(each.problem, each.motion) if sampled else None for each in people]

    def extract(
        name: str,
        motions: Sequence[Motion],
        settings: SequenceSettings,
        refined: Sequence[Refinement] = (),
    ) -> tuple[Evidence, ...]:
        seen = [
            Seen(one.problem.actor, one.sight, motion, unsure, one.heights, factors=drawn)
            for one, motion, unsure, drawn in zip(own, motions, deviations, factors, strict=True)
        ]
        if refined:
            pairs = zip(seen, refined, strict=True)
            seen = [replace(each, surface=known.vertices) for each, known in pairs]
        before = [known.evidence for known in refined] or None
        with stage(name) as tell:
            given = workers, tell, checkpoint, name, config.silhouettes.people
            return extract_people(seen, images.reader, settings, *given, before=before)

    motions = [each.motion for each in people]
    evidence = extract("extract_silhouettes", motions, config.silhouettes.first)
    poses = [
        one.pose(found, motion) for one, found, motion in zip(own, evidence, motions, strict=True)
    ]
    with stage("keep_apart"):
        poses = _apart(own, evidence, poses, config)
    motions = [pose.motion for pose in poses]
    evidence = extract("extract_silhouettes_again", motions, config.silhouettes.again)
    rows = zip(own, evidence, poses, strict=True)
    refined = [one.finish(found, pose, until) for one, found, pose in rows]
    if len(own) == 1 or until < Stage.REFINE_SURFACE:
        return tuple(refined)
    # Surfaces that meet their silhouettes say better than skinned ones who is where: a skirt that
    # swings, a limb that is a little off. That shows where people meet, and there alone.
    for number in range(config.silhouettes.closer):
        if number:
            name, rows = f"refine_surface_{number + 1}", zip(own, evidence, poses, strict=True)
            refined = [one.finish(found, pose, until, name) for one, found, pose in rows]
        name = f"extract_silhouettes_{number + 3}"
        evidence = extract(name, motions, config.silhouettes.again, refined)
        pairs = zip(refined, evidence, strict=True)
        refined = [replace(each, evidence=found) for each, found in pairs]
    return tuple(refined)


def follow_people(
    people: Sequence[Moving],
    images: Images,
    config: CaptureConfig,
    until: Stage,
    stage: StageContext,
    workers: int | None,
    checkpoint: Checkpoint,
) -> tuple[Refinement, ...]:
    """The same frame by frame, from where motions begin (Liu et al. 2013); one person or several.

    Arguments are those of ``refine_people``; ``config.frames`` says how.
    """
    assert config.frames is not None
    own = _refiners(people, images, config, workers)
    followers = [
        Follower(
            one.problem.actor,
            one.sight,
            one.heights,
            each.motion,
            part_deviations(each.problem, each.motion)[0],
        )
        for one, each in zip(own, people, strict=True)
    ]
    refined = until >= Stage.REFINE_SURFACE
    with stage("follow_frames") as tell:
        settings = config.frames, config.silhouettes.first, refined
        labels = config.silhouettes.people
        found = follow(followers, images, *settings, workers, tell, checkpoint, labels)
    rows = zip(own, people, found, strict=True)
    return tuple(_refinement(one, each.motion, result, refined) for one, each, result in rows)


def _apart(
    own: Sequence[Refiner],
    evidence: Sequence[Evidence],
    poses: Sequence[PoseRefinement],
    config: CaptureConfig,
) -> list[PoseRefinement]:
    """Poses of people whose skins do not pass through each other."""
    actors, motions = [one.problem.actor for one in own], [pose.motion for pose in poses]
    result = []
    parted = keep_apart(actors, motions, config.apart)
    for one, found, pose, motion in zip(own, evidence, poses, parted, strict=True):
        if motion is not pose.motion:
            surface = SkinnedSurface(one.problem.actor, motion)
            after = clip_overlaps(surface, one.sight, found, one.workers)
            pose = replace(pose, motion=motion, after=after)
        result.append(pose)
    return result


def _refiners(
    people: Sequence[Moving], images: Images, config: CaptureConfig, workers: int | None
) -> list[Refiner]:
    """What refines each of them alone."""
    return [
        Refiner.of(
            *(each.problem, each.motion, images, config),
            *(each.stage, workers, each.checkpoint),
        )
        for each in people
    ]


def _refinement(one: Refiner, given: Motion, found: Followed, refined: bool) -> Refinement:
    """What images made of a motion (F,), and how well it overlaps its masks."""
    actor = one.problem.actor
    skinned = SkinnedSurface(actor, found.motion)
    shown: SurfaceFrames = found.surface if refined else skinned
    surfaces = SkinnedSurface(actor, given), skinned, shown
    before, posed, after = (
        clip_overlaps(surface, one.sight, found.evidence, one.workers) for surface in surfaces
    )
    kept = np.ones(len(before), np.bool_)
    pose = PoseRefinement(found.motion, before, posed, kept)
    folded = np.zeros(len(before))
    surface = SurfaceRefinement(shown, posed, after, kept, folded) if refined else None
    template = actor.template
    mesh = surface_topology(template.vertices, template.faces).counts()
    return Refinement(found.motion, found.evidence, pose, surface, shown, mesh, found.tracking)
