"""One person through the frames of a view: found once, then followed from crop to crop."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from perfcap.detect.combine import Seen, combined
from perfcap.detect.company import Company
from perfcap.detect.crop import Crop, Frame, next_crop
from perfcap.detect.crowd import follow_all, same_person
from perfcap.detect.detections import Detections
from perfcap.detect.look import (
    SEEN,
    Box,
    CropNetwork,
    Finder,
    Look,
    is_person,
    look_at,
    turned,
)
from perfcap.detect.search import SAME, centre, overlap, search, turn_around, whole
from perfcap.detect.whereabouts import AGE, ANYWHERE, NEARBY, UNSURE
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

_THIN = 2.0  # px; thinner boxes show nobody
_LOG = logging.getLogger(__name__)
_OTHER = (
    "frame %d: the person was not seen for %d frames, and who is followed from here on is %.1f "
    "body sizes away: somebody else? (--frames ends before; --box and --person say whom to follow)"
)


@dataclass(frozen=True)
class Start:
    """Whom to follow.

    Attributes:
        box: (left, top, right, bottom) of the person in the first frame; None to search.
        person: where nobody says a box: 1 for the surest person of the image, 2 for the next, ...
        finder: network that finds people in whole images; None to search with windows.
        alone: whether to warn of others in that image.
        watcher: network that finds people in whole images, to separate other people nearby from
            the person; without one, a person who occludes them may be followed instead.
    """

    box: Box | None = None
    person: int = 1
    finder: Finder | None = None
    alone: bool = False
    watcher: Finder | None = None

    def __post_init__(self) -> None:
        if self.box is None:
            return
        if len(self.box) != 4 or not all(math.isfinite(edge) for edge in self.box):
            raise InputError(
                f"box is {self.box!r:.80}, expected (left, top, right, bottom), pixels"
            )
        left, top, right, bottom = self.box
        if min(right - left, bottom - top) < _THIN:
            raise InputError(
                f"box is {self.box!r:.80}, which is {right - left:.3g} px wide and "
                f"{bottom - top:.3g} px high; expected (left, top, right, bottom) in pixels of the "
                "image: no shares of its size, nor left, top, width and height"
            )


def follow_person(
    network: CropNetwork,
    frames: Iterable[Frame],
    start: Start,
    camera: Camera | None = None,
    others: Sequence[CropNetwork] = (),
    poses: bool = False,
) -> Detections:
    """Joints of one person in every frame of a view, (F, 1).

    The crop of a frame is centred on the joints of the frame before. Where nobody is followed, and
    where somebody shrinks or jumps from one frame to the next, the whole image is searched; see
    ``search``. Left and right are settled at the end, by motion; see
    ``settle_sides``. Other networks look at the person whom the first one follows, and add what
    they see better; see ``fuse``.

    Args:
        network: the detector.
        frames: (H, W, 3), RGB, in order.
        start: whom to follow.
        camera: the view, in pixels of the frames; turns 3D joints from the axes of each crop
            into the camera's where the manifest says they are (Mehta et al. 2017).
        others: further detectors of 2D joints.
        poses: whether 3D joints of another network are of use where the first one has none.

    Returns:
        The 16 landmarks in pixels of the frames, float32; confidence 0 where nobody is found. 3D
        joints are those of the first network, if it has any; another's are in the axes of its crop.

    Raises:
        InputError: nobody is in the box of the first frame.
    """
    seen: list[Seen | None] = []
    for frame, look, near in _follow(network, frames, start):
        found = None if look is None else _seen(network, frame, look, others)
        seen.append(None if found is None else _of_one(found, near, network, others))
    return combined(seen, network, camera, others, poses)


def follow_people(
    network: CropNetwork,
    frames: Iterable[Frame],
    finder: Finder,
    count: int,
    camera: Camera | None = None,
    others: Sequence[CropNetwork] = (),
    poses: bool = False,
) -> tuple[Detections, ...]:
    """Joints of several people in every frame of a view, (F, 1) each; see ``follow_all``.

    Args:
        network: the detector.
        frames: (H, W, 3), RGB, in order.
        finder: finds people in whole frames.
        count: how many are followed at most.
        camera: as ``follow_person`` takes them, like all that follow.
        others: further detectors of 2D joints.
        poses: whether 3D joints of another network are of use.

    Returns:
        As of one person. Who is who is not known: a track may go on with another person after
        frames without one.
    """
    seen: list[list[Seen | None]] = [[] for _ in range(count)]
    for frame, looks in follow_all(network, frames, finder, count):
        for row, look in zip(seen, looks, strict=True):
            if look is None:
                row.append(None)
                continue
            near = [one for one in looks if one is not None and one is not look]
            row.append(_of_one(_seen(network, frame, look, others), near, network, others))
    return tuple(combined(row, network, camera, others, poses) for row in seen)


def _seen(network: CropNetwork, frame: Frame, look: Look, others: Sequence[CropNetwork]) -> Seen:
    """The same person as other networks see them."""
    crops = [look.around(other, network.joint_set) for other in others]
    further = (
        None if crop is None else look_at(other, frame, [crop])[0]
        for other, crop in zip(others, crops, strict=True)
    )
    return Seen(look, tuple(further))


def _of_one(
    seen: Seen, near: Sequence[Look], network: CropNetwork, others: Sequence[CropNetwork]
) -> Seen:
    """The same without what other networks see of other people, who may hide this one."""
    mine: list[Look | None] = []
    for look, other in zip(seen.others, others, strict=True):
        theirs = look is not None and any(
            same_person(look, one, network.joint_set, other.joint_set) for one in near
        )
        own = look is not None and same_person(look, seen.look, network.joint_set, other.joint_set)
        mine.append(None if theirs and not own else look)
    return replace(seen, others=tuple(mine))


def _follow(
    network: CropNetwork, frames: Iterable[Frame], start: Start
) -> Iterator[tuple[Frame, Look | None, list[Look]]]:
    """Frames with the look at the person and those at others who are near."""
    spec = network.manifest.input
    crop = None if start.box is None else Crop.around(start.box, spec.size, spec.padding)
    known = ANYWHERE
    company = None if start.watcher is None else Company(network, start.watcher)
    for number, frame in enumerate(frames):
        if network.manifest.output.kind == "joints3d":  # no 2D joints to follow
            padding = spec.padding if start.box else 1.0
            part = Crop.around(start.box or whole(frame), spec.size, padding)
            yield frame, look_at(network, frame, [part])[0], []
            continue
        look = None if crop is None else look_at(network, frame, [crop])[0]
        if look is not None and number == 0:
            look = _shown(network, frame, start, look, company)
        seen = look is not None and is_person(look.confidence, network.joint_set)
        present = company is not None and company.present
        if company is not None and present:
            look = company.separate(frame, look if seen else None)
        elif look is None or not seen:
            whom = replace(start, person=1, alone=False) if known.ever else start
            look = search(network, frame, whom.person, None, whom.finder, known, whom.alone)
        elif known.doubts(look):
            again = search(network, frame, finder=start.finder, last=known)
            both = [look] if again is None else [look, again]
            look = max(both, key=lambda one: known.likely(one, network.joint_set))
        else:
            look = turn_around(network, frame, look, UNSURE)
        if company is not None and not present:
            look = company.watch(number, frame, look)
        if known.age >= AGE and look is not None and (apart := known.moved(look.box())) > NEARBY:
            _LOG.warning(_OTHER, number, known.age, apart)
        known = known.after(look)
        yield frame, look, [] if company is None else company.near
        crop = None
        if look is not None:
            angle = turned(look, network.joint_set, spec.turns)
            joints = look.joints2d, look.confidence, SEEN
            crop = next_crop(look.crop, *joints, spec.padding, angle)


def _shown(
    network: CropNetwork, frame: Frame, start: Start, look: Look, company: Company | None
) -> Look:
    """The person in the user's box, nobody else: the crop of the box, or what is found in it."""
    look = turn_around(network, frame, centre(network, frame, look))
    if company is not None and start.box is not None:
        look = company.in_box(frame, start.box, look)
    box, joints = look.box(), network.joint_set
    if start.box is None or (
        box is not None and overlap(start.box, box) >= SAME and is_person(look.confidence, joints)
    ):
        return look
    found = search(network, frame, inside=start.box, finder=start.finder)
    if found is None:
        told = " ".join(f"{each:g}" for each in start.box or ())
        raise InputError(
            f"--box {told}: nobody is seen there in the first frame; expected LEFT TOP RIGHT "
            "BOTTOM about the person, in pixels of the video (--frames chooses another first frame)"
        )
    return found
