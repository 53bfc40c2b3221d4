"""Robots follow one way from frame to frame where frames on their own would jump."""

from pathlib import Path

import numpy as np
import robots
import torch

from perfcap.actor.motion import Motion
from perfcap.io import models_folder
from perfcap.io.actor import load_actor
from perfcap.io.robot import load_robot
from perfcap.pipeline.joint_motion import JointMotion
from perfcap.pipeline.retarget_scores import retarget_scores
from perfcap.pipeline.retargeting import retarget


def test_hinges_do_not_jump_and_limbs_follow(tmp_path: Path) -> None:
    man = load_actor("sam")
    with np.load(models_folder() / "demo" / "truth.npz", allow_pickle=False) as data:
        values = [torch.tensor(data[n][:24])
                  for n in ("root_translation", "root_rotation", "angles")]  # fmt: skip
        rate = float(data["fps"])
    pose = man.skeleton(Motion(*(each.to(man.vertices) for each in values)))
    joints = JointMotion(pose.rotation, pose.position)
    actor = load_robot(robots.write(tmp_path)["xml"])
    found = retarget(man, joints, actor, rate)
    assert found.motion.angles.diff(dim=0).abs().max().rad2deg() < 45
    assert retarget_scores(man, joints, actor, found, rate).limbs.median() < 4
