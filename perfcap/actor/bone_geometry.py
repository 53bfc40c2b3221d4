"""Which bone is which joint, from the tree and the rest pose alone.

A person stands in a T- or A-pose: the feet are lowest, the hands reach furthest to the sides, the
head is on top. The branches that lead there are the limbs, and the joints on them are where the
proportions of the body put them: Drillis and Contini 1966, Body Segment Parameters, as fractions
of stature. Bones that move nothing, such as targets of a rig's controls, are no evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template

Floats = NDArray[np.float64]

_HIP, _KNEE, _ANKLE = 0.53, 0.285, 0.045  # heights above the ground
_SHOULDER, _NECK, _HEAD = 0.80, 0.845, 0.905
_HIP_ASIDE, _SHOULDER_ASIDE = 0.06, 0.11  # distances from the middle
_UPPER_ARM, _FOREARM, _HAND = 0.16, 0.15, 0.108  # lengths
_FOOT_BELOW = 0.15  # bones lower than this are feet
_WORST = 0.09  # mean deviation above which this is no person standing upright
_LONGEST = 24  # bones on a limb that are looked at; all triples of them are


@dataclass(frozen=True)
class PlaceMatch:
    """What places say: bones by joint, l_ and r_ for two sides, and how far they deviate.

    Attributes:
        joints: some of the joints; the spine is not among them.
        up: unit axis (3,) along which the person stands.
        deviation: mean distance of joints from where they are expected, in statures.
    """

    joints: Mapping[str, int]
    up: Floats
    deviation: float


def match_places(template: Template) -> PlaceMatch | None:
    """The joints of a standing person, whichever axis is up; None if no axis makes sense.

    Left and right are named by the axes, not by the body: see ``bone_map.orient``.
    """
    tree = _Tree.of(template)
    axes = [sign * axis for axis in np.eye(3)[[1, 2, 0]] for sign in (1.0, -1.0)]
    found = [match for up in axes if (match := _match(tree, up)) is not None]
    best = min(found, key=lambda match: match.deviation, default=None)
    return None if best is None or best.deviation > _WORST else best


@dataclass(frozen=True)
class _Tree:
    """Bones that move something, and those above them."""

    parents: tuple[int, ...]
    places: Floats  # (B, 3)
    used: NDArray[np.bool_]  # (B,)
    corners: Floats  # vertices, (V, 3)
    owner: NDArray[np.int64]  # heaviest bone of each vertex, (V,)

    @classmethod
    def of(cls, template: Template) -> _Tree:
        used = np.zeros(len(template.bone_names), dtype=np.bool_)
        used[np.unique(template.weight_bones[template.weights > 0])] = True
        for bone in range(len(used) - 1, -1, -1):  # children come after their parents
            if used[bone] and template.bone_parents[bone] >= 0:
                used[template.bone_parents[bone]] = True
        parents = tuple(template.bone_parents.tolist())
        owner = template.weight_bones[:, 0]
        return cls(parents, template.bone_rest[:, :3, 3], used, template.vertices, owner)

    def leaves(self) -> list[int]:
        inner = {self.parents[bone] for bone in np.flatnonzero(self.used)}
        return [bone for bone in np.flatnonzero(self.used).tolist() if bone not in inner]

    def path(self, bone: int) -> list[int]:
        """From the root to a bone."""
        chain = [bone]
        while self.parents[chain[-1]] >= 0:
            chain.append(self.parents[chain[-1]])
        return chain[::-1]

    def below(self, bone: int) -> NDArray[np.bool_]:
        """Whether each bone is ``bone`` or hangs on it, (B,)."""
        result = np.zeros(len(self.parents), dtype=np.bool_)
        result[bone] = True
        for child, parent in enumerate(self.parents):
            if parent >= 0 and result[parent]:
                result[child] = True
        return result


def _match(tree: _Tree, up: Floats) -> PlaceMatch | None:
    height = tree.corners @ up
    stature = float(np.ptp(height))
    if stature <= 0:
        return None
    level = (tree.places @ up - float(height.min())) / stature
    legs = _legs(tree, level)
    if legs is None:
        return None
    pelvis, left_feet, right_feet = legs
    across = tree.places[left_feet].mean(0) - tree.places[right_feet].mean(0)
    across = across - (across @ up) * up
    if np.linalg.norm(across) < 1e-3 * stature:
        return None
    across /= np.linalg.norm(across)
    body = _Body(tree, up, level, (tree.places - tree.places[pelvis]) @ across / stature, stature)
    joints, deviations = {"pelvis": pelvis}, []
    for side, sign, feet in (("l", 1.0, left_feet), ("r", -1.0, right_feet)):
        found, deviation = body.leg(pelvis, min(feet, key=lambda bone: level[bone]), sign)
        joints |= _sided(side, ("hip", "knee", "ankle"), found)
        deviations.append(deviation)
    upper = body.upper(joints["l_hip"], joints["r_hip"])
    if upper is None:
        return None
    return PlaceMatch(joints | upper[0], up, float(np.mean([*deviations, *upper[1]])))


def _legs(tree: _Tree, level: Floats) -> tuple[int, list[int], list[int]] | None:
    """The bone where the legs part, and the lowest bones of each."""
    branches: dict[int, dict[int, list[int]]] = {}
    for bone in tree.leaves():
        if level[bone] < _FOOT_BELOW:
            chain = tree.path(bone)
            for above, child in pairwise(chain):
                branches.setdefault(above, {}).setdefault(child, []).append(bone)
    # toes part as well, but at the ground
    forks = [b for b, parts in branches.items() if len(parts) > 1 and level[b] > 2 * _FOOT_BELOW]
    if not forks:
        return None
    fork = max(forks, key=lambda bone: len(tree.path(bone)))  # the lowest common branching
    parts = sorted(branches[fork].items(), key=lambda part: -int(tree.below(part[0]).sum()))
    return fork, parts[0][1], parts[1][1]


def _sided(side: str, names: Sequence[str], bones: Sequence[int]) -> dict[str, int]:
    return {f"{side}_{name}": bone for name, bone in zip(names, bones, strict=True)}


@dataclass(frozen=True)
class _Body:
    """A tree in the axes of a body; lengths in statures.

    Attributes:
        tree: in units of the file.
        up: unit axis (3,).
        level: height of each bone above the ground, (B,).
        aside: how far each bone is to the one side of the pelvis, (B,).
        stature: in units of the file.
    """

    tree: _Tree
    up: Floats
    level: Floats
    aside: Floats
    stature: float

    def leg(self, pelvis: int, foot: int, sign: float) -> tuple[tuple[int, ...], float]:
        """Hip, knee and ankle on the way to a foot, and their mean deviation."""
        chain = self.tree.path(foot)
        chain = chain[chain.index(pelvis) + 1 :]
        level, places = self.level, self.tree.places

        def cost(hip: int, knee: int, ankle: int) -> float:
            # the shank points down in the rest pose: the ball of the foot is ahead of it
            drift = places[ankle] - places[knee]
            ahead = float(np.linalg.norm(drift - (drift @ self.up) * self.up)) / self.stature
            heights = (level[hip] - _HIP, level[knee] - _KNEE, level[ankle] - _ANKLE)
            return _mean(*heights, sign * self.aside[hip] - _HIP_ASIDE, 0.5 * ahead)

        return _best(chain, cost, 3)

    def upper(self, *hips: int) -> tuple[dict[str, int], list[float]] | None:
        """Arms, neck and head, and the mean deviation of each; None if branches are missing."""
        tree, level = self.tree, self.level
        is_leg = tree.below(hips[0]) | tree.below(hips[1])
        ends = [b for b in tree.leaves() if not is_leg[b] and level[b] > _FOOT_BELOW]
        if len(ends) < 3:
            return None
        chains = [tree.path(max(ends, key=lambda b: sign * self.aside[b])) for sign in (1.0, -1.0)]
        trunk = [a for a, b in zip(*chains, strict=False) if a == b]
        arms = [chain[len(trunk) :] for chain in chains]
        if not trunk or min(map(len, arms)) < 3:
            return None
        is_arm = tree.below(arms[0][0]) | tree.below(arms[1][0])
        tops = [bone for bone in ends if not is_arm[bone]]
        if not tops:
            return None
        way = tree.path(max(tops, key=lambda bone: level[bone]))
        way = [bone for bone in way if bone not in trunk]
        (neck, head), deviation = _best(
            way, lambda n, h: _mean(float(level[n]) - _NECK, float(level[h]) - _HEAD), 2
        )
        joints, deviations = {"neck": neck, "head": head}, [deviation]
        for side, sign, arm in zip("lr", (1.0, -1.0), arms, strict=True):
            found, deviation = self.arm(arm, sign)
            joints |= _sided(side, ("shoulder", "elbow", "wrist"), found)
            deviations.append(deviation)
        return joints, deviations

    def arm(self, chain: list[int], sign: float) -> tuple[tuple[int, ...], float]:
        """Shoulder, elbow and wrist on the way to a hand, and their mean deviation."""
        places = self.tree.places
        skin = self.tree.corners[np.isin(self.tree.owner, self.tree.below(chain[0]).nonzero()[0])]
        # the finger tips, as far from the shoulders as it gets
        tip = skin[np.linalg.norm(skin - places[chain[0]], axis=1).argmax()]

        def apart(a: Floats, b: Floats) -> float:
            return float(np.linalg.norm(a - b)) / self.stature

        def cost(shoulder: int, elbow: int, wrist: int) -> float:
            return _mean(
                self.level[shoulder] - _SHOULDER,
                sign * self.aside[shoulder] - _SHOULDER_ASIDE,
                apart(places[shoulder], places[elbow]) - _UPPER_ARM,
                apart(places[elbow], places[wrist]) - _FOREARM,
                apart(places[wrist], tip) - _HAND,
            )

        return _best(chain, cost, 3)


def _mean(*errors: float) -> float:
    return sum(map(abs, errors)) / len(errors)


def _best(
    chain: list[int], cost: Callable[..., float], count: int
) -> tuple[tuple[int, ...], float]:
    """The ordered choice of ``count`` bones of a chain that costs least."""
    choices = {choice: cost(*choice) for choice in combinations(chain[:_LONGEST], count)}
    if not choices:
        return tuple((chain or [0])[-1:] * count), 1.0  # fewer bones than joints: no match
    best = min(choices, key=lambda choice: choices[choice])
    return best, choices[best]
