"""A URDF plays in MuJoCo as perfcap posed it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import robots
from robot_models import playable
from runs import Command
from scipy.spatial.transform import Rotation

from perfcap.io.export import Recording
from perfcap.io.result import read_result

mujoco: Any = pytest.importorskip("mujoco", reason="pip install mujoco plays robots")


def test_a_urdf_plays_as_it_was_posed(captured: Path, tmp_path: Path, perfcap: Command) -> None:
    """Joints in MuJoCo's order and within its limits, bodies within 0.1 mm and 0.01 degrees."""
    robot, out = robots.write(tmp_path)["urdf"], tmp_path / "out"
    assert perfcap(["retarget", captured, "--actor", robot, "--out", out]).code == 0
    assert perfcap(["export", out, "--to", "qpos", "--name", "a"]).code == 0
    with np.load(out / "export" / "a_qpos.npz", allow_pickle=False) as found:
        qpos, names = found["qpos"], found["joint_names"].tolist()
    model = playable(robot)
    assert [model.joint(number).name for number in range(1, model.njnt)] == names
    assert model.nq == qpos.shape[1]
    lower, upper = model.jnt_range[1:].T
    assert ((qpos[:, 7:] >= lower - 1e-12) & (qpos[:, 7:] <= upper + 1e-12)).all()
    data, result = mujoco.MjData(model), read_result(out)
    bones = Recording(result, "a", 0, result.frames).facing_up("z").posed_bones
    for values, posed in zip(qpos, bones, strict=True):
        data.qpos[:] = values
        mujoco.mj_kinematics(model, data)
        theirs = [data.body(name) for name in result.template.bone_names]
        assert np.abs(np.array([body.xpos for body in theirs]) - posed[:, :3, 3]).max() < 1e-4
        turned = Rotation.from_matrix([body.xmat.reshape(3, 3) for body in theirs])
        apart = turned.inv() * Rotation.from_matrix(posed[:, :3, :3])
        assert np.degrees(apart.magnitude()).max() < 0.01
