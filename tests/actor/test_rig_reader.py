"""Skeleton files, and pytorch-kinematics as an independent opinion on kinematics."""

import math
from pathlib import Path

import pytest
import torch
from synthetic import random_motion, rest_positions
from torch import Tensor

from perfcap.actor.anatomy import human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.rig import Rig
from perfcap.actor.rig_reader import read_urdf
from perfcap.actor.skeleton import Skeleton
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix

pk = pytest.importorskip("pytorch_kinematics")
F64 = torch.float64


def parts(rig: Rig) -> list[tuple[str, str, str, Tensor, Tensor, tuple[float, ...] | None]]:
    """A rig as links of one hinge each: (link, parent, joint, offset, turn, axis and limits).

    A joint's hinges follow each other in place; a fixed link with C, which undoes the rest
    angles, ends each joint, so that its bones start in the axes of the rest pose.
    """
    tree, links = Skeleton(rig).tree, []
    for index, joint in enumerate(rig.joints):
        parent = rig.parents[index]
        above = rig.joints[parent] if parent >= 0 else "base"
        offset = tree.bone_vectors[index]
        for hinge in (h for h in rig.hinges if h.joint == joint):
            axis = (*hinge.axis, hinge.lower, hinge.upper)
            links.append((f"{hinge.name}_link", above, hinge.name, offset, torch.eye(3), axis))
            above, offset = f"{hinge.name}_link", torch.zeros(3)
        links.append((joint, above, f"{joint}_fixed", offset, tree.unrest[index], None))
    for index, mark in enumerate(rig.landmarks):
        if mark not in rig.joints:
            bone = tree.bone_vectors[len(rig.joints) + index]
            above = rig.joints[rig.landmark_joints[index]]
            links.append((mark, above, f"{mark}_fixed", bone, torch.eye(3), None))
    return links  # type: ignore[return-value]


def to_chain(rig: Rig) -> "pk.Chain":
    """The rig in pytorch-kinematics, in float64, which its file readers do not reach."""
    frames = {"base": pk.Frame("base", link=pk.Link("base"), joint=pk.Joint(dtype=F64))}
    for link, parent, joint, offset, turn, axis in parts(rig):
        place = pk.Transform3d(rot=turn.to(F64), pos=offset.to(F64), dtype=F64)
        kind = "fixed" if axis is None else "revolute"
        frames[link] = pk.Frame(
            link,
            link=pk.Link(link),
            joint=pk.Joint(
                joint, offset=place, joint_type=kind, axis=(axis or (0, 0, 1))[:3], dtype=F64
            ),
        )
        frames[parent].children = [*frames[parent].children, frames[link]]
    return pk.Chain(frames["base"], dtype=F64)


def to_urdf(rig: Rig) -> bytes:
    """The rig as a URDF file."""
    rows = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<robot name="person">',
        '<link name="base"/>',
    ]
    for link, parent, joint, offset, turn, axis in parts(rig):
        pitch = math.asin(-float(turn[2, 0]))
        rpy = (math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0]))
        rows += [
            f'<link name="{link}"/>',
            f'<joint name="{joint}" type="{"fixed" if axis is None else "revolute"}">',
            f'<parent link="{parent}"/><child link="{link}"/>',
            f'<origin xyz="{_numbers(offset.tolist())}" rpy="{_numbers(rpy)}"/>',
        ]
        if axis is not None:
            rows.append(f'<axis xyz="{_numbers(axis[:3])}"/>')
            rows.append(f'<limit lower="{axis[3]!r}" upper="{axis[4]!r}" effort="1" velocity="1"/>')
        rows.append("</joint>")
    return "\n".join([*rows, "</robot>"]).encode()


def _numbers(values: "list[float] | tuple[float, ...]") -> str:
    return " ".join(repr(float(value)) for value in values)


@pytest.fixture(scope="module")
def skeleton() -> Skeleton:
    return Skeleton(human_rig(rest_positions()))


@pytest.fixture(scope="module")
def chain(skeleton: Skeleton) -> "pk.Chain":
    return to_chain(skeleton.rig)


def oracle(chain: "pk.Chain", skeleton: Skeleton, motion: Motion, names: list[str]) -> Tensor:
    """World positions (F, N, 3) of links; the root pose is applied outside the chain."""
    order = [skeleton.angle_names.index(name) for name in chain.get_joint_parameter_names()]
    matrices = chain.forward_kinematics_tensor(motion.angles[:, order], analytical_grad=False)
    places = matrices[chain.get_frame_indices(*names), :, :3, 3].transpose(0, 1)
    root = rotvec_to_matrix(motion.rotation)
    return places @ root.mT + motion.translation[:, None]


def test_positions_agree_with_the_oracle(skeleton: Skeleton, chain: "pk.Chain") -> None:
    motion = random_motion(skeleton, 20)
    pose = skeleton(motion)
    joints = oracle(chain, skeleton, motion, list(skeleton.rig.joints))
    marks = oracle(chain, skeleton, motion, list(LANDMARKS))
    assert torch.allclose(pose.position, joints, atol=1e-12)
    assert torch.allclose(pose.landmarks, marks, atol=1e-12)


def test_derivatives_agree_with_the_oracle(skeleton: Skeleton, chain: "pk.Chain") -> None:
    motion = random_motion(skeleton, 5)

    def marks(step: Tensor) -> Tensor:
        moved = Motion(motion.translation, motion.rotation, motion.angles + step)
        return oracle(chain, skeleton, moved, list(LANDMARKS))

    expected = torch.func.jacfwd(marks)(torch.zeros(27, dtype=F64))
    assert torch.allclose(skeleton.linearize(motion)[1][..., 6:], expected, atol=1e-9)


def test_a_urdf_comes_back_as_the_same_kinematics(tmp_path: Path, skeleton: Skeleton) -> None:
    path = tmp_path / "person.urdf"
    path.write_bytes(to_urdf(skeleton.rig))
    read = Skeleton(read_urdf(path))
    assert read.rig.landmarks == LANDMARKS
    assert sorted(read.angle_names) == sorted(skeleton.angle_names)
    order = [skeleton.angle_names.index(name) for name in read.angle_names]
    assert torch.allclose(read.lower, skeleton.lower[order])
    assert torch.allclose(read.upper, skeleton.upper[order])
    motion = random_motion(skeleton, 10)
    same = Motion(motion.translation, motion.rotation, motion.angles[:, order])
    assert torch.allclose(read(same).landmarks, skeleton(motion).landmarks, atol=3e-6)


def test_joints_without_limits_are_free(tmp_path: Path, skeleton: Skeleton) -> None:
    path = tmp_path / "person.urdf"
    text = to_urdf(skeleton.rig).decode().replace('type="revolute"', 'type="continuous"')
    path.write_text("\n".join(line for line in text.splitlines() if "<limit" not in line))
    read = Skeleton(read_urdf(path))
    assert torch.isinf(read.lower).all()
    assert torch.isinf(read.upper).all()


def urdf_with(old: str, new: str) -> str:
    text = to_urdf(human_rig(rest_positions())).decode()
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no URDF"),
        ("<robot", "is no URDF"),
        ("<robot name='x'><link name='a'/></robot>", "is no URDF"),
        ("<!DOCTYPE r [<!ENTITY a 'b'>]><robot>&a;</robot>", "declares a document type"),
        (urdf_with("head_top", "hat"), "no link named head_top"),
        (urdf_with('"l_elbow_flexion" type="revolute"', '"l_elbow_flexion" type="prismatic"'),
         "joints l_elbow_flexion are no hinges"),
        (urdf_with('"l_elbow_flexion" type="revolute"', '"l_elbow_flexion" type="floating"'),
         "is no URDF"),
        ("<joint/>" * 1001, "more than 1000 joints"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_urdf(path)
    assert "bad.urdf" in str(caught.value)


def test_missing_large_and_binary_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_urdf(tmp_path / "none.urdf")
    large = tmp_path / "large.urdf"
    large.write_bytes(b" " * (4 * 2**20 + 1))
    with pytest.raises(InputError, match="remove meshes"):
        read_urdf(large)
    hidden = tmp_path / "hidden.urdf"
    hidden.write_bytes("<!DOCTYPE a>".encode("utf-16"))
    with pytest.raises(InputError, match="not UTF-8"):
        read_urdf(hidden)


def test_an_encoding_cannot_hide_a_document_type(tmp_path: Path) -> None:
    path = tmp_path / "seven.urdf"
    path.write_text('<?xml version="1.0" encoding="UTF-7"?>+ADw-!DOCTYPE a+AD4-<robot/>')
    with pytest.raises(InputError, match="is no URDF"):
        read_urdf(path)
