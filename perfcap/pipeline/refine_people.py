"""Several people from their motions to surfaces: silhouettes together, everything else alone.

As in Liu et al. 2013, Algorithm 2: once pixels are given to people, each is refined on their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from perfcap.actor.motion import Motion
from perfcap.geometry.surface_topology import surface_topology
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_people import Seen, extract_people
from perfcap.pipeline.followed_person import Follower
from perfcap.pipeline.frame_by_frame import Followed, follow
from perfcap.pipeline.keep_apart import keep_apart
from perfcap.pipeline.overlap import clip_overlaps
from perfcap.pipeline.pose_spread import part_deviations, pose_factors
from perfcap.pipeline.refine import ImageJob, Moving, Refinement, Refiner
from perfcap.pipeline.refine_pose import PoseRefinement
from perfcap.pipeline.refine_surface import SurfaceRefinement
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames
from perfcap.segment import SequenceSettings


def refine_people(people: Sequence[Moving], job: ImageJob) -> tuple[Refinement, ...]:
    """Silhouettes, poses kept apart, silhouettes again, surfaces; both once more where they meet.

    A network that finds persons is not asked: it does not say whom it found.
    """
    images, config = job.images, job.config
    own = [Refiner.of(each, job) for each in people]
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
            Seen(one.actor, one.sight, motion, unsure, one.heights, factors=drawn)
            for one, motion, unsure, drawn in zip(own, motions, deviations, factors, strict=True)
        ]
        if refined:
            pairs = zip(seen, refined, strict=True)
            seen = [replace(each, surface=known.vertices) for each, known in pairs]
        before = [known.evidence for known in refined] or None
        with job.stage(name) as tell:
            given = job.workers, tell, job.checkpoint, name, config.silhouettes.people
            return extract_people(seen, images.reader, settings, *given, before=before)

    motions = [each.motion for each in people]
    evidence = extract("extract_silhouettes", motions, config.silhouettes.first)
    poses = [one.pose(found) for one, found in zip(own, evidence, strict=True)]
    with job.stage("keep_apart"):
        poses = _apart(own, evidence, poses)
    motions = [pose.motion for pose in poses]
    evidence = extract("extract_silhouettes_again", motions, config.silhouettes.again)
    rows = zip(own, evidence, poses, strict=True)
    refined = [one.finish(found, pose) for one, found, pose in rows]
    if len(own) == 1 or job.until < Stage.REFINE_SURFACE:
        return tuple(refined)
    # Surfaces that meet their silhouettes say better than skinned ones who is where: a skirt that
    # swings, a limb that is a little off. That shows where people meet, and there alone.
    for number in range(config.silhouettes.closer):
        if number:
            name, rows = f"refine_surface_{number + 1}", zip(own, evidence, poses, strict=True)
            refined = [one.finish(found, pose, name) for one, found, pose in rows]
        name = f"extract_silhouettes_{number + 3}"
        evidence = extract(name, motions, config.silhouettes.again, refined)
        pairs = zip(refined, evidence, strict=True)
        refined = [replace(each, evidence=found) for each, found in pairs]
    return tuple(refined)


def follow_people(people: Sequence[Moving], job: ImageJob) -> tuple[Refinement, ...]:
    """The same frame by frame, from where motions begin (Liu et al. 2013); one person or several.

    ``config.frames`` of the job says how.
    """
    config = job.config
    assert config.frames is not None
    own = [Refiner.of(each, job) for each in people]
    followers = [
        Follower(
            one.actor,
            one.sight,
            one.heights,
            one.person.motion,
            part_deviations(one.person.problem, one.person.motion)[0],
        )
        for one in own
    ]
    refined = job.until >= Stage.REFINE_SURFACE
    with job.stage("follow_frames") as tell:
        settings = config.frames, config.silhouettes.first, refined
        labels = config.silhouettes.people
        found = follow(followers, job.images, *settings, job.workers, tell, job.checkpoint, labels)
    return tuple(_refinement(one, each, refined) for one, each in zip(own, found, strict=True))


def _apart(
    own: Sequence[Refiner], evidence: Sequence[Evidence], poses: Sequence[PoseRefinement]
) -> list[PoseRefinement]:
    """Poses of people whose skins do not pass through each other."""
    actors, motions = [one.actor for one in own], [pose.motion for pose in poses]
    result = []
    parted = keep_apart(actors, motions, own[0].job.config.apart)
    for one, found, pose, motion in zip(own, evidence, poses, parted, strict=True):
        if motion is not pose.motion:
            surface = SkinnedSurface(one.actor, motion)
            after = clip_overlaps(surface, one.sight, found, one.job.workers)
            pose = replace(pose, motion=motion, after=after)
        result.append(pose)
    return result


def _refinement(one: Refiner, found: Followed, refined: bool) -> Refinement:
    """What images made of a person's motion, and how well it overlaps its masks."""
    actor, given = one.actor, one.person.motion
    skinned = SkinnedSurface(actor, found.motion)
    shown: SurfaceFrames = found.surface if refined else skinned
    surfaces = SkinnedSurface(actor, given), skinned, shown
    before, posed, after = (
        clip_overlaps(surface, one.sight, found.evidence, one.job.workers) for surface in surfaces
    )
    kept = np.ones(len(before), np.bool_)
    pose = PoseRefinement(found.motion, before, posed, kept)
    folded = np.zeros(len(before))
    surface = SurfaceRefinement(shown, posed, after, kept, folded) if refined else None
    template = actor.template
    mesh = surface_topology(template.vertices, template.faces).counts()
    return Refinement(found.motion, found.evidence, pose, surface, shown, mesh, found.tracking)
