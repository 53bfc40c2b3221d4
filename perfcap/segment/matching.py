"""Pairs of model and image contour points (Xu et al. 2018, Sec. 5.2, 5.3 and 6.3).

Both ways: every point on the model's silhouette looks for the image contour, and what is then
left of the image contour looks for the model's: an arm that sticks out of the person in the image
while the model holds it in front of its torso has no silhouette of its own to look from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.render.occluding_contour import ModelContour
from perfcap.segment.contour import Contour
from perfcap.segment.correspondence import Matches
from perfcap.segment.pruning import crosses, nearest_claim, slide, support
from perfcap.setting_checks import Settings

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

_METRES, _LARGER = 3.0, 5.0  # sizes that are heights in metres; of a model so many times as large


@dataclass(frozen=True)
class Matching(Settings):
    """What may be a pair; lengths are shares of the person's size in the image.

    Attributes:
        distance: longest pair.
        farthest: the same in px, whatever the person's size.
        angle: largest angle between the two normals, degrees.
        turn: length that a difference of one between unit normals (60 degrees) counts as in the
            search for the nearest point.
        slide: longest way along the contour, added to ``slope`` times the way across it.
        slope: see ``slide``.
        agreement: how far shifts of neighbours may differ, and by how much more a pixel between
            them.
        neighbours: most that are asked of a third of all points, and how far away they may be.
        support: shares of agreeing neighbours that make a pair's confidence 0 and 1.
        margin: by how much a pair may reach beyond another side of the model.
        squeeze: share of the width of a part whose other side is not seen, by which its one side
            may move towards that; ``margin`` at least.
        hold: confidence in that a point of the model's silhouette is where it is, if nothing in the
            image may be its pair.
        both_ways: also from the image to the model.
        pruned: without it, every point of the model's silhouette has its pair, whatever it is.
    """

    distance: float = 0.1
    farthest: float = 150.0
    angle: float = 45.0
    turn: float = 0.05
    slide: float = 0.008
    slope: float = 0.7
    agreement: tuple[float, float] = (0.004, 0.5)
    neighbours: tuple[int, float] = (16, 0.12)
    support: tuple[float, float] = (0.6, 0.9)
    margin: float = 0.008
    squeeze: float = 0.5
    hold: float = 0.0
    both_ways: bool = True
    pruned: bool = True


@dataclass(frozen=True)
class _Pairs:
    """Indices of points of the two contours, (N,) each."""

    model: Integers
    image: Integers

    def __getitem__(self, chosen: Flags) -> _Pairs:
        return _Pairs(self.model[chosen], self.image[chosen])

    def __add__(self, other: _Pairs) -> _Pairs:
        return _Pairs(
            np.concatenate([self.model, other.model]), np.concatenate([self.image, other.image])
        )


def match(
    model: ModelContour,
    image: Contour,
    settings: Matching | None = None,
    size: float | None = None,
    room: Floats | None = None,
) -> Matches:
    """Pairs of one frame and view.

    Args:
        model: contour of the model.
        image: contour of the silhouette.
        settings: limits.
        size: height of the upright person at its distance, px; the longer side of the model
            contour's bounding box when not given.
        room: width of the part that each point of the model's contour is on, where its other side
            lies before another part, (P,) px; infinite elsewhere. See ``part_depth``.

    Returns:
        Pairs with a confidence above 0, at most one for each point of either contour (unpruned:
        of the model's). Confidence is that of the image point, falling to 0 at the limits of
        distance, angle and support. Nothing to pair gives no pairs. With ``hold``, points of the
        model's silhouette that nothing may be paired with are paired with themselves: few pairs at
        a shoulder would swing an arm that has no mask.

    Raises:
        InputError: ``size`` is not positive or in metres, or ``room`` is of other points.
    """
    settings = settings if settings is not None else Matching()
    if size is not None and not size > 0:
        raise InputError(f"size is {size}; expected the person's height in pixels")
    if room is not None:
        require_shape(room, "room", (len(model),), "(P,) px, of each point of the model's contour")
    if not len(model) or not len(image):
        nothing = np.zeros(0, np.int64)
        return _matches(model, image, _Pairs(nothing, nothing), np.zeros(0))
    extent = max(float(np.ptp(model.points, 0).max()), 1.0)
    if size is not None and size < _METRES and extent > _LARGER * size:
        raise InputError(
            f"size is {size:.3g}, of a model that is {extent:.0f} px large; expected the upright "
            "person's height in pixels, not in metres"
        )
    size = size or extent
    search = _Search(model, image, settings, size, room)
    pairs = search.outward()
    if not settings.pruned:
        return _matches(model, image, pairs, image.confidence[pairs.image])
    pairs = search.plausible(pairs)
    idle = np.setdiff1d(np.flatnonzero(model.outer), pairs.model)
    pairs = pairs[nearest_claim(pairs.image, search.distance(pairs))]
    if settings.both_ways:
        more = search.plausible(search.inward(pairs))
        pairs += more[nearest_claim(more.model, search.distance(more))]
    confidence = search.confidence(pairs)
    confidence[search.crosses(pairs, confidence > 0)] = 0.0
    found = _matches(model, image, pairs, confidence)
    return _with_held(found, model, idle, settings.hold) if settings.hold > 0 else found


class _Search:
    """The two contours with lengths in pixels."""

    def __init__(
        self,
        model: ModelContour,
        image: Contour,
        settings: Matching,
        size: float,
        room: Floats | None,
    ) -> None:
        self.model, self.image, self.settings, self.size = model, image, settings, size
        room = np.full(len(model), np.inf) if room is None else room
        self.inmost = np.maximum(settings.squeeze * room, settings.margin * size)
        self.turn = settings.turn * size
        self.limit = min(settings.distance * size, settings.farthest)
        self.least_cosine = float(np.cos(np.radians(settings.angle)))
        self.model_places = np.concatenate([model.points, self.turn * model.normals], 1)
        self.image_places = np.concatenate([image.points, self.turn * image.normals], 1)

    def outward(self) -> _Pairs:
        """Of every point of the model's silhouette."""
        outer = np.flatnonzero(self.model.outer)
        pairs = _Pairs(outer, self._nearest(outer, self.turn))
        unlike = np.flatnonzero(self._cosine(pairs) < self.least_cosine)
        if self.settings.pruned and len(unlike):
            # behind a contour that faces elsewhere there may be the right one, further away
            pairs.image[unlike] = self._nearest(outer[unlike], self.limit)
        return pairs

    def _nearest(self, chosen: Integers, turn: float) -> Integers:
        """Image points nearest to model points in position and ``turn`` times the normal."""
        places = [
            np.concatenate([points, turn * normals], 1)
            for points, normals in (
                (self.image.points, self.image.normals),
                (self.model.points[chosen], self.model.normals[chosen]),
            )
        ]
        _, index = cKDTree(places[0]).query(places[1])
        return np.asarray(index, np.int64).reshape(-1)

    def inward(self, taken: _Pairs) -> _Pairs:
        """Of image points far from all that are taken, to model points inside its silhouette."""
        left = np.arange(len(self.image))
        if len(taken.image):
            tree = cKDTree(self.image_places[taken.image])
            gap, _ = tree.query(self.image_places[left], distance_upper_bound=self._claimed)
            left = left[np.isinf(gap)]
        choice = np.flatnonzero(~self.model.outer)
        if not len(choice) or not len(left):
            return taken[np.zeros(len(taken.model), bool)]
        _, index = cKDTree(self.model_places[choice]).query(self.image_places[left])
        return _Pairs(choice[index], left)

    @property
    def _claimed(self) -> float:
        """How far from a taken point, in position and normal, the contour is taken too, px."""
        return max(7.0, 0.01 * self.size)

    def distance(self, pairs: _Pairs) -> Floats:
        """In position and normal, (N,) px."""
        apart: Floats = self.image_places[pairs.image] - self.model_places[pairs.model]
        length: Floats = np.linalg.norm(apart, axis=1)
        return length

    def plausible(self, pairs: _Pairs) -> _Pairs:
        """Those near enough, with like normals, and ahead of each other."""
        offset, cosine = self._offset(pairs), self._cosine(pairs)
        middle = self.model.normals[pairs.model] + self.image.normals[pairs.image]
        middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-12)
        across = np.abs(np.einsum("nx,nx->n", offset, middle))
        longest = self.settings.slide * self.size + self.settings.slope * across
        near = np.linalg.norm(offset, axis=1) <= self.limit
        like = (cosine >= self.least_cosine) & (slide(offset, middle) <= longest)
        inward = -np.einsum("nx,nx->n", offset, self.model.normals[pairs.model])
        return pairs[near & like & (inward <= self.inmost[pairs.model])]

    def crosses(self, pairs: _Pairs, asked: Flags) -> Integers:
        """Those of the pairs asked for that reach through another side of the model.

        Only points on the silhouette do: what stands in front of the model's other parts may well
        leave its silhouette.
        """
        movement = np.zeros_like(self.model.points)
        movement[pairs.model] = self._offset(pairs)
        chosen = np.flatnonzero(asked & self.model.outer[pairs.model])
        through = crosses(
            self.model.points,
            self.model.normals,
            movement,
            pairs.model[chosen],
            self.turn,
            self.settings.margin * self.size,
        )
        return chosen[through]

    def confidence(self, pairs: _Pairs) -> Floats:
        """Of the image, times how far from every limit a pair is, (N,)."""
        distance = np.linalg.norm(self._offset(pairs), axis=1) / self.limit
        room = (self._cosine(pairs) - self.least_cosine) / (1 - self.least_cosine)
        low, high = self.settings.support
        share = np.clip((self._support(pairs) - low) / max(high - low, 1e-12), 0.0, 1.0)
        trust: Floats = self.image.confidence[pairs.image] * (1 - distance**2)
        return trust * np.sqrt(np.clip(room, 0.0, 1.0)) * share**2 * (3 - 2 * share)

    def _support(self, pairs: _Pairs) -> Floats:
        shift = np.full(len(self.model), np.nan)
        normals = self.image.normals[pairs.image]
        shift[pairs.model] = np.einsum("nx,nx->n", self._offset(pairs), normals)
        allowed, slope = self.settings.agreement
        most, radius = self.settings.neighbours
        return support(
            self.model.points,
            self.model.normals,
            shift,
            pairs.model,
            self.model.outer,
            (allowed * self.size, slope),
            most,
            radius * self.size,
        )

    def _offset(self, pairs: _Pairs) -> Floats:
        return self.image.points[pairs.image] - self.model.points[pairs.model]

    def _cosine(self, pairs: _Pairs) -> Floats:
        normals = (self.model.normals[pairs.model], self.image.normals[pairs.image])
        cosine: Floats = np.einsum("nx,nx->n", *normals)
        return cosine


def _matches(model: ModelContour, image: Contour, pairs: _Pairs, confidence: Floats) -> Matches:
    kept = confidence > 0
    pairs = pairs[kept]
    return Matches(
        model.vertices[pairs.model],
        model.weights[pairs.model],
        image.points[pairs.image],
        image.normals[pairs.image],
        confidence[kept],
        pairs.model,
        pairs.image,
    )


def _with_held(found: Matches, model: ModelContour, idle: Integers, confidence: float) -> Matches:
    """Pairs, and those of ``idle`` points of the model with themselves."""
    still = model[idle]
    return Matches(
        np.concatenate([found.vertices, still.vertices]),
        np.concatenate([found.weights, still.weights]),
        np.concatenate([found.target, still.points]),
        np.concatenate([found.normal, still.normals]),
        np.concatenate([found.confidence, np.full(len(idle), confidence)]),
        np.concatenate([found.model, idle]),
        np.concatenate([found.image, np.full(len(idle), -1)]),
    )
