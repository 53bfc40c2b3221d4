"""Joints of data sets, in the order of their files, by our names.

A name that is not ours (``head``, ``spine``) is a joint that is no landmark: the head of SMPL is
its middle, not its crown. Where a set has toes but calls them feet, the name here is ``toe``.
"""

from __future__ import annotations

from perfcap.detect.joint_set import LANDMARKS, JointSet


def _side(side: str, *joints: str) -> tuple[str, ...]:
    return tuple(f"{side}_{joint}" for joint in joints)


_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle")

H36M32 = JointSet(
    "H36M-32",
    (
        *("mid_hip", *_side("r", *_LEG, "toe", "toe_end"), *_side("l", *_LEG, "toe", "toe_end")),
        *("spine_base", "spine", "thorax", "nose", "head_top"),
        *_side("l", "neck", *_ARM, "thumb", "thumb_end", "wrist_end", "hand_end"),
        *_side("r", "neck", *_ARM, "thumb", "thumb_end", "wrist_end", "hand_end"),
    ),
)
HUMANEVA15 = JointSet(
    "HumanEva-15",
    (
        *("mid_hip", "thorax", *_side("l", *_ARM), *_side("r", *_ARM)),
        *(*_side("l", *_LEG), *_side("r", *_LEG), "head"),
    ),
)
MPI28 = JointSet(
    "MPI-INF-3DHP-28",
    (
        *("spine3", "spine4", "spine2", "spine", "mid_hip", "neck", "head", "head_top"),
        *(*_side("l", "clavicle", *_ARM, "hand"), *_side("r", "clavicle", *_ARM, "hand")),
        *(*_side("l", *_LEG, "foot", "toe"), *_side("r", *_LEG, "foot", "toe")),
    ),
)
MPI17 = JointSet(
    "MPI-INF-3DHP-17",
    (
        *("head_top", "neck", *_side("r", *_ARM), *_side("l", *_ARM)),
        *(*_side("r", *_LEG), *_side("l", *_LEG), "mid_hip", "spine", "head"),
    ),
)
SMPL24 = JointSet(
    "SMPL-24",
    (
        *("mid_hip", "l_hip", "r_hip", "spine1", "l_knee", "r_knee", "spine2"),
        *("l_ankle", "r_ankle", "spine3", "l_toe", "r_toe", "neck", "l_collar", "r_collar"),
        *("head", "l_shoulder", "r_shoulder", "l_elbow", "r_elbow", "l_wrist", "r_wrist"),
        *("l_hand", "r_hand"),
    ),
)
COCO19 = JointSet(
    "Panoptic-COCO-19",
    (
        *("neck", "nose", "mid_hip", *_side("l", *_ARM), *_side("l", *_LEG)),
        *(*_side("r", *_ARM), *_side("r", *_LEG), "l_eye", "l_ear", "r_eye", "r_ear"),
    ),
)


def landmarks_in(joint_set: JointSet) -> tuple[str, ...]:
    """The landmarks that a set has."""
    missing = joint_set.missing()
    return tuple(landmark for landmark in LANDMARKS if landmark not in missing)
