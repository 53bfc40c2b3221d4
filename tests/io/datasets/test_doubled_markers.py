"""Files that name a joint twice, in whatever spelling, and the markers that are not joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scenes import assert_landmarks, person
from test_own_recordings import POSE2SIM, TRC_SET, write_pose2sim

from perfcap.detect.joint_set import doubled_names
from perfcap.errors import InputError


@pytest.mark.parametrize("name", ["RAnkle", "r_ankle", "R Ankle", "right_ankle", "R.Ankle"])
def test_a_trc_that_names_a_joint_twice(tmp_path: Path, name: str) -> None:
    write_pose2sim(tmp_path)
    path = tmp_path / "trial" / "pose-3d" / "trial.trc"
    path.write_text(path.read_text().replace("LWrist", name))
    with pytest.raises(InputError) as error:
        POSE2SIM.read(tmp_path, "trial")
    expected = f"trial.trc: names RAnkle and {name}, the same joint; expected each joint once"
    assert expected in str(error.value) and "\n" not in str(error.value)


def test_markers_that_are_no_joints_are_called_anything(tmp_path: Path) -> None:
    points = write_pose2sim(tmp_path)
    path = tmp_path / "trial" / "pose-3d" / "trial.trc"
    text = path.read_text().replace("RBigToe", "V_Sacral").replace("LWrist", "v_sacral")
    path.write_text(text)
    joints = POSE2SIM.read(tmp_path, "trial").joints3d
    assert joints is not None
    assert joints[:, 7].isnan().all() and joints[:, 11].isnan().all()
    points[:, [3, 8]] = np.nan
    assert_landmarks(joints, points, TRC_SET)


def test_a_triangulation_that_names_a_joint_twice(tmp_path: Path) -> None:
    write_pose2sim(tmp_path)
    points = person(TRC_SET)
    names = ["r_ankle" if name == "l_wrist" else name for name in TRC_SET.joints]
    path = tmp_path / "trial" / "pose-3d" / "reference3d.npz"
    np.savez(path, joints3d_m=points, names=names)
    with pytest.raises(InputError, match=r"reference3d\.npz: names r_ankle and r_ankle"):
        POSE2SIM.read(tmp_path, "trial")


def test_a_triangulation_of_no_frames(tmp_path: Path) -> None:
    write_pose2sim(tmp_path)
    path = tmp_path / "trial" / "pose-3d" / "reference3d.npz"
    np.savez(path, joints3d_m=person(TRC_SET)[:0], names=TRC_SET.joints)
    with pytest.raises(
        InputError, match=r"9 names for joints3d_m \(0, 9, 3\); expected .* or more"
    ):
        POSE2SIM.read(tmp_path, "trial")


def test_names_of_the_same_joint() -> None:
    assert doubled_names(["RAnkle", "LAnkle", "r_ankle"]) == "RAnkle and r_ankle"
    assert doubled_names(["RAnkle", "LAnkle"]) == ""
    assert doubled_names(4 * ["a"] + 2 * ["b", "c", "d", "e"]).endswith("c and c and 2 more")
