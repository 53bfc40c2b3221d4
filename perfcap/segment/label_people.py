"""Which person each pixel of a foreground shows (Liu et al. 2013, Sec. 5).

The foreground, everybody against the background, is one binary cut, as that of one person. Inside
it, only pixels that more than one person may reach are open: there a field of K labels decides,
with the probability of each person's shape, their colours part by part, and edges of the image. So
one person's labels are the cut itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from perfcap.segment.grabcut import Segmentation
from perfcap.segment.label_field import FieldSettings, LabelField
from perfcap.segment.part_colors import PartColors, PartColorSettings
from perfcap.segment.person_layer import PersonLayer, Surroundings
from perfcap.segment.shape_samples import ShapeSamples
from perfcap.segment.trimap import BACKGROUND, PROBABLE_FOREGROUND, Box, Mask, Trimap
from perfcap.setting_checks import Settings

# --- How probable each person is at each pixel, from solved poses and how sure they are -----------
#
# Liu et al. 2013, Sec. 5.2.1, Eq. 18 to 23, in closed form: their samples of poses around the last
# one are replaced by the deviations of what they are drawn from, carried into the image. Every
# person is drawn alone, so that a limb that is hidden keeps its probability where it may come out
# again. An outline that is off by a deviation s covers a pixel at a distance d inside it with the
# probability of a logistic distribution; a pixel shows a person whom nobody nearer covers.

Plane = NDArray[np.float32]

_SLOPE = 1.8138  # of a logistic distribution of deviation one: pi / sqrt(3)
_LOOSE, _WIDE = 0.05, 4.0  # share of outlines that are further off, as of skirts, and how much
_LEAST = 1e-6  # probability of whatever is possible at all


def in_front(one: Surroundings, other: Surroundings, doubt: float) -> Plane:
    """Probability that one person is nearer to the camera than another, (h, w).

    Args:
        one: the person asked about.
        other: the other.
        doubt: deviation of the difference of their depths, m.
    """
    with np.errstate(invalid="ignore"):
        apart = np.nan_to_num((other.depth - one.depth) / max(doubt, 1e-6), posinf=9, neginf=-9)
    found: Plane = ndtr(apart).astype(np.float32)
    return found


def _covers(deviations: Plane) -> Plane:
    """Probability that an outline covers a pixel so many deviations inside of it."""
    close, loose = (expit(_SLOPE * deviations / width) for width in (1.0, _WIDE))
    covered: Plane = (1 - _LOOSE) * close + _LOOSE * loose
    return covered


def shape_prior(people: Sequence[Surroundings], doubt: float) -> Plane:
    """Probability that a pixel of anybody is one of each person, (K, h, w), of sum one.

    Args:
        people: K models around the pixels.
        doubt: deviation of the difference of two depths, m.
    """
    covers = [_covers(each.distance / each.spread) for each in people]
    shown = []
    for k, one in enumerate(people):
        free = covers[k]
        for j, other in enumerate(people):
            if j != k:
                free = free * (1 - covers[j] * in_front(other, one, doubt))
        shown.append(free + _LEAST)
    total = np.stack(shown)
    found: Plane = (total / total.sum(0)).astype(np.float32)
    return found


# --- Which person each pixel of a foreground shows (Liu et al. 2013, Sec. 5) ----------------------

Labels = NDArray[np.uint8]
# of a part of the image, the foreground (h, w) there and the closed form (K, h, w)
Prior = Callable[[Box, Mask, Plane], Plane]

_MOST = 20.0  # nats in favour of a label that nothing contests
_CLEAR = 11.0  # nats of shape that neither colours nor neighbours overrule
_SIDE = 2  # px around contested pixels whose labels are looked at, too


@dataclass(frozen=True)
class PeopleSettings(Settings):
    """How the people of a foreground are told apart.

    Attributes:
        smoothness: prices of neighbours.
        color: what colours say.
        samples: of poses, whose frequency is the shape prior; the closed form where None.
    """

    smoothness: FieldSettings = field(default_factory=FieldSettings)
    color: PartColorSettings = field(default_factory=PartColorSettings)
    samples: ShapeSamples | None = None


@dataclass(frozen=True)
class PeopleLabels:
    """Who is where in one frame and view.

    Attributes:
        labels: (H, W), 0 background, k the k-th person.
        people: each person's own segmentation, as if they had been alone; its evidence speaks for
            the person and against the background and everybody else.
        box: of the contested pixels.
        ahead: probability that each person is nearer to the camera than who is seen there,
            (K, h, w) in ``box``; one where nobody else is.
    """

    labels: Labels
    people: tuple[Segmentation, ...]
    box: Box
    ahead: Plane


def label_people(
    found: Segmentation,
    layers: Sequence[PersonLayer],
    colors: Sequence[PartColors],
    settings: PeopleSettings | None = None,
    prior: Prior | None = None,
) -> PeopleLabels:
    """Tell the people of a foreground apart.

    Args:
        found: everybody, in regions ``joined`` from those of K people.
        layers: each as their model alone would be seen.
        colors: of each, in this view; empty to do without.
        settings: of the field.
        prior: of shapes, instead of the closed form.
    """
    settings, trimaps = settings or PeopleSettings(), found.trimap.people
    mask = found.mask[found.trimap.box]
    reach = np.stack([each.labels != BACKGROUND for each in trimaps])
    labels = np.where(mask, reach.argmax(0) + 1, 0).astype(np.uint8)
    nats = np.where(reach, np.float32(0), np.float32(np.inf))
    contested = mask & (reach.sum(0) > 1)
    inner = _bounds(contested)
    ahead = np.ones((len(trimaps), *contested[inner].shape), np.float32)
    if contested.any():
        place = _outward(inner, found.trimap.box)
        around = [each.seen_from(place) for each in layers]
        doubt = float(np.hypot.reduce([each.doubt for each in layers]))
        shapes = shape_prior(around, doubt)
        shapes = shapes if prior is None else prior(place, mask[inner], shapes)
        nats[:, *inner] -= np.log(shapes)
        image = found.image[inner].astype(np.float32)
        solved = _solved(
            image, nats[:, *inner], labels[inner], contested[inner], around, colors, settings
        )
        labels[inner] = solved
        ahead = _ahead(around, solved, doubt)
    whole = np.zeros(found.trimap.shape, np.uint8)
    whole[found.trimap.box] = labels
    people = tuple(
        _alone(found, trimap, labels, nats, contested, number)
        for number, trimap in enumerate(trimaps)
    )
    return PeopleLabels(whole, people, _outward(inner, found.trimap.box), ahead)


def near_each_other(labels: Labels, people: Sequence[int], reach: float) -> bool:
    """Whether two people are seen within ``reach`` px of each other in labels (H, W).

    Somebody of whom nothing is seen may be behind anybody, and is near them.

    Args:
        labels: 0 background, k the k-th person.
        people: labels of those who should be there.
        reach: px.
    """
    masks = [labels == number for number in people]
    if not all(mask.any() for mask in masks):
        return len(masks) > 1
    reached = np.zeros(labels.shape, np.bool_)
    for mask in masks:
        away = cv2.distanceTransform((~mask).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
        around = away <= reach / 2
        if (reached & around).any():
            return True
        reached |= around
    return False


def _solved(
    image: Plane,
    nats: Plane,
    labels: Labels,
    contested: Mask,
    around: Sequence[Surroundings],
    colors: Sequence[PartColors],
    settings: PeopleSettings,
) -> Labels:
    """Labels (h, w) of the foreground, of which contested pixels are open.

    Args:
        image: (h, w, 3).
        nats: what shapes say against each person, (K, h, w); what colours say is added in place.
        labels: where the background is, and who is where nobody contests it.
        contested: pixels that several people may reach.
        around: everybody's models.
        colors: of each; may be empty.
        settings: of the field.
    """
    best = nats.min(0)
    unsure = contested & ((nats < best + _CLEAR).sum(0) > 1)
    if colors and unsure.any():
        pixels = image[unsure]
        pairs = zip(colors, around, strict=True)
        density = np.stack(
            [own.log_density(pixels, each.part[unsure], settings.color) for own, each in pairs]
        )
        nats[:, unsure] -= np.maximum(density - density.max(0), -settings.color.limit)
    # the cut has decided where the background is: nothing open may become it
    field = np.concatenate([np.full((1, *unsure.shape), np.inf, np.float32), nats])
    start = np.where(contested, field.argmin(0), labels).astype(np.uint8)
    return LabelField.of(image, field, unsure, settings.smoothness).solve(start)


def _ahead(around: Sequence[Surroundings], labels: Labels, doubt: float) -> Plane:
    """How probably each is nearer than who is seen, (K, h, w)."""
    ahead = np.ones((len(around), *labels.shape), np.float32)
    for k, one in enumerate(around):
        for j, other in enumerate(around):
            if j != k:
                chosen = labels == j + 1
                ahead[k][chosen] = in_front(one, other, doubt)[chosen]
    return ahead


def _alone(
    found: Segmentation,
    trimap: Trimap,
    labels: Labels,
    nats: Plane,
    contested: Mask,
    number: int,
) -> Segmentation:
    """One person's part of a segmentation of everybody."""
    own = labels == number + 1
    if len(nats) == 1:
        return found
    others = np.delete(nats, number, 0).min(0)
    with np.errstate(invalid="ignore"):
        better = np.nan_to_num(np.clip(others - nats[number], -_MOST, _MOST), nan=0.0)
    inside = labels > 0
    # against whoever else is there; against the background where nobody else may be
    evidence = np.where(inside, np.minimum(better, _MOST), found.evidence)
    open_ = inside & own & found.trimap.band
    evidence = np.where(open_, np.minimum(evidence, found.evidence), evidence)
    regions = trimap.labels.copy()
    regions[contested & (regions != BACKGROUND)] = PROBABLE_FOREGROUND
    report = replace(found.report, person=trimap.size > 0, cropped=trimap.cropped)
    mask = np.zeros(trimap.shape, np.bool_)
    mask[trimap.box] = own
    if not trimap.size:
        return replace(found, mask=mask, trimap=trimap, evidence=evidence, report=report)
    return replace(
        found, mask=mask, trimap=replace(trimap, labels=regions), evidence=evidence, report=report
    )


def _bounds(chosen: Mask) -> Box:
    """What holds all chosen pixels, and a little around them."""
    rows, columns = np.nonzero(chosen.any(1))[0], np.nonzero(chosen.any(0))[0]
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    return (
        slice(max(int(rows[0]) - _SIDE, 0), min(int(rows[-1]) + _SIDE + 1, chosen.shape[0])),
        slice(max(int(columns[0]) - _SIDE, 0), min(int(columns[-1]) + _SIDE + 1, chosen.shape[1])),
    )


def _outward(inner: Box, box: Box) -> Box:
    """Rows and columns of a part of the image as those of the image."""
    return (
        slice(inner[0].start + box[0].start, inner[0].stop + box[0].start),
        slice(inner[1].start + box[1].start, inner[1].stop + box[1].start),
    )
