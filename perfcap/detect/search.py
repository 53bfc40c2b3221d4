"""Where the people of an image are, for a network that sees one in a crop."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import numpy as np

from perfcap.detect.crop import Crop, Frame
from perfcap.detect.look import Box, CropNetwork, Finder, Look, is_person, look_at, sureness
from perfcap.detect.whereabouts import ANYWHERE, Whereabouts

_LOG = logging.getLogger(__name__)
_OTHERS = (
    "%d people are seen, and the surest is followed, at first at x %.0f to %.0f, y %.0f to %.0f: "
    "--person 2 or --box says another, and overlay.mp4 shows who it is"
)
_SCALES = (1.0, 0.6, 0.36)  # of the image: sizes of the windows searched
_STEP = 0.5  # of a window: how far apart they are
_LEAST = 40.0  # pixels: height of the smallest windows; networks see nobody in less
_CANDIDATES = 3  # windows looked at again around what they show
_AGAIN = (1.5, 1.0)  # crops centred on what is seen, the first wider: limbs may be cut off
_TURNS = (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi)
SURE = 0.6  # mean confidence from which nobody is looked for lying or upside down
_SURER = 0.1  # mean confidence that speaks for a turned crop
SAME = 0.5  # of the smaller box: overlap of two looks at one person


def search(
    network: CropNetwork,
    frame: Frame,
    person: int = 1,
    inside: Box | None = None,
    finder: Finder | None = None,
    last: Whereabouts = ANYWHERE,
    alone: bool = False,
) -> Look | None:
    """The surest person of an image, looked at once more up close.

    Args:
        network: the detector.
        frame: (H, W, 3).
        person: 1 for the surest, 2 for the next, ...
        inside: where the person is; anywhere if None.
        finder: says where people may be; windows all over the image without one, and where it
            finds too few.
        last: where the person was seen; who is too far from there is somebody else, and who is
            nearer comes first.
        alone: whether to warn of others.
    """

    def likely(look: Look) -> float:
        return -last.likely(look, network.joint_set)

    for crops in _places_to_look(network, frame, finder):
        looks = sorted(look_at(network, frame, crops), key=likely)
        if inside is not None:
            looks = [look for look in looks if overlap(inside, look.box()) > 0]
        looks = _apart(looks)[: _CANDIDATES + person - 1]
        closer = [turn_around(network, frame, centre(network, frame, look)) for look in looks]
        closer.sort(key=likely)
        people = [look for look in _apart(closer) if is_person(look.confidence, network.joint_set)]
        there = [look for look in people if last.near(look)]
        if people and not there:  # others are seen
            return None
        if inside is not None:
            there = [look for look in there if overlap(inside, look.box()) >= SAME]
        if len(there) >= person:
            box = there[0].box() if alone and len(there) > 1 else None
            if box is not None:
                left, top, right, bottom = box
                _LOG.warning(_OTHERS, len(there), left, right, top, bottom)
            return there[person - 1]
    return None


def _places_to_look(
    network: CropNetwork, frame: Frame, finder: Finder | None
) -> Iterator[list[Crop]]:
    """The people whom a finder sees and the whole image, then all over the image."""
    size = network.manifest.input.size
    if finder is not None:
        seen = [look.around(network, finder.joint_set) for look in finder(frame)]
        people = [crop for crop in seen if crop is not None]
        if people:  # and the whole image: a person may be too close for a finder
            yield [*people, Crop.around(whole(frame), size)]
    yield list(_windows(frame, size))


def centre(network: CropNetwork, frame: Frame, look: Look) -> Look:
    """The same person from crops that fit better and better."""
    for wider in _AGAIN:
        crop = look.around(network, network.joint_set, wider)
        if crop is None:
            return look
        look = look_at(network, frame, [crop])[0]
    return look


def turn_around(network: CropNetwork, frame: Frame, look: Look, sure: float = SURE) -> Look:
    """The same person in crops turned by quarters, if a network that may turn them is not sure.

    Args:
        network: the detector.
        frame: (H, W, 3).
        look: at the person.
        sure: mean confidence from which the look is kept.
    """
    joints, spec = network.joint_set, network.manifest.input
    if spec.turns == "none" or sureness(look.confidence, joints) >= sure:
        return look
    crop = look.crop
    size = max(crop.width, crop.height) / max(spec.size)
    others = [
        Crop(crop.center, size * spec.size[1], spec.size, a) for a in _TURNS if a != crop.angle
    ]
    best = max(
        look_at(network, frame, others), key=lambda other: sureness(other.confidence, joints)
    )
    if sureness(best.confidence, joints) < sureness(look.confidence, joints) + _SURER:
        return look
    again = centre(network, frame, best)
    surer = sureness(again.confidence, joints) >= sureness(best.confidence, joints)
    return again if surer else best


def whole(frame: Frame) -> Box:
    """The box of an image."""
    height, width = frame.shape[:2]
    return -0.5, -0.5, width - 0.5, height - 0.5


def _apart(looks: list[Look]) -> list[Look]:
    """Looks in order, without those at somebody seen before; those without a body last."""
    kept: list[Look] = []
    unclear: list[Look] = []
    for look in looks:
        box = look.box()
        if box is None:
            unclear.append(look)
        elif all(overlap(box, other.box()) < SAME for other in kept):
            kept.append(look)
    return [*kept, *unclear]


def overlap(one: Box, other: Box | None) -> float:
    """Area that two boxes share, of the smaller one; ``SAME`` or more is one person."""
    if other is None:
        return 0.0
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    return max(width, 0.0) * max(height, 0.0) / max(min(areas), 1e-9)


def _windows(frame: Frame, size: tuple[int, int]) -> Iterator[Crop]:
    """The whole image, and overlapping windows of the input's shape in smaller sizes."""
    left, top, right, bottom = whole(frame)
    largest = Crop.around((left, top, right, bottom), size)
    yield largest
    longer = max(frame.shape[:2])
    for scale in _SCALES:
        width = scale * longer * min(1.0, size[1] / size[0])
        height = width * size[0] / size[1]
        if height < _LEAST:
            return
        for x in _spread(left, right, width):
            for y in _spread(top, bottom, height):
                if width < 0.99 * largest.width:
                    yield Crop((x, y), width, size)


def _spread(low: float, high: float, length: float) -> list[float]:
    """Middles of windows that cover a range, half a window apart."""
    if length >= high - low:
        return [0.5 * (low + high)]
    count = int(np.ceil((high - low - length) / (_STEP * length))) + 1
    return [float(v) for v in np.linspace(low + 0.5 * length, high - 0.5 * length, count)]
