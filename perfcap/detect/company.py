"""Who else is near the person who is followed, so that nobody takes their place.

A network that sees one person in a crop goes over to whoever covers the person, or stands beside.
One that sees everybody in the image tells them apart: each is followed from frame to frame, and of
all who are seen each is given one, at the least cost of all (Kuhn 1955).
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

_BETTER = 0.05  # of a box and a body's, shared: from which another fits it better
_EVERY = 10  # frames from one look at who else is there to the next, while nobody is
_REACH = 1.5  # sizes of the body, within which somebody is near
_GONE = 3.0  # sizes, beyond which they are no more
_FORGOTTEN = 30  # frames after which somebody who is not seen is forgotten
_SAME = 0.5  # cost up to which a sighting is of whoever was there a frame before
_WIDER = 0.06  # more of it for each frame in which they were not seen
_FARTHEST = 1.2  # the most that it becomes
_ANYWHERE = 1.5  # the same, once the person may be anywhere
_DOUBTED = 0.3  # cost from which a look at a person who was alone is compared with other people
_LOST = 3  # frames after which whoever turned up since may be the person
_NEVER = 1e3


class Company:
    """The person who is followed, and the others near them, from frame to frame.

    Args:
        network: looks at people up close.
        finder: finds people in whole frames.

    Attributes:
        near: looks at the others in the last frame.
    """

    def __init__(self, network: CropNetwork, finder: Finder) -> None:
        self.near: list[Look] = []
        self._network, self._finder = network, finder
        self._person: Trace | None = None
        self._others: list[Trace] = []

    @property
    def present(self) -> bool:
        """Whether there is any."""
        return bool(self._others)

    def told_apart(self, frame: Frame, look: Look | None) -> Look | None:
        """The look at the person; None where they are hidden.

        Args:
            frame: (H, W, 3), RGB.
            look: where the network looked ahead; None where it saw nobody.
        """
        joints = self._network.joint_set
        looks = self._looks(frame, look)
        seen = [Sighting.of(each, joints, frame) for each in looks]
        tracks = [] if self._person is None else [self._person, *self._others]
        found = self._go_on(looks, seen, _given(tracks, seen))
        return found if found is None or found is look else self._closer(frame, found)

    def met(self, number: int, frame: Frame, look: Look | None) -> Look | None:
        """The look at the person in a frame before which nobody was near.

        Now and then, and where they moved as people do not, it is seen whether somebody is.

        Args:
            number: of the frame.
            frame: (H, W, 3), RGB.
            look: at the person; None where nobody is seen.
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
        """The look that is at the person, once everybody has gone on; None without one."""
        mine = given.get(0)
        self._person = self._after(None if mine is None else seen[mine])
        if self._person is None:
            return None
        self._renew(self._person, looks, seen, given)
        return None if mine is None else looks[mine]

    def in_box(self, frame: Frame, box: Box, look: Look) -> Look:
        """Whoever fits a box best, of a look at its middle and all whom the finder sees."""
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
        """At everybody in a frame, nobody twice."""
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
        """Go on with the others, and with who is new."""
        self.near, kept = [], list[Trace]()
        for row, track in enumerate(self._others, 1):
            at = given.get(row)
            after = track.after(None if at is None else seen[at])
            if at is not None:
                self.near.append(looks[at])
                after = replace(after, beside=after.beside + (0 in given))
            # who went away while the person is hidden is kept in mind: they are not the person
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
        """Take somebody for the lost person who turned up since and was never seen beside them."""
        new = [each for each in self._others if not each.beside and not each.age]
        if person.age < _LOST or not new:
            return
        anywhere = person.age >= AGE
        best = min(new, key=lambda each: person.cost(each.last, anywhere))
        if person.cost(best.last, anywhere) < (_ANYWHERE if anywhere else _FARTHEST):
            self._person = person.after(best.last)
            self._others = [each for each in self._others if each is not best]

    def _closer(self, frame: Frame, look: Look) -> Look:
        """The same person up close; as the finder saw them, where that shows somebody else."""
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
    """Which sighting each track is given; none to those whom no free one fits.

    The first track's person may be anywhere after some frames.
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
