"""The floor, contacts, and a second solve that keeps feet where they stand."""

import math
from dataclasses import replace

import pytest
import torch
from synthetic import actor
from synthetic import cameras as circle
from takes import detect
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.sole_points import sole_skeleton
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import ContactConfig
from perfcap.pipeline.floor import Floor, find_floor, lean_doubts
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.objective import FrameProblem, neutral_angles
from perfcap.pipeline.presets import MONOPERFCAP, CaptureConfig
from perfcap.pipeline.stances import (
    contact_probability,
    find_stances,
    settled_places,
    split_stances,
)
from perfcap.pipeline.standing import find_standing
from perfcap.pipeline.track_twice import track_twice

F64 = torch.float64
UP = torch.tensor([0.0, 1.0, 0.0], dtype=F64)


def steps(frames: int = 90) -> Tensor:
    """Two feet of four points that take turns: one stands for half a second, one swings, (F, 8, 3).

    On the floor y = 0, towards +x.
    """
    rest = torch.tensor([[-0.1, 0, 0], [0.1, 0, -0.04], [0.1, 0, 0.04], [0.15, 0, 0]], dtype=F64)
    feet = []
    for foot in range(2):
        phase = torch.arange(frames, dtype=F64) / 15 + foot
        share = (phase % 2 - 1).clamp(min=0)
        smooth = share**2 * (3 - 2 * share)
        place = 0.7 * (torch.div(phase, 2, rounding_mode="floor") + smooth)
        lift = 0.1 * torch.sin(math.pi * share)
        way = torch.stack((place, lift, torch.full_like(place, 0.2 * foot)), -1)
        feet.append(way[:, None] + rest)
    return torch.cat(feet, 1)


def truth(frames: int = 90) -> Tensor:
    """Which of these points stand, (F, 8)."""
    phase = torch.arange(frames)[:, None] / 15 + torch.tensor([0, 1])
    return (phase % 2 < 1).repeat_interleave(4, 1)


def body(soles: Tensor) -> Tensor:
    """Sixteen landmarks above the feet, (F, 16, 3)."""
    middle = soles.mean(1, keepdim=True) * soles.new_tensor([1.0, 0.0, 1.0])
    return middle + soles.new_tensor([0.0, 1.0, 0.0]) * torch.linspace(1, 1.4, 16)[:, None]


def test_the_floor_of_a_tilted_walk() -> None:
    noise = 0.005 * torch.randn(90, 8, 3, generator=torch.Generator().manual_seed(0), dtype=F64)
    soles = steps() + noise
    turn = rotvec_to_matrix(torch.tensor([0.3, 0.0, 0.2], dtype=F64))
    offset = torch.tensor([0.0, 0.5, 0.0], dtype=F64)
    landmarks, tilted = body(soles) @ turn.T + offset, soles @ turn.T + offset
    floor = find_floor(landmarks, tilted, 30.0)
    angle = math.degrees(math.acos(float(floor.normal @ (turn @ UP))))
    assert angle < 1.5
    assert floor.above(tilted[truth()]).abs().mean() < 0.01
    assert floor.support > 0.8


def test_an_axis_of_the_world_is_taken_where_it_explains_the_feet() -> None:
    soles = steps()
    lean = torch.tensor([0.0, 0.0, 0.3], dtype=F64)  # of the body, along the walk
    landmarks = body(soles) + lean
    cameras = circle(3).select([1])
    floor = find_floor(landmarks, soles, 30.0, cameras)
    assert torch.allclose(floor.normal, UP, atol=1e-3)
    hill = soles @ rotvec_to_matrix(torch.tensor([0.0, 0.0, 0.25], dtype=F64)).T
    assert float(find_floor(body(hill), hill, 30.0, cameras).normal @ UP) < math.cos(0.15)


@pytest.mark.parametrize(
    ("turn", "told"),
    [([0.35, 0.0, 0.0], True), ([0.0, 0.0, -0.4], True), ([0.05, 0.0, 0.05], False),
     ([0.0, 1.0, 0.0], False), ([0.0, 0.0, 1.57], False)],
)  # fmt: skip
def test_a_world_that_leans_is_told_from_a_level_one(turn: list[float], told: bool) -> None:
    way, soles = rotvec_to_matrix(torch.tensor(turn, dtype=F64)), steps()
    landmarks, moved = body(soles) @ way.mT, soles @ way.mT
    level = find_floor(landmarks, moved, 30.0, normal=UP)
    lines = list(lean_doubts(landmarks, moved, 30.0, level))
    assert len(lines) == told and all("floor that leans" in line for line in lines)


def test_whoever_walks_up_a_hill_is_in_a_level_world() -> None:
    hill = steps() @ rotvec_to_matrix(torch.tensor([0.0, 0.0, 0.35], dtype=F64)).T
    level = find_floor(body(hill), hill, 30.0, normal=UP)
    assert level.support < 0.8
    assert not list(lean_doubts(body(hill), hill, 30.0, level))


def test_contacts_of_a_walk() -> None:
    floor = Floor(UP, torch.zeros((), dtype=F64), 0.0, 1.0)
    noise = 0.003 * torch.randn(90, 8, 3, generator=torch.Generator().manual_seed(1), dtype=F64)
    sure = contact_probability(steps() + noise, floor, 30.0)
    agrees = ((sure > 0.5) == truth()).double().mean()
    assert agrees > 0.85
    assert float(sure.min()) >= 0 and float(sure.max()) <= 1
    # nobody stands half a metre above the floor
    assert float(contact_probability(steps() + 0.5 * UP, floor, 30.0).max()) < 0.5


def test_a_doubtful_frame_does_not_end_a_stance() -> None:
    floor = Floor(UP, torch.zeros((), dtype=F64), 0.0, 1.0)
    still = steps()[:1].expand(40, 8, 3).clone()
    still[:, 4:, 1] = 0.0
    still[20] += torch.tensor([0.03, 0.02, 0.0], dtype=F64)
    assert float(contact_probability(still, floor, 30.0).min()) > 0.5


def test_places_undo_the_drift_of_a_motion() -> None:
    floor = Floor(UP, torch.zeros((), dtype=F64), 0.0, 1.0)
    drift = 0.2 * torch.sin(torch.arange(90, dtype=F64) / 12)[:, None] * torch.eye(3)[2].to(F64)
    soles = steps() + drift[:, None]
    precision = torch.diag(torch.tensor([1e6, 1e6, 1.0], dtype=F64)).expand(90, 3, 3)
    stances = find_stances(truth().to(F64), 30.0)
    settled = settled_places(soles, stances, floor, precision, 0.02)
    stands = truth()
    # feet are drift-free up to one offset of the whole walk
    off = (settled.place - steps())[stands]
    assert (off - off.mean(0)).norm(dim=-1).max() < 0.03
    spread = (drift + settled.shift)[10:80, 2]
    assert float(spread.max() - spread.min()) < 0.06  # of 0.4 m


def test_a_step_inside_a_stance_splits_it() -> None:
    floor = Floor(UP, torch.zeros((), dtype=F64), 0.0, 1.0)
    soles = torch.zeros(40, 8, 3, dtype=F64)
    soles[26:, 0, 0] = 0.3
    stances = find_stances(torch.ones(40, 8, dtype=F64), 30.0)
    assert stances.count == 8
    precision = 1e6 * torch.eye(3, dtype=F64).expand(40, 3, 3)
    settled = settled_places(soles, stances, floor, precision, 0.02)
    assert split_stances(stances, settled, 30.0).count == 9


def swaying(frames: int = 45) -> Motion:
    """A person who stands on both feet and sways."""
    person = actor()
    turn = torch.zeros(frames, 3, dtype=F64)
    place = person.skeleton.rest_positions[0].expand(frames, 3)
    angles = person.skeleton.rest_angles.expand(frames, -1).clone()
    time = torch.arange(frames, dtype=F64) / 30
    arms = [i for i, n in enumerate(person.skeleton.angle_names) if "shoulder" in n]
    middle = neutral_angles(person)[arms]
    angles[:, arms] = middle + 0.3 * torch.sin(4 * time)[:, None]
    return Motion(place, turn, angles)


@pytest.mark.long
@pytest.mark.parametrize("lifted", [True, False])
def test_a_capture_keeps_feet_where_they_stand(lifted: bool) -> None:
    person, motion = actor(), swaying()
    cameras = circle(3, size=600).select([0])
    exact = detect(person, cameras, motion, lifted)
    slides = {False: 0.0, True: 0.0}
    for seed in (3, 4):
        random = torch.Generator().manual_seed(seed)
        noisy = exact.joints2d + 3 * torch.randn(exact.joints2d.shape, generator=random, dtype=F64)
        poses = exact.joints3d
        if poses is not None:
            poses = poses + 0.05 * torch.randn(poses.shape, generator=random, dtype=F64)
        detections = replace(exact, joints2d=noisy, joints3d=poses)
        for enabled in slides:
            pose = replace(CaptureConfig().pose, contact=ContactConfig(enabled=enabled))
            config = replace(CaptureConfig(), pose=pose)
            found = capture(person, cameras, detections, 30.0, config)
            soles = sole_skeleton(person)(found.motion).landmarks[:, -8:]
            slides[enabled] += float(soles.diff(dim=0).norm(dim=-1).mean())
    assert slides[True] < 0.7 * slides[False]


def test_the_second_solve_starts_where_feet_stand() -> None:
    """Without steps of the solver, the start is the result: the drift of the motion is gone."""
    person, motion = actor(), swaying()
    drift = 0.04 * torch.linspace(0, 1, motion.frames, dtype=F64)[:, None] * UP.roll(1)
    start = replace(motion, translation=motion.translation + drift)
    seen, pose = detect(person, circle(3), motion), CaptureConfig().pose
    pose = replace(pose, max_steps=0, evidence=replace(pose.evidence, enabled=False))
    frames = FrameProblem.of(person, circle(3), seen, pose)
    found, _, last = track_twice(ClipProblem.of(frames, 30.0), start)
    assert last.standing is not None and last.standing.shift.norm(dim=-1).max() > 0.005
    torch.testing.assert_close(found.translation, start.translation + last.standing.shift)


def test_who_is_in_the_air_stands_nowhere() -> None:
    person, motion = actor(), swaying()
    time = torch.arange(45, dtype=F64)[:, None] / 30
    flight = torch.cat((2 * time, 1.5 * torch.sin(3 * time), torch.cos(2 * time)), -1)
    flying = replace(motion, translation=motion.translation + flight)
    precision = 1e4 * torch.eye(3, dtype=F64).expand(45, 3, 3)
    found = find_standing(person, flying, 30.0, ContactConfig(), precision)
    assert found is None or float((found.feet > 0.5).double().mean()) < 0.1


def test_less_support_is_enough_where_up_is_known() -> None:
    person, motion = actor(), swaying()
    away = torch.zeros(motion.frames, 3, dtype=F64)
    away[:, 1] = 0.35 * torch.linspace(-0.3, 1, motion.frames, dtype=F64).clamp(min=0)
    rising = replace(motion, translation=motion.translation + away)
    points = sole_skeleton(person)(rising).landmarks
    known = find_floor(points[:, :-8], points[:, -8:], 30.0, normal=UP).support
    free = find_floor(points[:, :-8], points[:, -8:], 30.0).support
    assert 0.2 < known < 0.52 and free < 1.2 * known
    precision = 1e4 * torch.eye(3, dtype=F64).expand(motion.frames, 3, 3)
    for wanted, normal, stands in (
        (1.3 * known, None, False),
        (1.3 * known, UP, True),
        (1.9 * known, UP, False),
    ):
        config = ContactConfig(support=wanted)
        found = find_standing(person, rising, 30.0, config, precision, normal=normal)
        assert (found is not None) == stands


def test_the_published_preset_has_no_contact() -> None:
    assert not MONOPERFCAP.pose.contact.enabled


def test_a_world_with_the_floor_at_zero() -> None:
    normal = torch.nn.functional.normalize(torch.tensor([0.3, -0.8, 0.4], dtype=F64), dim=0)
    for each in (normal, UP, -UP):
        floor = Floor(each, torch.tensor(0.7, dtype=F64), 0.0, 1.0)
        turn = floor.world_to_floor()
        torch.testing.assert_close(turn[:3, :3] @ each, UP)
        assert float(torch.linalg.det(turn[:3, :3])) == pytest.approx(1)
        assert float((turn[:3, :3] @ (0.7 * each) + turn[:3, 3])[1]) == pytest.approx(0, abs=1e-12)


def test_worlds_upside_down_keep_their_headings() -> None:
    """Noise of the floor does not turn what one still camera saw in several takes apart."""
    for lean in ((0.02, 0.01), (-0.02, 0.02), (0.0, -0.03)):
        normal = torch.tensor([lean[0], -1.0, lean[1]], dtype=F64)
        floor = Floor(normal / normal.norm(), torch.zeros((), dtype=F64), 0.0, 1.0)
        assert float(floor.world_to_floor()[0, 0]) > 0.99
