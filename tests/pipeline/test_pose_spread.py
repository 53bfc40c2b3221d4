"""How far parts may be off: from fewer views farther, and about as far as they are."""

import pytest
import torch
from crowds import RATE, make_crowd

from perfcap.actor.anatomy import JOINTS
from perfcap.detect.detections import Detections
from perfcap.pipeline import capture
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.pose_spread import part_deviations, parts_of_triangles

CROWD = make_crowd(1, frames=12, views=4)


def deviations(views: list[int], noise: float = 6.0, seed: int = 0):
    actor, motion = CROWD.actors[0], CROWD.motions[0]
    cameras = CROWD.cameras.select(views)
    pixels = cameras.project(actor.joints(motion))
    random = torch.Generator().manual_seed(seed)
    moved = pixels + noise * torch.randn(pixels.shape, generator=random, dtype=pixels.dtype)
    detections = Detections.from_joints(moved, torch.ones(moved.shape[:-1]).to(moved))
    found = capture(actor, cameras, detections, RATE)
    problem = ClipProblem.of(FrameProblem.of(actor, cameras, detections), RATE)
    return part_deviations(problem, found.motion), found.joints()


@pytest.mark.long
def test_fewer_views_know_less() -> None:
    many, few = (deviations(views)[0].mean(0) for views in ([0, 1, 2, 3], [0, 2]))
    assert many.shape == (16,) and (few > 1.1 * many).all()


def test_hands_are_less_sure_than_the_trunk() -> None:
    found = deviations([0, 1, 2, 3])[0].mean(0)
    at = {name: float(found[k]) for k, name in enumerate(JOINTS)}
    assert at["l_wrist"] > 1.1 * at["spine"] and at["r_ankle"] > 1.1 * at["pelvis"]


def test_they_are_about_as_large_as_errors() -> None:
    found, joints = deviations([0, 1, 2, 3])
    truth = CROWD.joints[0]
    error = (joints - truth).square().mean().sqrt()  # along an axis
    assert 0.5 < float(found.mean() / error) < 4


def test_every_triangle_has_a_part() -> None:
    actor = CROWD.actors[0]
    parts = parts_of_triangles(actor)
    assert parts.shape == (len(actor.template.faces),)
    assert set(parts) <= set(range(len(JOINTS))) and len(set(parts)) > 8
