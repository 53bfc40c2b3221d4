"""Several people through the frames of a view, each followed by one track and none by two."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from perfcap.detect.crop import Crop, Frame, next_crop
from perfcap.detect.joint_set import LANDMARKS16, JointSet, map_to_landmarks
from perfcap.detect.look import SEEN, CropNetwork, Finder, Look, is_person, look_at, turned
from perfcap.detect.search import centre, turn_around
from perfcap.detect.whereabouts import ANYWHERE, UNSURE, Whereabouts

_SAME = 0.08  # of a body's size: distance of joints that are the same one
_ALIKE = 0.5  # of the joints that both looks see: so many are the same ones of one person
_COMMON = 4  # landmarks that both looks must see to be compared
_NEVER = 1e3  # cost of a person who is too far from where a track was


@dataclass(frozen=True)
class _Track:
    """A person who is followed: where they were, and where to look next."""

    known: Whereabouts = ANYWHERE
    crop: Crop | None = None

    def after(self, look: Look | None, network: CropNetwork) -> _Track:
        if look is None:
            return _Track(self.known.after(None))
        spec = network.manifest.input
        angle = turned(look, network.joint_set, spec.turns)
        joints = look.joints2d, look.confidence, SEEN
        crop = next_crop(look.crop, *joints, spec.padding, angle)
        return _Track(self.known.after(look), crop)


def follow_all(
    network: CropNetwork, frames: Iterable[Frame], finder: Finder, count: int
) -> Iterator[tuple[Frame, list[Look | None]]]:
    """Looks at so many people in every frame; None where a track sees no person.

    A track looks where its person was a frame before. Of two that see the same person, the likelier
    one keeps the look. Tracks without a person, and those whose person jumped or shrank, are given
    the people whom the finder sees and no track does: all together, the likeliest first, near where
    a track was of late.

    Args:
        network: looks at people up close.
        frames: (H, W, 3), RGB, in order.
        finder: finds people in whole frames.
        count: of the tracks.
    """
    tracks = [_Track()] * count
    for frame in frames:
        looks = _ahead(network, frame, tracks)
        kept = _once(looks, tracks, network.joint_set)
        doubted = [
            look
            for look, track in zip(kept, tracks, strict=True)
            if look is not None and track.known.doubts(look)
        ]
        kept = [None if any(look is one for one in doubted) else look for look in kept]
        if any(look is None for look in kept):
            taken = [*(look for look in kept if look is not None), *doubted]
            free = [*doubted, *_unfollowed(network, frame, finder, taken)]
            kept = _given(kept, tracks, free, network.joint_set)
        tracks = [track.after(look, network) for track, look in zip(tracks, kept, strict=True)]
        yield frame, kept


def _ahead(network: CropNetwork, frame: Frame, tracks: Sequence[_Track]) -> list[Look | None]:
    """What tracks see where their people were."""
    crops = [track.crop for track in tracks if track.crop is not None]
    found = iter(look_at(network, frame, crops) if crops else ())
    looks: list[Look | None] = []
    for track in tracks:
        look = None if track.crop is None else turn_around(network, frame, next(found), UNSURE)
        seen = look is not None and is_person(look.confidence, network.joint_set)
        looks.append(look if seen else None)
    return looks


def _once(
    looks: Sequence[Look | None], tracks: Sequence[_Track], joint_set: JointSet
) -> list[Look | None]:
    """The same looks, of several at one person the likeliest alone."""
    kept: list[Look | None] = [None] * len(looks)
    order = [
        (-tracks[row].known.likely(look, joint_set), row)
        for row, look in enumerate(looks)
        if look is not None
    ]
    for _, row in sorted(order):
        look = looks[row]
        if look is not None and not _among(look, kept, joint_set):
            kept[row] = look
    return kept


def _unfollowed(
    network: CropNetwork, frame: Frame, finder: Finder, taken: Sequence[Look]
) -> list[Look]:
    """People whom a finder sees and no track does, as they are seen up close.

    Where a look up close shows somebody else, who hides the person, what the finder saw is kept.
    """
    joints, free = network.joint_set, list[Look]()
    seen = [renamed(look, finder.joint_set, joints) for look in finder(frame)]
    seen = [look for look in seen if not _among(look, taken, joints)]
    pairs = [(look, look.around(network, joints)) for look in seen]
    placed = [(look, crop) for look, crop in pairs if crop is not None]
    near = look_at(network, frame, [crop for _, crop in placed]) if placed else []
    for (look, crop), first in zip(placed, near, strict=True):
        if _among(look, free, joints):
            continue
        closer = turn_around(network, frame, centre(network, frame, first))
        if not same_person(closer, look, joints) and _among(closer, [*taken, *free], joints):
            closer = replace(look, crop=crop)
        if is_person(closer.confidence, joints) and not _among(closer, [*taken, *free], joints):
            free.append(closer)
    return free


def renamed(look: Look, joint_set: JointSet, wanted: JointSet) -> Look:
    """A look with the joints of another set; those it lacks are not seen."""
    order = [joint_set.joints.index(j) if j in joint_set.joints else -1 for j in wanted.joints]
    known = torch.tensor(order) >= 0
    confidence = torch.where(known, look.confidence[order], 0)
    return replace(look, joints2d=look.joints2d[order], confidence=confidence)


def _given(
    looks: Sequence[Look | None],
    tracks: Sequence[_Track],
    free: Sequence[Look],
    joint_set: JointSet,
) -> list[Look | None]:
    """Looks of all tracks, where those without one are given free ones."""
    kept = list(looks)
    empty = [row for row, look in enumerate(looks) if look is None]
    costs = np.full((len(empty), len(free)), _NEVER)
    for i, row in enumerate(empty):
        known = tracks[row].known
        for j, look in enumerate(free):
            if known.near(look):
                costs[i, j] = -known.likely(look, joint_set)
    for i, j in zip(*linear_sum_assignment(costs), strict=True):
        if costs[i, j] < _NEVER:
            kept[empty[i]] = free[j]
    return kept


def _among(look: Look, others: Sequence[Look | None], joint_set: JointSet) -> bool:
    """Whether one of other looks is at the same person."""
    return any(same_person(look, other, joint_set) for other in others if other is not None)


def same_person(
    one: Look, other: Look, joint_set: JointSet, one_set: JointSet | None = None
) -> bool:
    """Whether looks are at the same person: half of the joints that both see are where they are.

    Args:
        one: a look.
        other: at a person.
        joint_set: of its joints.
        one_set: of the first look's; the same if None.
    """
    box = other.box()
    if box is None:
        return False
    points, seen = _landmarks(one, one_set or joint_set)
    places, there = _landmarks(other, joint_set)
    size = max(box[2] - box[0], box[3] - box[1])
    for order in (list(range(len(points))), list(LANDMARKS16.mirrored())):  # sides exchanged
        both = (seen[order] >= SEEN) & (there >= SEEN)
        near = (points[order] - places).norm(dim=-1)[both] < _SAME * size
        if len(near) >= _COMMON and near.double().mean() >= _ALIKE:
            return True
    return False


def _landmarks(look: Look, joint_set: JointSet) -> tuple[torch.Tensor, torch.Tensor]:
    points, trust = map_to_landmarks(look.joints2d[None], look.confidence[None], joint_set)
    return points[0], trust[0]
