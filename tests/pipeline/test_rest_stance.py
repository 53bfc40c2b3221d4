"""Rest poses that face elsewhere or lean, which are no other motion."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor, rest_positions, template
from takes import sway
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.joint_motion import JointMotion
from perfcap.pipeline.rest_stance import upright_turn
from perfcap.pipeline.retarget_doubts import rest_doubts
from perfcap.pipeline.retarget_scores import RetargetScores, retarget_scores
from perfcap.pipeline.retargeting import Retargeted, retarget

F64 = torch.float64
PERSON = actor()
FREE = RetargetConfig()
FREE = replace(FREE, contact=replace(FREE.contact, enabled=False))
TURNS = {
    "aside": (0.0, 0.7, 0.0),
    "a little aside": (0.0, -0.14, 0.0),
    "leaning": (0.43, 0.0, 0.0),
    "both": (0.25, 0.5, 0.0),
}


def turned(*about: float) -> Actor:
    turn = rotvec_to_matrix(torch.tensor(about, dtype=F64))
    return Actor(template({name: turn @ place for name, place in rest_positions().items()}))


def hunched(lean: float) -> Actor:
    """Who leans above the hips alone."""
    at, turn = rest_positions(), rotvec_to_matrix(torch.tensor([lean, 0.0, 0.0], dtype=F64))
    legs = ("hip", "knee", "ankle", "toe")
    moved = {
        name: place if name.endswith(legs) else at["pelvis"] + turn @ (place - at["pelvis"])
        for name, place in at.items()
    }
    return Actor(template(moved))


def joints_of(person: Actor) -> JointMotion:
    pose = person.skeleton(sway(person, 6))
    return JointMotion(pose.rotation, pose.position)


def put(source: Actor, joints: JointMotion, target: Actor) -> tuple[Retargeted, RetargetScores]:
    found = retarget(source, joints, target, 30.0, FREE)
    return found, retarget_scores(source, joints, target, found, 30.0)


def centred(joints: Tensor) -> Tensor:
    return joints - joints.mean(-2, keepdim=True)


@pytest.mark.parametrize("name", TURNS)
def test_motion_on_a_character_whose_rest_pose_is_turned(name: str) -> None:
    target = turned(*TURNS[name])
    found, scores = put(PERSON, joints_of(PERSON), target)
    assert scores.facing.max() < 3 and scores.trunk.max() < 4
    assert scores.limbs.median() < 1  # limits of hips are measured from the world's upright
    apart = centred(target.joints(found.motion)) - centred(PERSON.joints(sway(PERSON, 6)))
    assert apart.norm(dim=-1).mean() < 0.02
    assert not list(rest_doubts(scores))


@pytest.mark.parametrize("name", TURNS)
def test_motion_of_a_character_whose_rest_pose_is_turned(name: str) -> None:
    source = turned(*TURNS[name])
    joints = joints_of(source)
    _, scores = put(source, joints, PERSON)
    assert scores.facing.median() < 2 and scores.trunk.median() < 3


def test_a_bearing_is_kept_and_told() -> None:
    """Who is drawn with a bent back alone keeps it, and is told of."""
    with pytest.warns(UserWarning, match="stand the character"):
        _, scores = put(PERSON, joints_of(PERSON), hunched(0.43))
    assert scores.trunk.median() > 20
    assert scores.report()["trunk_degrees"]["median"] > 20
    (line,) = rest_doubts(scores)
    assert "stand the character" in line


def test_who_stands_is_not_turned() -> None:
    same = torch.eye(3, dtype=F64)
    assert torch.equal(upright_turn(rest_positions()), same)
    for about in ((0.0, 0.03, 0.0), (0.1, 0.0, 0.0)):
        turn = rotvec_to_matrix(torch.tensor(about, dtype=F64))
        at = {name: turn @ place for name, place in rest_positions().items()}
        assert torch.equal(upright_turn(at), same)
    twisted = rest_positions()
    turn = rotvec_to_matrix(torch.tensor([0.0, 0.3, 0.0], dtype=F64))
    twisted |= {f"{side}_hip": turn @ twisted[f"{side}_hip"] for side in "lr"}
    twisted |= {f"{side}_shoulder": turn.mT @ twisted[f"{side}_shoulder"] for side in "lr"}
    assert torch.equal(upright_turn(twisted), same)


def test_a_turned_body_comes_upright() -> None:
    for about in TURNS.values():
        turn = rotvec_to_matrix(torch.tensor(about, dtype=F64))
        back = upright_turn({name: turn @ place for name, place in rest_positions().items()})
        assert torch.allclose(back @ back.mT, torch.eye(3, dtype=F64), atol=1e-12)
        assert float(torch.linalg.det(back)) == pytest.approx(1)
        assert float((back @ turn).trace()) > 2.998  # two degrees: trunk and legs are not in line
