"""Limbs that detections put at rest and masks show elsewhere: found, or rightly left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from synthetic import actor
from takes import make_take

from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.extract_silhouettes import given_record
from perfcap.pipeline.lost_limbs import LostLimbs, LostLimbsConfig, find_lost_limbs
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.presets import MONOPERFCAP
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface import SkinnedSurface
from perfcap.solve.particles import ParticleSettings

FRAMES, LOST = 10, slice(3, 8)
RIGHT = [LANDMARKS.index(f"r_{joint}") for joint in ("elbow", "wrist")]
ACTOR = actor()
HINGES = [hinge.joint for hinge in ACTOR.skeleton.rig.hinges]
# enough to find a limb, in seconds
QUICK = LostLimbsConfig(
    search=replace(LostLimbsConfig().search, particles=ParticleSettings(8, 20, 120))
)


def take_of(views: int = 1, sure: float = 0.1) -> tuple[Motion, Motion, ClipProblem, Sight]:
    """A person who raises the right arm, detections without that, a motion made of these.

    Detections are as ``sure`` of its elbow and wrist while it is raised.
    """
    take = make_take(FRAMES, views=views, actor=ACTOR)
    rest = take.truth.map(lambda each: each[:1].expand(FRAMES, *each.shape[1:]).clone())
    angles = rest.angles.clone()
    lower, upper = (side[6:] for side in ACTOR.skeleton.bounds)
    arm = [number for number, joint in enumerate(HINGES) if joint == "r_shoulder"]
    widest = max(arm, key=lambda number: float(upper[number] - lower[number]))
    far = max(lower[widest], upper[widest], key=lambda end: abs(end - angles[0, widest]))
    angles[LOST, widest] += 0.6 * (far - angles[0, widest])
    true = Motion(rest.translation, rest.rotation, angles)
    frames = FrameProblem.of(ACTOR, take.cameras, take.detections)
    confidence = take.detections.confidence2d.clone()
    confidence[LOST, :, RIGHT] = sure
    seen = replace(take.detections, confidence2d=confidence)
    problem = ClipProblem(ACTOR, take.cameras, seen, PoseConfig(), frames.pixel_unit, take.rate)
    faces = torch.as_tensor(ACTOR.template.faces.copy())
    return true, rest, problem, Sight(take.cameras, faces, ACTOR.template.weld()[0])


def masks_of(motion: Motion, sight: Sight) -> list[list[NDArray[np.bool_]]]:
    outlines = sight.outlines(SkinnedSurface(ACTOR, motion)[0:FRAMES], slice(0, FRAMES))
    return [[view.mask for view in frame] for frame in outlines]


def evidence_of(masks: list[list[NDArray[np.bool_]]], problem: ClipProblem) -> Evidence:
    views = [[given_record(frame[v]) for frame in masks] for v in range(len(masks[0]))]
    return Evidence.collect(views, 100 * problem.pixel_unit)


def found_in(
    motion: Motion, problem: ClipProblem, sight: Sight, evidence: Evidence, **options: object
) -> LostLimbs:
    config = options.pop("config", QUICK)
    return find_lost_limbs(problem, sight, evidence, motion, config, **options)  # type: ignore


@pytest.mark.long
def test_an_arm_that_detections_miss_is_found(tmp_path: Path) -> None:
    true, given, problem, sight = take_of()
    evidence = evidence_of(masks_of(true, sight), problem)
    found = found_in(given, problem, sight, evidence, workers=1)
    ((limb),) = found.found
    assert (limb.start, limb.stop, limb.limb) == (LOST.start, LOST.stop, "r_arm")
    assert limb.words == "right arm"
    assert limb.report(100) == {"frames": [103, 108], "limb": "r_arm"}
    pixels = [problem.cameras.project(ACTOR.joints(m))[:, 0] for m in (true, given, found.motion)]
    wrist = LANDMARKS.index("r_wrist")
    before, after = (float((p - pixels[0])[LOST, wrist].norm(dim=-1).mean()) for p in pixels[1:])
    assert after < 0.4 * before
    others = [n for n, joint in enumerate(HINGES) if joint not in ("r_shoulder", "r_elbow")]
    assert torch.equal(found.motion.angles[:, others], given.angles[:, others])
    assert torch.equal(found.motion.angles[:3], given.angles[:3])
    # what was detected of it counts no more, elsewhere all does
    seen, trusted = found.problem.detections.confidence2d, found.problem.detections.trusted3d
    assert not seen[LOST, 0, wrist].any() and not trusted[LOST].any()
    assert seen[LOST, 0, LANDMARKS.index("l_wrist")].all() and trusted[:3].all()
    again = found_in(given, problem, sight, evidence, workers=2)
    assert torch.equal(again.motion.angles, found.motion.angles)
    kept = Checkpoint(tmp_path)
    first = found_in(given, problem, sight, evidence, checkpoint=kept)
    second = found_in(given, problem, sight, evidence, checkpoint=Checkpoint(tmp_path))
    assert torch.equal(first.motion.angles, found.motion.angles)
    assert torch.equal(second.motion.angles, found.motion.angles) and second.found == found.found


@pytest.mark.long
def test_a_limb_that_is_seen_apart_and_surely_stays() -> None:
    """Cloth that swings out of a mask may look like a leg that no network sees."""
    true, given, problem, sight = take_of(sure=0.9)
    evidence = evidence_of(masks_of(true, sight), problem)
    assert not found_in(given, problem, sight, evidence).found
    left = [LANDMARKS.index(f"l_{joint}") for joint in ("elbow", "wrist")]
    pixels = problem.detections.joints2d.clone()
    pixels[LOST, :, RIGHT[1]] = pixels[LOST, :, left[1]] + 2
    partly = replace(problem, detections=replace(problem.detections, joints2d=pixels.clone()))
    assert not found_in(given, partly, sight, evidence).found
    pixels[LOST, :, RIGHT[0]] = pixels[LOST, :, left[0]] + 2
    twice = replace(problem, detections=replace(problem.detections, joints2d=pixels))
    assert found_in(given, twice, sight, evidence).found


def test_clothes_beside_the_body_are_no_limb() -> None:
    """A skirt that swings out: masks show more than the body, which does not stand out of them."""
    _, given, problem, sight = take_of()
    masks = masks_of(given, sight)
    for (mask,) in masks[LOST]:
        rows, columns = np.nonzero(mask)
        low = (rows.min() + 2 * rows.max()) // 3
        mask[low - 40 : low, columns.min() - 10 : columns.max() + 40] = True
    found = found_in(given, problem, sight, evidence_of(masks, problem))
    assert not found.found and found.motion is given and found.problem is problem


def test_limbs_cut_off_by_a_mask_stay() -> None:
    """Nothing that the mask shows would be explained by another pose."""
    _, given, problem, sight = take_of()
    masks = masks_of(given, sight)
    for (mask,) in masks[LOST]:
        mask[: mask.shape[0] // 2] = False
    found = found_in(given, problem, sight, evidence_of(masks, problem))
    assert not found.found


@pytest.mark.parametrize(("views", "config"), [(2, QUICK), (1, LostLimbsConfig(enabled=False))])
def test_several_views_and_other_presets_do_not_search(views: int, config: LostLimbsConfig) -> None:
    true, given, problem, sight = take_of(views)
    evidence = evidence_of(masks_of(true, sight), problem)
    found = found_in(given, problem, sight, evidence, config=config, checkpoint=NO_CHECKPOINT)
    assert found.motion is given and not found.found


@pytest.mark.long
def test_what_is_wrong_for_long_is_no_limb() -> None:
    true, given, problem, sight = take_of()
    evidence = evidence_of(masks_of(true, sight), problem)
    length = LOST.stop - LOST.start
    for longest in (length, length - 1):
        config = replace(QUICK, longest=longest)
        found = found_in(given, problem, sight, evidence, config=config)
        assert bool(found.found) == (longest == length)


def test_the_paper_does_not_search() -> None:
    assert not MONOPERFCAP.lost_limbs.enabled and LostLimbsConfig().enabled
