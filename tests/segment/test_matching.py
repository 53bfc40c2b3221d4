"""Pairs of contours: right displacements where masks are right, no pairs where they are not."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.render.occluding_contour import ModelContour
from perfcap.segment.contour import Contour, extract_contour
from perfcap.segment.correspondence import Matches
from perfcap.segment.matching import Matching, match

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]
UNPRUNED = Matching(pruned=False)


def person(
    shift: tuple[float, float] = (0.0, 0.0), arm: float = 60.0, parts: str = "tharl"
) -> Mask:
    """Torso, head, two arms and legs of a person of 300 px in 320 x 400; ``arm`` in degrees."""
    mask = np.zeros((400, 320), np.uint8)
    scale = 16  # sub-pixel drawing

    def limb(start: tuple[float, float], end: tuple[float, float], width: int) -> None:
        ends = [
            tuple(int(scale * (p + s)) for p, s in zip(q, shift, strict=True)) for q in (start, end)
        ]
        cv2.line(mask, *ends, 1, width, cv2.LINE_8, 4)

    turn = np.radians(arm)
    hand = (200 + 90 * np.sin(turn), 140 + 90 * np.cos(turn))
    if "t" in parts:
        limb((160, 140), (160, 210), 70)
    if "h" in parts:
        limb((160, 70), (160, 100), 44)
    if "a" in parts:
        limb((190, 130), hand, 24)
    if "r" in parts:
        limb((130, 130), (60, 190), 24)
    if "l" in parts:
        limb((140, 220), (125, 340), 34)
        limb((180, 220), (205, 340), 34)
    return mask > 0


def seen_as(mask: Mask, step: int = 2) -> ModelContour:
    """The contour of a mask, in no order, as that of a model."""
    contour = extract_contour(mask)
    some = contour[np.random.default_rng(0).permutation(len(contour))[::step]]
    return of_points(some.points, some.normals)


def of_points(points: Floats, normals: Floats, outer: bool = True) -> ModelContour:
    count = len(points)
    vertices = np.stack([np.arange(count), np.arange(count) + 1], 1)
    weights = np.tile([0.75, 0.25], (count, 1))
    return ModelContour(points, normals, vertices, weights, np.full(count, outer))


def joined(*contours: ModelContour) -> ModelContour:
    names = ("points", "normals", "vertices", "weights", "outer")
    return ModelContour(*(np.concatenate([getattr(c, name) for c in contours]) for name in names))


def line(start: tuple[float, float], end: tuple[float, float], normal: tuple[float, float]):
    """Points along a straight contour."""
    count = int(np.hypot(end[0] - start[0], end[1] - start[1]) / 1.3)
    share = np.linspace(0, 1, count)[:, None]
    return np.array(start) * (1 - share) + np.array(end) * share, np.tile(normal, (count, 1)) * 1.0


def fitted_shift(model: ModelContour, pairs: Matches) -> Floats:
    """The translation that brings model points onto the lines of their pairs."""
    weight = np.sqrt(pairs.confidence)
    gap = ((pairs.target - model.points[pairs.model]) * pairs.normal).sum(1)
    shift, *_ = np.linalg.lstsq(pairs.normal * weight[:, None], gap * weight, rcond=None)
    return shift


def right(pairs: Matches, truth: Contour, tolerance: float = 2.0) -> NDArray[np.bool_]:
    """Which targets lie on the true contour."""
    apart = np.linalg.norm(pairs.target[:, None] - truth.points[None], axis=-1)
    return apart.min(1) < tolerance


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, 0.0), (-4.0, 2.5), (6.0, -8.0), (1.25, 9.0)])
def test_shift_is_recovered_along_the_normals(shift: tuple[float, float]) -> None:
    model = seen_as(person())
    pairs = match(model, extract_contour(person(shift)))
    assert len(pairs) > 0.4 * len(model)
    found = fitted_shift(model, pairs)
    for _ in range(3):  # the nearest point is not the same point; closer it nearly is
        moved = replace(model, points=model.points + found)
        found = found + fitted_shift(moved, match(moved, extract_contour(person(shift))))
    # OpenCV draws lines to whole pixels in part
    np.testing.assert_allclose(found, shift, atol=0.05 if float(sum(shift)).is_integer() else 0.25)


def test_equal_contours_pair_up_in_place() -> None:
    model, image = seen_as(person()), extract_contour(person())
    pairs = match(model, image)
    assert len(pairs) >= len(model) - 2  # a sharp corner has no neighbours to ask
    np.testing.assert_allclose(pairs.target, model.points[pairs.model])
    assert np.quantile(pairs.confidence, 0.1) > 0.95
    np.testing.assert_array_equal(pairs.vertices, model.vertices[pairs.model])
    np.testing.assert_array_equal(pairs.normal, image.normals[pairs.image])
    np.testing.assert_allclose(pairs.weights, model.weights[pairs.model])


def test_a_point_is_in_one_pair() -> None:
    pairs = match(seen_as(person()), extract_contour(person((5, 3), arm=70)))
    assert len(np.unique(pairs.model)) == len(pairs)
    assert len(np.unique(pairs.image)) == len(pairs)


def test_turned_arm_moves_as_a_whole() -> None:
    model, image = seen_as(person(arm=60)), extract_contour(person(arm=68))
    pairs = match(model, image)
    on_hand = model.points[pairs.model][:, 0] > 250
    assert on_hand.sum() > 20
    movement = (pairs.target - model.points[pairs.model])[on_hand]
    assert np.median(movement[:, 1]) < -5  # both sides go up


def test_result_does_not_depend_on_the_size_of_the_picture() -> None:
    model, image = seen_as(person()), extract_contour(person((4, 3), arm=66))
    settings = Matching(farthest=1e9)
    large = match(
        replace(model, points=3 * model.points), replace(image, points=3 * image.points), settings
    )
    small = match(model, image, settings)
    np.testing.assert_array_equal(large.model, small.model)
    np.testing.assert_allclose(large.confidence, small.confidence, atol=1e-9)


def test_mirrored_contours_have_mirrored_pairs() -> None:
    model, image = seen_as(person()), extract_contour(person((4, 3), arm=66))
    flip = np.array([-1.0, 1.0])
    mirrored = match(
        replace(model, points=model.points * flip, normals=model.normals * flip),
        replace(image, points=image.points * flip, normals=image.normals * flip),
    )
    plain = match(model, image)
    np.testing.assert_array_equal(mirrored.image, plain.image)
    np.testing.assert_allclose(mirrored.target, plain.target * flip)


def test_same_twice() -> None:
    model, image = seen_as(person()), extract_contour(person((4, 3), arm=66))
    once, again = match(model, image), match(model, image)
    np.testing.assert_array_equal(once.confidence, again.confidence)
    np.testing.assert_array_equal(once.image, again.image)


def test_confidence_is_that_of_the_image() -> None:
    model, mask = seen_as(person()), person((2, 1))
    plain = match(model, extract_contour(mask))
    column = np.tile(np.linspace(0, 1, mask.shape[1]), (mask.shape[0], 1))
    trusted = extract_contour(mask, column)
    weighted = match(model, trusted)
    np.testing.assert_array_equal(plain.model, weighted.model)
    np.testing.assert_allclose(
        weighted.confidence, plain.confidence * trusted.confidence[weighted.image]
    )
    assert len(match(model, extract_contour(mask, np.zeros(mask.shape)))) == 0


def test_far_contours_and_opposite_normals_have_no_pairs() -> None:
    model = seen_as(person())
    far = extract_contour(np.pad(person(), ((0, 0), (400, 0))))
    assert len(match(model, far)) == 0
    points, normals = line((50, 20), (50, 120), (-1.0, 0))
    wall, facing = of_points(points, normals), Contour(points, -normals, np.ones(len(points)))
    assert len(match(wall, facing)) == 0
    assert len(match(wall, replace(facing, normals=normals))) == len(wall)
    image = extract_contour(person())
    crooked = np.stack([-image.normals[:, 1], image.normals[:, 0]], 1)
    turned = np.sqrt(0.5) * (image.normals + crooked)  # 45 degrees
    assert len(match(model, replace(image, normals=turned), Matching(angle=20.0))) == 0


def test_distance_has_a_share_and_a_limit() -> None:
    model, image = seen_as(person()), extract_contour(person((9, 0)))
    longest = [
        np.linalg.norm(pairs.target - model.points[pairs.model], axis=1).max(initial=0)
        for pairs in (
            match(model, image),
            match(model, image, Matching(farthest=7.0)),
            match(model, image, Matching(distance=0.02)),
            match(model, image, size=60.0),
        )
    ]
    assert longest[0] > 8.5
    assert longest[1] <= 7
    assert longest[2] <= 0.02 * 320
    assert longest[3] <= 6


@pytest.mark.parametrize("adds", [True, False], ids=["too much", "too little"])
@pytest.mark.parametrize("share", [0.05, 0.15, 0.30])
def test_spoilt_contours_pull_at_nothing(share: float, adds: bool) -> None:
    truth = person((3, -2), arm=64)
    model, clean = seen_as(person()), extract_contour(truth)
    wrong = {"pruned": 0.0, "unpruned": 0.0}
    kept, possible = 0.0, 0.0
    for seed in range(3):
        image = extract_contour(spoilt(truth, share, adds, seed))
        for name, settings in (("pruned", Matching()), ("unpruned", UNPRUNED)):
            pairs = match(model, image, settings)
            good = right(pairs, clean)
            wrong[name] += pairs.confidence[~good].sum() / pairs.confidence.sum()
            if name == "pruned":
                kept += pairs.confidence[good].sum()
                possible += (1 - share) * match(model, clean).confidence.sum()
    assert wrong["pruned"] < max(0.5 * wrong["unpruned"], 0.03)
    assert kept > 0.75 * possible


def spoilt(mask: Mask, share: float, adds: bool, seed: int) -> Mask:
    """A lumpy band along a share of the outer contour, added or cut away."""
    rng = np.random.default_rng(seed)
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    chain = max(found, key=len)[:, 0]
    out = mask.astype(np.uint8)
    first = rng.integers(len(chain))
    for step in range(0, int(share * len(chain)), 5):
        x, y = chain[(first + step) % len(chain)]
        cv2.circle(out, (int(x), int(y)), int(rng.uniform(5, 11)), int(adds), -1)
    return out > 0


@pytest.mark.parametrize("missing", ["a", "r", "l", "h"])
def test_limb_cut_off_stays_where_it_is(missing: str) -> None:
    whole = "tharl"
    model = seen_as(person())
    image = extract_contour(person((2, 1), parts=whole.replace(missing, "")))
    pairs = match(model, image)
    good = right(pairs, extract_contour(person((2, 1))))
    assert pairs.confidence[~good].sum() < 0.02 * pairs.confidence.sum()
    unpruned = match(model, image, UNPRUNED)
    assert (~right(unpruned, extract_contour(person((2, 1))))).mean() > 0.03


def test_arm_held_before_the_torso_finds_the_one_that_sticks_out() -> None:
    body = person(parts="thrl")
    held = line((176, 140), (176, 200), (-1.0, 0.0))  # an arm's inner side; the torso ends at 195
    model = joined(seen_as(body), of_points(*held, outer=False))
    gap = line((202, 140), (202, 200), (-1.0, 0.0))  # the same, beside the torso
    image = joined_contour(extract_contour(body), Contour(*gap, np.ones(len(gap[0]))))
    pairs = match(model, image)
    inner = ~model.outer[pairs.model]
    assert inner.sum() > 10
    np.testing.assert_allclose(pairs.target[inner][:, 0], 202)
    one_way = match(model, image, Matching(both_ways=False))
    assert model.outer[one_way.model].all()
    assert len(one_way) > 200


def joined_contour(*contours: Contour) -> Contour:
    names = ("points", "normals", "confidence")
    return Contour(*(np.concatenate([getattr(c, name) for c in contours]) for name in names))


def test_limb_is_not_squeezed_through_itself() -> None:
    left, right_side = line((50, 20), (50, 120), (-1.0, 0)), line((62, 20), (62, 120), (1.0, 0))
    model = joined(of_points(*left), of_points(*right_side))
    # the mask ends behind the limb: another surface's edge faces the way its left side does
    beyond = line((70, 20), (70, 120), (-1.0, 0))
    alone = match(model, Contour(*beyond, np.ones(len(beyond[0]))), Matching(distance=0.3))
    assert len(alone) == 0
    # unless its other side moves along
    other = line((82, 20), (82, 120), (1.0, 0))
    both = joined_contour(
        Contour(*beyond, np.ones(len(beyond[0]))), Contour(*other, np.ones(len(other[0])))
    )
    assert len(match(model, both, Matching(distance=0.3))) > 100


def test_a_part_in_front_of_another_is_not_squeezed() -> None:
    """An arm of 12 px before the torso, whose edge is all that a mask without the arm shows."""
    arm, torso = line((50, 20), (50, 120), (-1.0, 0)), line((61, 20), (61, 120), (-1.0, 0))
    model, image = of_points(*arm), Contour(*torso, np.ones(len(torso[0])))
    wide = np.full(len(model), np.inf)
    settings = Matching(distance=0.3)
    assert len(match(model, image, settings, room=wide)) > 70
    assert len(match(model, image, settings, room=np.full(len(model), 12.0))) == 0
    # the way out is free, and so is a part as wide as that
    assert len(match(model, image, settings, room=np.full(len(model), 24.0))) > 70
    outward = Contour(*line((39, 20), (39, 120), (-1.0, 0)), np.ones(len(torso[0])))
    assert len(match(model, outward, settings, room=np.full(len(model), 12.0))) > 70


def test_what_has_no_pair_is_held() -> None:
    model, image = seen_as(person()), extract_contour(person((2, 1), parts="thrl"))
    free, held = match(model, image), match(model, image, Matching(hold=0.1))
    assert len(np.unique(held.model)) == len(held)
    np.testing.assert_array_equal(held.target[: len(free)], free.target)
    still = held.image < 0
    assert still.sum() == len(held) - len(free) > 20
    np.testing.assert_array_equal(held.target[still], model.points[held.model[still]])
    assert (held.confidence[still] == 0.1).all()
    hand = np.array([278, 185])  # of the arm that is cut off
    assert np.linalg.norm(model.points[held.model[still]] - hand, axis=1).min() < 12
    inner = replace(model, outer=np.zeros(len(model), bool))
    assert len(match(inner, image, Matching(hold=0.1))) == len(match(inner, image))


def test_unpruned_pairs_every_silhouette_point() -> None:
    model = joined(
        seen_as(person()), of_points(*line((160, 100), (160, 150), (1.0, 0)), outer=False)
    )
    image = extract_contour(np.roll(person(), 150, axis=0))
    pairs = match(model, image, UNPRUNED)
    np.testing.assert_array_equal(pairs.model, np.flatnonzero(model.outer))
    assert (pairs.confidence == 1).all()


@pytest.mark.parametrize("settings", [Matching(), UNPRUNED], ids=["pruned", "unpruned"])
def test_nothing_to_pair(settings: Matching) -> None:
    model, image = seen_as(person()), extract_contour(person())
    inner = replace(model, outer=np.zeros(len(model), bool))
    none = np.zeros(0, np.int64)
    for one, other in ((model[none], image), (model, image[none]), (model[none], image[none])):
        pairs = match(one, other, settings)
        assert len(pairs) == 0
        assert pairs.vertices.shape == pairs.target.shape == (0, 2)
    assert not model.outer[match(inner, image, settings).model].sum() or settings.pruned
    for few in (1, 2, 3):
        match(model[np.arange(few)], image, settings)
        match(model, image[np.arange(few)], settings)


@pytest.mark.parametrize("size", [0.0, -3.0, float("nan")])
def test_size_must_be_positive(size: float) -> None:
    with pytest.raises(InputError, match="expected the person's height"):
        match(seen_as(person()), extract_contour(person()), size=size)
