"""Named joint sets of common detectors, and the map from each of them to our 16 landmarks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from perfcap.errors import InputError

LANDMARKS = (
    "head_top",
    "neck",
    "r_shoulder",
    "r_elbow",
    "r_wrist",
    "l_shoulder",
    "l_elbow",
    "l_wrist",
    "r_hip",
    "r_knee",
    "r_ankle",
    "r_toe",
    "l_hip",
    "l_knee",
    "l_ankle",
    "l_toe",
)
"""The joints every energy, file and score speaks of; left and right are the actor's own."""

# A landmark that a set lacks is made of other joints. The first recipe a set can cook is
# taken; a set that can cook none does not see the landmark.
_RECIPES = {
    "neck": (("thorax",), ("l_shoulder", "r_shoulder")),
    "l_toe": (("l_big_toe",),),
    "r_toe": (("r_big_toe",),),
    "head_top": (("l_ear", "r_ear", "l_shoulder", "r_shoulder"),),
}
# Joints of shoulders are at 81 %, ears at 93 % of the height of somebody who stands (after Drillis
# and Contini 1966): the crown lies 0.6 times the way from shoulders to ears beyond the ears.
_BEYOND_EARS = 0.6
_SHARES = {"head_top": {"ear": 0.5 * (1 + _BEYOND_EARS), "shoulder": -0.5 * _BEYOND_EARS}}


@dataclass(frozen=True)
class JointSet:
    """What a detector calls its joints, in the order it writes them.

    Names are ours: ``l_``/``r_`` in front, ``head_top`` for the crown of the head.
    """

    name: str
    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        if isinstance(self.joints, str):
            raise ValueError(f"joint set {self.name!r} names {self.joints!r}, expected several")
        twice = sorted({joint for joint in self.joints if self.joints.count(joint) > 1})
        if twice:
            raise ValueError(f"joint set {self.name!r} names {', '.join(twice)} more than once")
        object.__setattr__(self, "joints", tuple(self.joints))

    def __len__(self) -> int:
        return len(self.joints)

    def sources(self, landmark: str, *, measured: bool = False) -> tuple[int, ...]:
        """Indices of the joints that a landmark is made of; empty where the set has none.

        Those that are ``measured`` lie among joints; the others are guessed, as a crown from ears.
        """
        guessed = measured and landmark in _SHARES
        for recipe in ((landmark,), *(() if guessed else _RECIPES.get(landmark, ()))):
            if all(joint in self.joints for joint in recipe):
                return tuple(self.joints.index(joint) for joint in recipe)
        return ()

    def shares(self, landmark: str) -> tuple[float, ...]:
        """Weights of the joints of ``sources`` in a landmark; they sum to one."""
        joints = self.sources(landmark)
        if len(joints) == 1 or landmark not in _SHARES:
            return (1 / len(joints),) * len(joints) if joints else ()
        return tuple(_SHARES[landmark][self.joints[joint][2:]] for joint in joints)

    def missing(self) -> tuple[str, ...]:
        """Landmarks this set does not see."""
        return tuple(landmark for landmark in LANDMARKS if not self.sources(landmark))

    def mirrored(self) -> tuple[int, ...]:
        """Index of each joint's counterpart on the other side; its own in the middle."""
        return _mirrored(self.joints)


@lru_cache(maxsize=64)
def _mirrored(joints: tuple[str, ...]) -> tuple[int, ...]:
    return tuple(joints.index(_other_side(joint, joints)) for joint in joints)


def _other_side(joint: str, joints: Sequence[str]) -> str:
    swapped = {"l_": "r_", "r_": "l_"}.get(joint[:2], joint[:2]) + joint[2:]
    return swapped if swapped in joints else joint


def map_to_landmarks(
    values: Tensor, confidence: Tensor, joint_set: JointSet | str, *, measured: bool = False
) -> tuple[Tensor, Tensor]:
    """Reorder and combine a detector's joints into the 16 landmarks.

    Args:
        values: pixels (..., J, 2) or positions (..., J, 3) in the order of ``joint_set``.
        confidence: (..., J).
        joint_set: names of the J joints, or the name of a known set.
        measured: leave out landmarks that would be guessed, for a truth to score against.

    Returns:
        Values (..., 16, 2 or 3) and confidence (..., 16). Where a joint is not finite, has no
        confidence or (in pixels) lies at exactly (0, 0), and where the set has no such joint,
        both are 0. A landmark made from several joints has the least of their confidences.
    """
    joint_set = find_joint_set(joint_set)
    if values.shape[:-1] != confidence.shape or values.shape[-2] != len(joint_set):
        raise ValueError(
            f"values {tuple(values.shape)} and confidence {tuple(confidence.shape)} do not hold "
            f"the {len(joint_set)} joints of {joint_set.name!r}; expected (..., J, d) and (..., J)"
        )
    if not values.is_floating_point() or not confidence.is_floating_point():
        raise ValueError(
            f"values are {values.dtype} and confidence {confidence.dtype}, expected floating-point "
            "numbers: means of joints would be whole ones"
        )
    values, confidence = _drop_undetected(values, confidence)
    first, made, lacking = _recipe(joint_set, measured)
    mapped, trust = values[..., first, :], confidence[..., first]
    for place, columns, shares in made:
        mapped[..., place, :], trust[..., place] = _mean(values, confidence, columns, shares)
    if lacking:
        trust[..., lacking] = 0
    return torch.where(trust[..., None] > 0, mapped, 0), trust


@lru_cache(maxsize=64)
def _recipe(
    joint_set: JointSet, measured: bool
) -> tuple[list[int], list[tuple[int, list[int], tuple[float, ...]]], list[int]]:
    """Of each landmark its first joint, those made of several, and those that are lacking."""
    columns = [list(joint_set.sources(mark, measured=measured)) for mark in LANDMARKS]
    made = [
        (place, own, joint_set.shares(LANDMARKS[place]))
        for place, own in enumerate(columns)
        if len(own) > 1
    ]
    lacking = [place for place, own in enumerate(columns) if not own]
    return [own[0] if own else 0 for own in columns], made, lacking


def _drop_undetected(values: Tensor, confidence: Tensor) -> tuple[Tensor, Tensor]:
    seen = values.isfinite().all(-1) & confidence.isfinite() & (confidence > 0)
    if values.shape[-1] == 2:  # the corner pixel is how detectors write "nothing here"
        seen = seen & (values != 0).any(-1)
    return torch.where(seen[..., None], values, 0), torch.where(seen, confidence, 0)


def _mean(
    values: Tensor, confidence: Tensor, columns: list[int], shares: tuple[float, ...]
) -> tuple[Tensor, Tensor]:
    weights = values.new_tensor(shares)[:, None]
    return (weights * values[..., columns, :]).sum(-2), confidence[..., columns].amin(-1)


def canonical_name(name: str) -> str:
    """Our spelling of a joint's name: ``RShoulder``, ``right_shoulder`` become ``r_shoulder``."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[LR])(?=[A-Z][a-z])", "_", name.strip())
    lower = re.sub(r"[\s\-.]+", "_", spaced).lower()
    lower = re.sub(r"^(left|right)_?", lambda side: side.group(1)[0] + "_", lower)
    lower = re.sub(r"^(.*)_(left|right)$", lambda m: f"{m.group(2)[0]}_{m.group(1)}", lower)
    return _SYNONYMS.get(lower, lower)


def doubled_names(names: Sequence[str]) -> str:
    """The names of joints that have several, as ``RAnkle and r_ankle``; empty where none has."""
    spelled: dict[str, list[str]] = {}
    for name in names:
        spelled.setdefault(canonical_name(name), []).append(name)
    twice = [" and ".join(own) for own in spelled.values() if len(own) > 1]
    return ", ".join(twice[:3]) + (f" and {len(twice) - 3} more" if len(twice) > 3 else "")


_SYNONYMS = {
    **dict.fromkeys(("headtop", "top_of_head", "head"), "head_top"),
    **dict.fromkeys(("pelvis", "hips", "root", "midhip"), "mid_hip"),
}


def _sides(order: Sequence[str], *joints: str) -> tuple[str, ...]:
    """Each joint once a side, sides alternating in the order given."""
    return tuple(f"{side}_{joint}" for joint in joints for side in order)


def _side(side: str, *joints: str) -> tuple[str, ...]:
    return tuple(f"{side}_{joint}" for joint in joints)


_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle")
_FOOT = ("big_toe", "small_toe", "heel")
_FACE = ("nose", *_sides("lr", "eye", "ear"))
_LIMBS = _sides("lr", *_ARM, *_LEG)
_FEET = (*_side("l", *_FOOT), *_side("r", *_FOOT))

LANDMARKS16 = JointSet("landmarks16", LANDMARKS)
COCO17 = JointSet("COCO-17", (*_FACE, *_LIMBS))
COCO18 = JointSet(
    "COCO-18",
    (
        *("nose", "neck"),
        *(*_side("r", *_ARM), *_side("l", *_ARM), *_side("r", *_LEG), *_side("l", *_LEG)),
        *_sides("rl", "eye", "ear"),
    ),
)
BODY_25 = JointSet(
    "BODY_25",
    (
        *("nose", "neck", *_side("r", *_ARM), *_side("l", *_ARM)),
        *("mid_hip", *_side("r", *_LEG), *_side("l", *_LEG)),
        *(*_sides("rl", "eye", "ear"), *_FEET),
    ),
)
BODY_25B = JointSet("BODY_25B", (*_FACE, *_LIMBS, "neck", "head_top", *_FEET))
HALPE26 = JointSet(
    "Halpe-26",
    (
        *(*_FACE, *_LIMBS, "head_top", "neck", "mid_hip"),
        *_sides("lr", "big_toe", "small_toe", "heel"),
    ),
)
COCO_WHOLEBODY = JointSet(
    "COCO-WholeBody",
    (
        *(*_FACE, *_LIMBS, *_FEET),
        *(f"face_{i}" for i in range(68)),
        *(f"{side}_hand_{i}" for side in "lr" for i in range(21)),
    ),
)
HALPE136 = JointSet(
    "Halpe-136",
    (
        *HALPE26.joints,
        *(f"face_{i}" for i in range(68)),
        *(f"{side}_hand_{i}" for side in "lr" for i in range(21)),
    ),
)
_LEGS_UP = ("r_ankle", "r_knee", "r_hip", "l_hip", "l_knee", "l_ankle")
_ARMS_ACROSS = ("r_wrist", "r_elbow", "r_shoulder", "l_shoulder", "l_elbow", "l_wrist")
MPII = JointSet("MPII", (*_LEGS_UP, "mid_hip", "thorax", "upper_neck", "head_top", *_ARMS_ACROSS))
LSP = JointSet("LSP", (*_LEGS_UP, *_ARMS_ACROSS, "neck", "head_top"))
H36M17 = JointSet(
    "H36M-17",
    (
        *("mid_hip", *_side("r", *_LEG), *_side("l", *_LEG)),
        *("spine", "thorax", "nose", "head_top", *_side("l", *_ARM), *_side("r", *_ARM)),
    ),
)
BLAZEPOSE33 = JointSet(
    "BlazePose-33",
    (
        "nose",
        *(f"{side}_{eye}" for side in "lr" for eye in ("eye_inner", "eye", "eye_outer")),
        *_sides("lr", "ear", "mouth", *_ARM, "pinky", "index", "thumb"),
        *_sides("lr", *_LEG, "heel", "big_toe"),
    ),
)

JOINT_SETS = (
    *(LANDMARKS16, COCO17, COCO18, BODY_25, BODY_25B),
    *(HALPE26, COCO_WHOLEBODY, HALPE136),
    *(MPII, LSP, H36M17, BLAZEPOSE33),
)
"""Every set known by name. BODY_25 and BODY_25B both have 25 joints, MPII has 16 as ours has."""

KNOWN_JOINTS = frozenset(joint for joint_set in JOINT_SETS for joint in joint_set.joints)


def find_joint_set(joint_set: JointSet | str, name: str = "joint_set") -> JointSet:
    """A set by its name in any case, or itself.

    Args:
        joint_set: as it was given.
        name: of the argument.

    Raises:
        InputError: no set has the name, or it is something else.
    """
    if isinstance(joint_set, str):
        named = {known.name.lower(): known for known in JOINT_SETS}
        if joint_set.lower() not in named:
            raise InputError(
                f"{name} {joint_set!r:.80} is not known; expected one of "
                f"{', '.join(known.name for known in JOINT_SETS)}, or a JointSet of your own names"
            )
        return named[joint_set.lower()]
    if not isinstance(joint_set, JointSet):
        raise InputError(
            f"{name} is a {type(joint_set).__name__}, expected the name of a known set, or "
            "JointSet('mine', names) of the estimator's joints in its order"
        )
    return joint_set
