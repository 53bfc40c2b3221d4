"""What programs call the bones of a person, as rows of data.

Names are compared in a normal form: without the name space, prefix, case and separators of a
program, and with the side of the body apart from them. ``mixamorig:LeftForeArm``, ``Left Forearm``
and ``forearm.L`` are all ``forearm`` on the left.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS

SIDED = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
ENDS = ("head_top", "l_toe", "r_toe")
"""Landmarks that are no joints; a bone that begins there marks them."""
NAMED = tuple(name for name in JOINTS if name != "spine")
"""Joints that names decide; which of several bones is the spine, places decide."""

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
_LEFT, _RIGHT = ("l", "left", "lft"), ("r", "right", "rgt")
# prefixes of programs and of their helper layers, and words for the middle of the body
_PREFIXES = {
    *("mixamorig", "bip", "biped", "def", "org", "mch", "cc", "base", "j", "b", "bn", "bone"),
    *("jnt", "rig", "character", "armature", "human", "c"),
}


class Convention(NamedTuple):
    """Names in normal form; alternatives are separated by spaces, the first one there counts.

    ``marks`` are names that tell the convention from others that share its names. There is no
    column for the spine, nor for bones that nobody animates.
    """

    name: str
    pelvis: str
    neck: str
    head: str
    head_top: str
    shoulder: str
    elbow: str
    wrist: str
    hip: str
    knee: str
    ankle: str
    toe: str
    marks: str = ""


# fmt: off
CONVENTIONS = (
    Convention("perfcap", "pelvis", "neck", "head", "headtop",
               "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe", "spine toe"),
    Convention("CMU motion capture", "hips", "neck", "head", "",
               "arm", "forearm", "hand", "upleg", "leg", "foot", "", "hipjoint lowerback"),
    Convention("Mixamo", "hips", "neck", "head", "headtopend headend",
               "arm", "forearm", "hand", "upleg", "leg", "foot", "toeend"),
    Convention("MakeHuman default", "root", "neck1", "head", "",
               "upperarm1", "lowerarm1", "wrist", "upperleg1", "lowerleg1", "foot", ""),
    Convention("Unreal and game engine", "pelvis", "neck1", "head", "",
               "upperarm", "lowerarm", "hand", "thigh", "calf", "foot", ""),
    Convention("Rigify", "spine", "spine4", "spine6", "",
               "upperarm", "forearm", "hand", "thigh", "shin", "foot", ""),
    Convention("VRM and Unity", "hips", "neck", "head", "",
               "upperarm", "lowerarm", "hand", "upperleg", "lowerleg", "foot", ""),
    Convention("Character Creator", "hip pelvis", "necktwist1", "head", "",
               "upperarm", "forearm", "hand", "thigh", "calf", "foot", ""),
    Convention("Biped", "pelvis", "neck", "head", "headnub",
               "upperarm", "forearm", "hand", "thigh", "calf", "foot", "toe0nub"),
    Convention("DAZ and Poser", "hip", "necklower neck", "head", "",
               "shldrbend shldr", "forearmbend forearm", "hand", "thighbend thigh", "shin",
               "foot", ""),
    Convention("SMPL", "pelvis", "neck", "head", "",
               "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "", "collar"),
    Convention("common words", "hips pelvis hip", "neck neck1 necklower", "head",
               "headtop headend headtip headnub",
               "upperarm uparm armupper bicep arm shoulder",
               "lowerarm forearm armlower elbow", "hand wrist",
               "thigh upperleg upleg legupper hip",
               "calf shin shank lowerleg leglower leg knee", "foot ankle",
               "toeend toetip toenub"),
)
# fmt: on


@dataclass(frozen=True)
class NameMatch:
    """What names say: the convention they follow best, and its bones by joint or landmark."""

    convention: str
    joints: Mapping[str, int]
    ends: Mapping[str, int]


def normal_form(name: str) -> tuple[str, str]:
    """Side (``l``, ``r`` or nothing) and words of a bone name.

    >>> normal_form("Bip01 L Thigh"), normal_form("DEF-spine.003")
    (('l', 'thigh'), ('', 'spine3'))
    """
    local = re.split(r"[:|]", name)[-1]
    words: list[str] = []
    side = ""
    for word in (found.lower() for found in _WORDS.findall(local)):
        here = "l" if word in _LEFT else "r" if word in _RIGHT else ""
        if here and not side:
            side = here
            continue
        glued = re.fullmatch(r"(left|right)(\w{3,})", word)
        if glued and not side:
            side, word = glued[1][0], glued[2]
        words.append(str(int(word)) if word.isdecimal() else word)
    while words and (words[0] in _PREFIXES or words[0].isdecimal()):
        words.pop(0)
    return side, "".join(words)


def match_names(names: Sequence[str], moved: NDArray[np.float64]) -> NameMatch:
    """The convention that names the most joints, the earlier one where two are as good.

    Args:
        names: of the bones, (B,).
        moved: how much of the mesh each bone moves, (B,); of bones with one name, such as the
            layers of a Rigify rig, the one that moves the most is meant.
    """
    bones: dict[tuple[str, str], int] = {}
    for bone in np.argsort(-moved, kind="stable").tolist():
        bones.setdefault(normal_form(names[bone]), bone)
    there = {word for _, word in bones}
    matches = [_match(row, bones) for row in CONVENTIONS if set(row.marks.split()) <= there]
    return max(matches, key=lambda match: len(match.joints))


def _match(row: Convention, bones: Mapping[tuple[str, str], int]) -> NameMatch:
    wanted = {name: ("", getattr(row, name)) for name in ("pelvis", "neck", "head", "head_top")}
    for side in "lr":
        wanted |= {f"{side}_{part}": (side, getattr(row, part)) for part in (*SIDED, "toe")}
    found = {}
    for name, (side, words) in wanted.items():
        keys = [(side, word) for word in words.split() if (side, word) in bones]
        if keys:
            found[name] = bones[keys[0]]
    joints = {name: found[name] for name in NAMED if name in found}
    return NameMatch(row.name, joints, {name: found[name] for name in ENDS if name in found})
