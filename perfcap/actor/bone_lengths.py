"""Give an actor the bone lengths of another person; the mesh stretches along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.motion import BONES
from perfcap.actor.rig import Rig
from perfcap.actor.skeleton import Skeleton
from perfcap.actor.template import Template

# The bone that gives a joint's part of the mesh its direction, and the bone across it.
_ALONG = {
    "pelvis": "spine",
    "spine": "neck",
    "neck": "head",
    "head": "head_top",
    **{f"{s}_shoulder": f"{s}_elbow" for s in "lr"},
    **{f"{s}_elbow": f"{s}_wrist" for s in "lr"},
    **{f"{s}_hip": f"{s}_knee" for s in "lr"},
    **{f"{s}_knee": f"{s}_ankle" for s in "lr"},
    **{f"{s}_ankle": f"{s}_toe" for s in "lr"},
}


def resize(
    template: Template, skeleton: Skeleton, bone_joints: Sequence[int], shape: Tensor
) -> tuple[Template, Rig]:
    """Stretch a template to other bone lengths.

    Each joint carries its part of the mesh to its new place and stretches it along its bone by
    that bone's factor; across the bone everything grows by the mean factor of the body, since
    bone lengths say nothing about girth.

    Args:
        template: the mesh and bones.
        skeleton: the kinematics built from it.
        bone_joints: index of the joint each bone moves with, (B,).
        shape: log factors of ``skeleton.group_names``, (S,).
    """
    known = {BONES: shape.detach().to(skeleton.lower)}
    rest = replace(skeleton.rest_motion(), shared=known)
    pose = skeleton(rest)
    rig = skeleton.rig
    foot = pose.landmarks[0, :, 1].min() - rig.landmark_positions[:, 1].min()
    lift = torch.tensor([0.0, 1.0, 0.0]).to(foot) * -foot  # keep standing on the floor
    positions, landmarks = pose.position[0] + lift, pose.landmarks[0] + lift
    new_rig = replace(rig, positions=positions, landmark_positions=landmarks)
    stretch = _stretches(rig, shape.detach().to(positions), skeleton.group_names)
    owner = np.asarray(bone_joints)
    old, new = rig.positions.numpy(force=True), positions.numpy(force=True)

    def carry(points: np.ndarray, joints: np.ndarray) -> np.ndarray:
        local = (points - old[joints])[..., None]
        moved: np.ndarray = new[joints] + (stretch[joints] @ local)[..., 0]
        return moved

    parts = carry(template.vertices[:, None], owner[template.weight_bones])
    vertices = (template.weights[..., None] * parts).sum(1)
    bones = template.bone_rest.copy()
    bones[:, :3, 3] = carry(bones[:, :3, 3], owner)
    marks = {
        name: (bone, carry(place[None], owner[[bone]])[0])
        for name, (bone, place) in template.landmarks.items()
    }
    moved = replace(template, vertices=vertices, bone_rest=bones, landmarks=marks)
    return moved, new_rig


def _stretches(rig: Rig, shape: Tensor, groups: tuple[str, ...]) -> np.ndarray:
    """Linear map of each joint's part of the mesh, (J, 3, 3)."""
    points = dict(zip((*rig.joints, *rig.landmarks), _stack(rig), strict=True))
    group_of = dict(zip((*rig.joints, *rig.landmarks), rig.bone_groups, strict=True))
    factor = {name: float(value) for name, value in zip(groups, shape.exp(), strict=True)}
    across = float(shape.mean().exp())
    result = []
    for joint in rig.joints:
        end = _ALONG.get(joint)
        matrix = across * np.eye(3)
        if end in points:
            bone = points[end] - points[joint]
            bone = bone / np.linalg.norm(bone)
            matrix += (factor[group_of[end]] - across) * np.outer(bone, bone)
        result.append(matrix)
    return np.stack(result)


def _stack(rig: Rig) -> np.ndarray:
    stacked: np.ndarray = torch.cat((rig.positions, rig.landmark_positions)).numpy(force=True)
    return stacked
