"""Read the skeleton of a URDF file that marks a person's 16 landmarks.

Links become joints, their hinges keep names and limits. The rest pose is the file's zero pose, in
the file's own axes and in metres, and angles count from it. A link for each landmark, by name;
empty ones on fixed joints are the usual way to mark the top of the head or the toes. Robots, which
mark nothing, are actors of ``perfcap.io.robot``.

The file is read by pytorch-kinematics, whose reader works in float32: positions hold to 1e-7 m.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.rig import Hinge, Rig
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError

BYTES_LIMIT = 4 * 2**20
LINKS_LIMIT = 1000  # the URDF builder compares all pairs of joints and recurses down the tree
_XML_DECLARATION = re.compile(r"\A\s*<\?xml[^>]*\?>")
_DECLARATIONS = re.compile(r"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)
_LINKS = re.compile(r"<\s*(?:\w+:)?joint\b")


def read_urdf(path: str | Path) -> Rig:
    """The skeleton of a URDF file.

    Raises:
        InputError: the file is no URDF of revolute, continuous and fixed joints, or has no link
            for one of the landmarks.
    """
    path = Path(path)
    text = _read_xml(path)
    try:
        import pytorch_kinematics

        # bytes, because the parser refuses text that declares its encoding
        chain = pytorch_kinematics.build_chain_from_urdf(text.encode())
        names = chain.get_frame_names(exclude_fixed=False)
        zero = torch.zeros(len(chain.get_joint_parameter_names()))
        poses = chain.forward_kinematics(zero)
    except Exception as error:  # the parser raises anything, from KeyError to AssertionError
        raise _unreadable(path, error) from error
    frames = list(_walk(chain.find_frame(names[0])))
    joints = tuple(frame.name for frame, _ in frames)
    _refuse_sliding(path, [f.joint.name for f, _ in frames if f.joint.joint_type == "prismatic"])
    matrices = torch.stack([poses[name].get_matrix()[0] for name in joints]).double()
    return _rig(
        path,
        joints,
        [parent for _, parent in frames],
        matrices[:, :3, 3],
        [
            _hinge(
                frame.joint.name,
                frame.name,
                matrix[:3, :3] @ frame.joint.axis.to(matrix),
                frame.joint.limits or (0.0, 0.0),
            )
            for (frame, _), matrix in zip(frames, matrices, strict=True)
            if frame.joint.joint_type == "revolute"
        ],
        {name: (index, matrices[index, :3, 3]) for index, name in enumerate(joints)},
    )


def _read_xml(path: Path) -> str:
    """Text of a small XML file that declares no entities, without its XML declaration."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected a URDF file")
    size = path.stat().st_size
    if size > BYTES_LIMIT:
        raise InputError(
            f"{path}: is {size} bytes, a URDF may have {BYTES_LIMIT}; remove meshes and comments"
        )
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text; expected a URDF file") from error
    if _DECLARATIONS.search(text):
        raise InputError(f"{path}: declares a document type or entities; remove them")
    if len(_LINKS.findall(text)) > LINKS_LIMIT:
        raise InputError(f"{path}: has more than {LINKS_LIMIT} joints; expected a person")
    # without its declaration the text is what was checked, in no other encoding
    return _XML_DECLARATION.sub("", text, count=1)


def _unreadable(path: Path, error: Exception) -> InputError:
    reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    return InputError(
        f"{path}: is no URDF that can be read ({reason}); expected a tree of links with revolute "
        "and fixed joints"
    )


def _refuse_sliding(path: Path, names: Sequence[str]) -> None:
    if names:
        raise InputError(
            f"{path}: joints {', '.join(names)} are no hinges; expected hinges and fixed joints "
            "only: write a ball joint as three hinges, and leave the root free"
        )


def _walk(root: Any) -> Iterator[tuple[Any, int]]:
    """Frames with the index of their parents, parents first."""
    waiting, count = [(root, -1)], 0
    while waiting:
        frame, parent = waiting.pop()
        yield frame, parent
        waiting += [(child, count) for child in reversed(frame.children)]
        count += 1


def _hinge(name: str, joint: str, axis: Tensor, limits: Sequence[float]) -> Hinge:
    lower, upper = (float(limit) for limit in limits)
    if lower >= upper:  # how joints without limits come
        lower, upper = -torch.inf, torch.inf
    return Hinge(name, joint, (float(axis[0]), float(axis[1]), float(axis[2])), lower, upper)


def _rig(
    path: Path,
    joints: tuple[str, ...],
    parents: Sequence[int],
    positions: Tensor,
    hinges: Sequence[Hinge],
    marks: dict[str, tuple[int, Tensor]],
) -> Rig:
    """The rig, if names are unique and every landmark is marked: (joint, position) by name."""
    twice = sorted({name for name in joints if joints.count(name) > 1})
    if twice:
        raise InputError(f"{path}: has several links named {', '.join(twice)}; rename them")
    missing = [name for name in LANDMARKS if name not in marks]
    if missing:
        raise InputError(
            f"{path}: has no link named {', '.join(missing)}; expected one for each landmark: "
            "rename links, or add empty ones on fixed joints"
        )
    return Rig(
        joints=joints,
        parents=tuple(parents),
        positions=positions,
        hinges=tuple(hinges),
        landmarks=LANDMARKS,
        landmark_joints=tuple(marks[name][0] for name in LANDMARKS),
        landmark_positions=torch.stack([marks[name][1] for name in LANDMARKS]),
    )
