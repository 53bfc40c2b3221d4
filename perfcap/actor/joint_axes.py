"""Joints and their axes as landmarks: what shows how a joint is turned, not only where it is."""

from __future__ import annotations

from dataclasses import replace

import torch

from perfcap.actor.skeleton import Skeleton

AXES = 3


def axes_skeleton(skeleton: Skeleton) -> Skeleton:
    """The skeleton with 4 J more landmarks behind its own: every joint, then a metre along each
    axis of the world of the rest pose, turning with the joint.

    Differences of the last three and the first are the columns of the joint's rotation, so that
    energies of points see orientations without a chart, and so without its poles.
    """
    rig = skeleton.rig
    names, joints, places = [], [], []
    corners = torch.cat((torch.zeros(1, AXES), torch.eye(AXES))).to(rig.positions)
    for number, joint in enumerate(rig.joints):
        names += [joint + "_origin", *(f"{joint}_{axis}" for axis in "xyz")]
        joints += [number] * (1 + AXES)
        places.append(rig.positions[number] + corners)
    groups = rig.bone_groups
    more = [groups[joint] for joint in joints] if groups else []
    wider = replace(
        rig,
        landmarks=(*rig.landmarks, *names),
        landmark_joints=(*rig.landmark_joints, *joints),
        landmark_positions=torch.cat((rig.landmark_positions, torch.cat(places))),
        bone_groups=(*groups, *more),
    )
    return Skeleton(wider).to(skeleton.lower)


def origin_row(skeleton: Skeleton, joint: str) -> int:
    """Row of a joint's place among the landmarks of an ``axes_skeleton``; its axes follow."""
    rig = skeleton.rig
    return len(rig.landmarks) - (1 + AXES) * len(rig.joints) + (1 + AXES) * rig.joints.index(joint)
