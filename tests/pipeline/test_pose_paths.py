"""Robots follow one way from frame to frame where frames on their own would jump."""

import re
from pathlib import Path

import numpy as np
import pytest
import robots
import torch

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.io import models_folder
from perfcap.io.actor import load_actor
from perfcap.io.robot import load_robot
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.joint_motion import JointMotion
from perfcap.pipeline.retarget_scores import retarget_scores
from perfcap.pipeline.retargeting import retarget


def _demo(frames: int) -> tuple[Actor, JointMotion, float]:
    """The shipped man's joints while he dances, and frames a second."""
    man = load_actor("sam")
    with np.load(models_folder() / "demo" / "truth.npz", allow_pickle=False) as data:
        values = [torch.tensor(data[n][:frames])
                  for n in ("root_translation", "root_rotation", "angles")]  # fmt: skip
        rate = float(data["fps"])
    pose = man.skeleton(Motion(*(each.to(man.vertices) for each in values)))
    return man, JointMotion(pose.rotation, pose.position), rate


def _narrow(tmp_path: Path) -> Actor:
    """A robot whose limits leave few ways, and whose hands turn about the forearms.

    The turn lies in the wrist and moves it by rounding errors only.
    """
    text = robots.urdf()
    for title, few in {"_shoulder_roll": 35, "_hip_yaw": 10, "_ankle_roll": 5}.items():
        pattern = rf'(<joint name="\w+{title}".*?<limit lower=")[^"]*(" upper=")[^"]*'
        text = re.sub(pattern, rf"\g<1>{-np.radians(few)}\g<2>{np.radians(few)}", text)
    for side in ("left", "right"):
        text = re.sub(
            rf'<joint name="{side}_hand_fixed" type="fixed"><parent link="{side}_forearm"/>(.*?)'
            r'<origin xyz="([^"]*)"/><axis xyz="[^"]*"/>',
            rf'<link name="{side}_lower"/><joint name="{side}_twist" type="revolute">'
            rf'<parent link="{side}_forearm"/><child link="{side}_lower"/><origin xyz="\2"/>'
            r'<axis xyz="0 0 1"/><limit lower="-2" upper="2"/></joint>'
            rf'<joint name="{side}_wrist" type="revolute"><parent link="{side}_lower"/>\1'
            r'<origin xyz="1e-8 0 0"/><axis xyz="1 0 0"/><limit lower="-2" upper="2"/>',
            text,
        )
    path = tmp_path / "narrow.urdf"
    path.write_text(text)
    return load_robot(path)


@pytest.mark.long
def test_hinges_keep_their_pace_and_what_nothing_shows_rests(tmp_path: Path) -> None:
    man, joints, rate = _demo(40)
    actor = _narrow(tmp_path)
    slow = RetargetConfig(speed=300)  # limbs are far off meanwhile
    angles = retarget(man, joints, actor, rate, slow, examined=True).motion.angles.rad2deg()
    assert angles.diff(dim=0).abs().max() <= 300 / rate + 1e-3
    twists = [n for n, name in enumerate(actor.skeleton.angle_names) if name.endswith("twist")]
    assert len(twists) == 2 and angles[:, twists].abs().max() < 1


@pytest.mark.long
def test_hinges_do_not_jump_and_limbs_follow(tmp_path: Path) -> None:
    man, joints, rate = _demo(24)
    actor = load_robot(robots.write(tmp_path)["xml"])
    found = retarget(man, joints, actor, rate)
    assert found.motion.angles.diff(dim=0).abs().max().rad2deg() < 45
    assert retarget_scores(man, joints, actor, found, rate).limbs.median() < 4
