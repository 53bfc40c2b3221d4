"""``perfcap retarget`` onto robots, and ``perfcap export --to qpos``."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import robots
import torch
from runs import Command

from perfcap.actor.motion import Motion
from perfcap.io import models_folder
from perfcap.io.actor import load_actor
from perfcap.io.export import Recording
from perfcap.io.result import read_result
from perfcap.pipeline.joint_motion import JointMotion
from perfcap.pipeline.retargeting import retarget


@pytest.mark.long
def test_a_capture_on_a_robot(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    """Within limits, in the robot's own angles, and alike in all files."""
    robot, out = robots.write(tmp_path)["xml"], tmp_path / "out"
    outcome = perfcap(["retarget", captured, "--actor", robot, "--out", out])
    assert outcome.code == 0
    kept = json.loads((out / "run.json").read_text())
    assert kept["retarget"]["limbs_degrees"]["median"] < 3
    assert perfcap(["export", out, "--to", "qpos", "csv", "bvh", "--name", "a"]).code == 0
    with np.load(out / "export" / "a_qpos.npz", allow_pickle=False) as found:
        qpos, names = found["qpos"], found["joint_names"].tolist()
        assert float(found["fps"]) == read_result(out).rate
        assert np.array_equal(np.concatenate((found["root_position"], found["root_quaternion"],
                                              found["angles"]), 1), qpos)  # fmt: skip
    limits = {name: np.radians(both) for name, _, both in robots.HINGES}
    assert sorted(names) == sorted(limits)
    for column, name in enumerate(names, 7):
        assert limits[name][0] - 1e-12 <= qpos[:, column].min()
        assert qpos[:, column].max() <= limits[name][1] + 1e-12
    assert np.allclose(np.linalg.norm(qpos[:, 3:7], axis=1), 1)
    with (out / "export" / "a_qpos.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:9] == ["frame", "time_s", "root_x", "root_y", "root_z", "root_qw", "root_qx",
                           "root_qy", "root_qz"]  # fmt: skip
    assert rows[0][9:] == names
    assert np.allclose(np.array(rows[1:], dtype=float)[:, 2:], qpos, atol=1e-6)
    # the numbers put the bodies where the skeleton has them, by the file's own kinematics
    result = read_result(out)
    bones = Recording(result, "a", 0, result.frames).facing_up("z").posed_bones
    for frame in range(result.frames):
        world = robots.posed(qpos[frame], names)
        apart = [np.abs(world[name] - bones[frame, bone]).max()
                 for bone, name in enumerate(result.template.bone_names)]  # fmt: skip
        assert max(apart) < 2e-6  # bones are kept in float32


@pytest.mark.long
def test_feet_stay_above_the_floor(tmp_path: Path) -> None:
    """Corners of the robot's own soles, while the shipped demo's man dances."""
    man = load_actor("sam")
    with np.load(models_folder() / "demo" / "truth.npz", allow_pickle=False) as data:
        values = [torch.tensor(data[n][::2][:40])
                  for n in ("root_translation", "root_rotation", "angles")]  # fmt: skip
        rate = float(data["fps"]) / 2
    pose = man.skeleton(Motion(*(each.to(man.vertices) for each in values)))
    actor = load_actor(robots.write(tmp_path)["urdf"], robots=True)
    found = retarget(man, JointMotion(pose.rotation, pose.position), actor, rate)
    assert found.floor is not None
    lower, upper = actor.skeleton.lower, actor.skeleton.upper
    assert ((found.motion.angles >= lower) & (found.motion.angles <= upper)).all()
    names = actor.skeleton.rig.joints
    bones = actor.bone_transforms(found.motion).numpy() @ actor.template.bone_rest
    ahead, (length, width, _) = robots.FOOT
    corners = np.array([[ahead + x * length / 2, y * width / 2, -0.05, 1.0]
                        for x in (-1, 1) for y in (-1, 1)])  # fmt: skip
    for side in ("left", "right"):
        foot = bones[:, names.index(f"{side}_foot")]
        heights = np.einsum("fij,cj->fci", foot, corners)[..., 1]
        assert heights.min() > -0.01
        assert heights.min(1).mean() < 0.15  # and not in the air


def test_qpos_is_of_robots(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    said = perfcap(["export", captured, "--to", "qpos", "--out", tmp_path / "x"]).refused()
    assert "is no motion of a robot" in said and "--actor robot.xml" in said
    robot = robots.write(tmp_path)["urdf"]
    call = ["actor", "inspect", robot]
    assert "is a robot" in perfcap(call).refused()
