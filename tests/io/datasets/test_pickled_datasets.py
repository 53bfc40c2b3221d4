"""3DPW and EMDB, which are published as pickles."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scenes import FRAMES, Floats, assert_everybody, assert_landmarks, cameras, person

from perfcap.detect.joint_set import COCO18
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.datasets import find_dataset
from perfcap.io.datasets.joint_sets import SMPL24
from perfcap.io.datasets.smpl_joints import SmplJoints

THREE_DPW, EMDB = find_dataset("3dpw"), find_dataset("emdb")


def camera_poses() -> tuple[Floats, Floats]:
    """Intrinsics (3, 3) and world-to-camera poses (F, 4, 4) of a phone that moves sideways."""
    camera = cameras(1, 800)
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = camera.rotation[0], camera.translation[0]
    poses[:, 0, 3] += 0.1 * np.arange(FRAMES)
    return camera.intrinsics[0].numpy(), poses


def sequence_of_3dpw() -> dict[str, Any]:
    intrinsics, poses = camera_poses()
    people = [person(SMPL24, seed=seed) for seed in (0, 1)]
    detections = np.zeros((FRAMES, 3, 18))
    detections[:, :2, 4], detections[:, 2, 4] = 100.0, 0.9
    return {
        "sequence": "downtown_walking_00",
        "jointPositions": [points.reshape(FRAMES, 72) for points in people],
        "poses2d": [detections, np.zeros((FRAMES, 3, 18))],
        "campose_valid": [np.array([1, 1, 0, 1, 1]), np.ones(FRAMES, dtype=bool)],
        "cam_poses": poses,
        "cam_intrinsics": intrinsics,
        "img_frame_ids": np.arange(FRAMES),
        "genders": ["m", "f"],
        "betas": [np.zeros(10), np.zeros(10)],
    }


def write_3dpw(folder: Path, values: Any, protocol: int = 2) -> None:
    place = folder / "sequenceFiles" / "test"
    place.mkdir(parents=True, exist_ok=True)
    (place / "downtown_walking_00.pkl").write_bytes(pickle.dumps(values, protocol))


@pytest.mark.parametrize("protocol", [2, 4])
def test_3dpw(tmp_path: Path, protocol: int) -> None:
    write_3dpw(tmp_path, sequence_of_3dpw(), protocol)
    assert THREE_DPW.sequences(tmp_path) == ("downtown_walking_00",)
    sequence = THREE_DPW.read(tmp_path, "downtown_walking_00/1")
    assert sequence.joints3d is not None and sequence.rig is not None
    assert_landmarks(sequence.joints3d, person(SMPL24, seed=1), SMPL24)
    assert sequence.rig.cameras.moving and sequence.rig.cameras.size == ((800, 800),)
    torch.testing.assert_close(
        sequence.rig.cameras.translation[:, 0], torch.from_numpy(camera_poses()[1][:, :3, 3])
    )
    with pytest.raises(InputError, match=r"2 people; name one: downtown_walking_00/0, downto"):
        THREE_DPW.read(tmp_path, "downtown_walking_00")
    first = THREE_DPW.read(tmp_path, "downtown_walking_00/0")
    assert list(first.others) == ["downtown_walking_00/1"]
    torch.testing.assert_close(
        first.others["downtown_walking_00/1"], sequence.joints3d, equal_nan=True
    )
    assert first.name == "downtown_walking_00/0"
    assert first.counted(THREE_DPW.protocol).tolist() == [True, True, False, True, True]
    assert first.pixels is not None
    elbow = COCO18.joints[4].removeprefix("r_")  # the fifth of OpenPose is the right wrist
    assert elbow == "wrist" and (first.pixels[:, 0, 4] == 100).all()
    assert first.pixels[:, 0, 5].isnan().all()
    assert "head_top" not in THREE_DPW.protocol.joints and len(THREE_DPW.protocol.joints) == 15


def test_everybody_of_3dpw(tmp_path: Path) -> None:
    name = "downtown_walking_00"
    write_3dpw(tmp_path, sequence_of_3dpw())
    assert_everybody(tmp_path, "3dpw", name, (f"{name}/0", f"{name}/1"))
    assert THREE_DPW.people(tmp_path, f"{name}/1") == (f"{name}/1",)
    with pytest.raises(InputError, match="has no sequenceFiles"):
        THREE_DPW.people(tmp_path, "other")


def test_one_person_of_3dpw_needs_no_number(tmp_path: Path) -> None:
    values = sequence_of_3dpw()
    for key in ("jointPositions", "poses2d", "campose_valid"):
        values[key] = values[key][:1]
    write_3dpw(tmp_path, values)
    alone = THREE_DPW.read(tmp_path, "downtown_walking_00")
    assert alone.name == "downtown_walking_00/0" and not alone.others
    assert THREE_DPW.people(tmp_path, "downtown_walking_00") == ("downtown_walking_00/0",)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"jointPositions": None}, "no list jointPositions"),
        ({"jointPositions": [np.zeros((FRAMES, 66))]}, "(5, 66)"),
        ({"campose_valid": [np.ones(3)]}, "campose_valid"),
        ({"cam_poses": np.zeros((FRAMES, 4, 4))}, "orthonormal"),
        ({"cam_intrinsics": [1, 2, 3]}, "is list"),
        ({"cam_intrinsics": np.full((3, 3), np.nan)}, "cam_intrinsics hold NaN or infinity"),
        ({"cam_intrinsics": np.full((3, 3), np.inf)}, "cam_intrinsics hold NaN or infinity"),
        ({"poses2d": []}, "poses2d"),
    ],
)
def test_3dpw_that_cannot_be_used(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    write_3dpw(tmp_path, sequence_of_3dpw() | change)
    with pytest.raises(InputError) as error:
        THREE_DPW.read(tmp_path, "downtown_walking_00/0")
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    "name",
    [
        "downtown_walking_00/7",
        "downtown_walking_00/x",
        f"downtown_walking_00/{5000 * '9'}",
        "other/0",
    ],
)
def test_people_that_are_not_there(tmp_path: Path, name: str) -> None:
    write_3dpw(tmp_path, sequence_of_3dpw())
    with pytest.raises(InputError, match=r"has people 0 to 1|has no"):
        THREE_DPW.read(tmp_path, name)


class Attack:
    """What runs a program when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.mark),)


def test_a_program_in_a_pickle_does_not_run(tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    write_3dpw(tmp_path, sequence_of_3dpw() | {"extra": Attack(mark)})
    with pytest.raises(InputError, match="pickles can run programs"):
        THREE_DPW.read(tmp_path, "downtown_walking_00/0")
    assert not mark.exists()


PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)


def write_emdb(folder: Path, model: bool = True) -> dict[str, Any]:
    intrinsics, poses = camera_poses()
    rng = np.random.default_rng(0)
    values = {
        "gender": "female",
        "name": "P1_14_outdoor_climb",
        "emdb1": True,
        "emdb2": False,
        "n_frames": FRAMES,
        "good_frames_mask": np.array([True, True, True, False, True]),
        "camera": {"intrinsics": intrinsics, "extrinsics": poses, "width": 720, "height": 960},
        "smpl": {
            "poses_root": rng.normal(size=(FRAMES, 3)),
            "poses_body": 0.3 * rng.normal(size=(FRAMES, 69)),
            "trans": rng.normal(size=(FRAMES, 3)),
            "betas": rng.normal(size=10),
        },
        "kp2d": rng.uniform(0, 700, (FRAMES, 24, 2)),
        "bboxes": {"bboxes": np.zeros((FRAMES, 4)), "invalid_idxs": np.array([], dtype=int)},
    }
    place = folder / "P1" / "14_outdoor_climb"
    place.mkdir(parents=True)
    (place / "P1_14_outdoor_climb_data.pkl").write_bytes(pickle.dumps(values))
    if model:
        (folder / "smpl").mkdir()
        np.savez(folder / "smpl" / "female.npz", **body())
    return values


def body() -> dict[str, Floats]:
    rng = np.random.default_rng(1)
    parents = np.array([2**32 - 1, *PARENTS[1:]])  # as SMPL's own file has it
    return {
        "joints": rng.normal(size=(24, 3)),
        "joint_shapes": 0.01 * rng.normal(size=(24, 3, 10)),
        "parents": parents,
    }


def test_emdb(tmp_path: Path) -> None:
    values = write_emdb(tmp_path)
    assert EMDB.sequences(tmp_path) == ("P1/14_outdoor_climb",)
    assert EMDB.people(tmp_path, "P1") == ("P1",)  # all recordings of a subject are no take
    sequence = EMDB.read(tmp_path, "P1/14_outdoor_climb")
    assert sequence.joints3d is not None and sequence.rig is not None
    model = body()
    rest = model["joints"] + model["joint_shapes"] @ values["smpl"]["betas"]
    hips = 0.5 * (sequence.joints3d[:, 8] + sequence.joints3d[:, 12])
    # the hips hang on the root, which turns about itself
    root = rotvec_to_matrix(torch.from_numpy(values["smpl"]["poses_root"])).numpy()
    expected = rest[0] + values["smpl"]["trans"]
    expected = expected + (root @ (0.5 * (rest[1] + rest[2]) - rest[0]))
    np.testing.assert_allclose(hips, expected)
    assert sequence.rig.cameras.size == ((960, 720),)
    assert sequence.counted(EMDB.protocol).sum() == 4 and sequence.action == "emdb1"
    assert sequence.pixels is not None
    np.testing.assert_array_equal(sequence.pixels[:, 0, 1], values["kp2d"][:, 12])


def test_emdb_without_a_body_model(tmp_path: Path) -> None:
    write_emdb(tmp_path, model=False)
    sequence = EMDB.read(tmp_path, "P1/14_outdoor_climb")
    assert sequence.joints3d is None and sequence.pixels is not None
    assert "female.npz: no such file" in sequence.warnings[0]


@pytest.mark.parametrize("gender", [np.array(["male", "female"]), np.zeros(0), ["male"], "Male"])
def test_genders_that_emdb_does_not_have(tmp_path: Path, gender: Any) -> None:
    values = write_emdb(tmp_path) | {"gender": gender}
    path = tmp_path / "P1" / "14_outdoor_climb" / "P1_14_outdoor_climb_data.pkl"
    path.write_bytes(pickle.dumps(values))
    with pytest.raises(InputError, match="expected one of male, female, neutral"):
        EMDB.read(tmp_path, "P1/14_outdoor_climb")


def test_body_models_that_cannot_be_used(tmp_path: Path) -> None:
    write_emdb(tmp_path)
    wrong = body() | {"parents": np.arange(24)}
    np.savez(tmp_path / "smpl" / "female.npz", **wrong)
    with pytest.raises(InputError, match="before its child"):
        EMDB.read(tmp_path, "P1/14_outdoor_climb")


def test_bones_keep_their_lengths() -> None:
    """Whatever the pose; and a turn of the root alone turns the whole."""
    model = body()
    joints = SmplJoints(
        torch.from_numpy(model["joints"]), torch.from_numpy(model["joint_shapes"]), PARENTS
    )
    rotations = torch.randn(3, 24, 3, dtype=torch.float64)
    shape = torch.zeros(10, dtype=torch.float64)
    found = joints.positions(rotations, shape, torch.zeros(3, 3, dtype=torch.float64))
    lengths = (found[:, 1:] - found[:, list(PARENTS[1:])]).norm(dim=-1)
    rest = joints.rest
    torch.testing.assert_close(
        lengths, (rest[1:] - rest[list(PARENTS[1:])]).norm(dim=-1).expand(3, 23)
    )
    rotations[:, 1:] = 0
    turned = joints.positions(rotations, shape, torch.zeros(3, 3, dtype=torch.float64))
    expected = (rest - rest[0]) @ rotvec_to_matrix(rotations[:, 0]).mT + rest[0]
    torch.testing.assert_close(turned, expected)
