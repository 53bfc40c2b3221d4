"""The person who is followed among other people, none of whom may take their place.

A network that sees one person per crop switches to whoever occludes the person or stands next to
them. One that sees all people of an image separates them: each is tracked from frame to frame, and
sightings are assigned to tracks one to one, at the least total cost (Kuhn 1955).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from perfcap.detect.crop import Frame
from perfcap.detect.crowd import renamed, same_person
from perfcap.detect.look import Box, CropNetwork, Finder, Look, is_person, look_at
from perfcap.detect.search import centre
from perfcap.detect.sighting import Sighting, Trace
from perfcap.detect.whereabouts import AGE

_BETTER = 0.05  # overlap with the user's box by which another person fits it better
_EVERY = 10  # frames between two searches for other people, while none are near
_REACH = 1.5  # body sizes, within which other people are near
_GONE = 3.0  # body sizes, beyond which they are dropped
_FORGOTTEN = 30  # frames without a sighting, after which they are dropped
_SAME = 0.5  # largest cost at which a sighting belongs to a track of the frame before
_WIDER = 0.06  # added to it for each frame without a sighting
_FARTHEST = 1.2  # its largest value
_ANYWHERE = 1.5  # the same for the person, once they may be anywhere
_DOUBTED = 0.3  # cost from which a look at a person who was alone is checked against other people
_LOST = 3  # frames without a sighting, after which a new track may be the person's
_NEVER = 1e3


class Company:
    """Tracks of the person who is followed, and of the other people near them.

    Args:
        network: sees one person per crop.
        finder: finds all people of a frame.

    Attributes:
        near: looks at the other people in the last frame.
    """

    def __init__(self, network: CropNetwork, finder: Finder) -> None:
        self.near: list[Look] = []
        self._network, self._finder = network, finder
        self._person: Trace | None = None
        self._others: list[Trace] = []

    @property
    def present(self) -> bool:
        """Whether other people are near."""
        return bool(self._others)

    def separate(self, frame: Frame, look: Look | None) -> Look | None:
        """The look at the person in a frame with other people; None while they are occluded.

        Args:
            frame: (H, W, 3), RGB.
            look: in the crop where the person was a frame before; None if nobody is seen there.
        """
        joints = self._network.joint_set
        looks = self._looks(frame, look)
        seen = [Sighting.of(each, joints, frame) for each in looks]
        tracks = [] if self._person is None else [self._person, *self._others]
        found = self._go_on(looks, seen, _given(tracks, seen))
        return found if found is None or found is look else self._closer(frame, found)

    def watch(self, number: int, frame: Frame, look: Look | None) -> Look | None:
        """The look at the person in a frame before which no other people were near.

        Searches for other people at intervals, and at once where the person seems to jump.

        Args:
            number: of the frame.
            frame: (H, W, 3), RGB.
            look: at the person; None if nobody is seen.
        """
        self.near = []
        joints = self._network.joint_set
        alone = None if look is None else Sighting.of(look, joints)
        doubted = (
            alone is not None
            and self._person is not None
            and self._person.age == 0
            and self._person.cost(alone) > _DOUBTED
        )
        if look is None or not (doubted or number % _EVERY == 0):
            self._person = self._after(alone)
            return look
        looks = self._looks(frame, look)
        seen = [Sighting.of(each, joints, frame) for each in looks]
        given = _given([self._person], seen) if doubted and self._person is not None else {}
        found = self._go_on(looks, seen, given or {0: 0})
        return found if found is None or found is look else self._closer(frame, found)

    def _go_on(
        self, looks: Sequence[Look], seen: Sequence[Sighting], given: dict[int, int]
    ) -> Look | None:
        """Move all tracks on by a frame; the look assigned to the person, None without one."""
        mine = given.get(0)
        self._person = self._after(None if mine is None else seen[mine])
        if self._person is None:
            return None
        self._renew(self._person, looks, seen, given)
        return None if mine is None else looks[mine]

    def in_box(self, frame: Frame, box: Box, look: Look) -> Look:
        """The look that fits a box best: one at its middle, or one at a person of the finder."""
        best = max(self._looks(frame, look), key=lambda each: _share(box, each.box()))
        if _share(box, best.box()) < _share(box, look.box()) + _BETTER:
            return look
        return self._closer(frame, best)

    def _after(self, sighting: Sighting | None) -> Trace | None:
        """The person one frame later; None if they were never seen."""
        if self._person is None:
            return None if sighting is None else Trace.from_sighting(sighting)
        return self._person.after(sighting)

    def _looks(self, frame: Frame, look: Look | None) -> list[Look]:
        """At all people of a frame, each once; the given look first."""
        joints = self._network.joint_set
        looks = [] if look is None else [look]
        for each in self._finder(frame):
            if not is_person(each.confidence, self._finder.joint_set) or each.box() is None:
                continue
            other = renamed(each, self._finder.joint_set, joints)
            if not any(same_person(other, one, joints) for one in looks):
                looks.append(other)
        return looks

    def _renew(
        self,
        person: Trace,
        looks: Sequence[Look],
        seen: Sequence[Sighting],
        given: dict[int, int],
    ) -> None:
        """Move the tracks of other people on by a frame, and start tracks of new ones."""
        self.near, kept = [], list[Trace]()
        for row, track in enumerate(self._others, 1):
            at = given.get(row)
            after = track.after(None if at is None else seen[at])
            if at is not None:
                self.near.append(looks[at])
                after = replace(after, beside=after.beside + (0 in given))
            # while the person is occluded, those who walk away are kept: they are not the person
            there = person.age > 0 or person.last.apart(after.last) < _GONE
            if after.age < _FORGOTTEN and there:
                kept.append(after)
        for column, sighting in enumerate(seen):
            if column not in given.values() and person.last.apart(sighting) < _REACH:
                kept.append(Trace.from_sighting(sighting))
                self.near.append(looks[column])
        self._others = kept
        self._recognise(person)

    def _recognise(self, person: Trace) -> None:
        """Give a lost person the track of somebody new who was never seen beside them."""
        new = [each for each in self._others if not each.beside and not each.age]
        if person.age < _LOST or not new:
            return
        anywhere = person.age >= AGE
        best = min(new, key=lambda each: person.cost(each.last, anywhere))
        if person.cost(best.last, anywhere) < (_ANYWHERE if anywhere else _FARTHEST):
            self._person = person.after(best.last)
            self._others = [each for each in self._others if each is not best]

    def _closer(self, frame: Frame, look: Look) -> Look:
        """The same person up close; the finder's own look if that shows another person."""
        joints = self._network.joint_set
        crop = look.around(self._network, joints)
        if crop is None:
            return look
        closer = centre(self._network, frame, look_at(self._network, frame, [crop])[0])
        if same_person(closer, look, joints) and is_person(closer.confidence, joints):
            return closer
        return replace(look, crop=crop)


def _share(one: Box, other: Box | None) -> float:
    """Area that two boxes share, of what they cover together."""
    if other is None:
        return 0.0
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    both = max(width, 0.0) * max(height, 0.0)
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (one, other))
    return both / max(areas - both, 1e-9)


def _given(tracks: Sequence[Trace], seen: Sequence[Sighting]) -> dict[int, int]:
    """The sighting of each track, by their indices; tracks without one are left out.

    The first track is the person's, who may be anywhere after some frames without a sighting.
    """
    if not seen or not tracks:
        return {}
    costs = np.array(
        [
            [track.cost(each, row == 0 and track.age >= AGE) for each in seen]
            for row, track in enumerate(tracks)
        ]
    )
    table = np.full((len(tracks), len(seen) + len(tracks)), _NEVER)
    for row, track in enumerate(tracks):
        most = min(_SAME + _WIDER * track.age, _FARTHEST)
        most = _ANYWHERE if row == 0 and track.age >= AGE else most
        table[row, : len(seen)] = np.where(costs[row] < most, costs[row], _NEVER)
        table[row, len(seen) + row] = _ANYWHERE  # none
    found = zip(*linear_sum_assignment(table), strict=True)
    return {int(row): int(column) for row, column in found if column < len(seen)}
