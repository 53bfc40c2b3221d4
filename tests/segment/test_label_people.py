"""Who is where in a foreground: colours, edges, order in depth."""

from dataclasses import replace

import numpy as np
import pytest
from disc_scene import disc, texture

from perfcap.segment import Footage, segment_block, survey
from perfcap.segment.label_people import PeopleLabels, label_people, near_each_other
from perfcap.segment.part_colors import PartColorSettings, learn_part_colors
from perfcap.segment.person_layer import PersonLayer

SIZE, FRAMES = 150, 11
COLORS = ((150, 40, 40), (250, 120, 110)), ((40, 50, 150), (120, 130, 250))


def layer(mask, depth, spread=3.0) -> PersonLayer:
    far = np.where(mask, np.float32(depth), np.float32(np.inf))
    return PersonLayer.of(far, np.where(mask, 0, -1), np.float32([spread]), 0.03)


def crossing(colors=COLORS, error=(3.0, -2.0), depths=(2.0, 3.0), seed=0):
    """Two discs that pass each other; images, true labels, and layers that are off by ``error``."""
    rng = np.random.default_rng(seed)
    wall = texture(rng, (SIZE, SIZE), (40, 90, 60), (120, 180, 150))
    coats = [texture(rng, (SIZE, 3 * SIZE), *each) for each in colors]
    images, truth, layers = [], [], []
    for frame in range(FRAMES):
        step = 8.0 * (frame - FRAMES // 2)
        centers = np.array([(75 + step, 70), (75 - step, 84)])
        image, labels = wall.copy(), np.zeros((SIZE, SIZE), np.uint8)
        for k in np.argsort(depths)[::-1]:
            mask = disc(centers[k], 24)
            left = round(SIZE - centers[k][0] + SIZE / 2)
            image[mask] = coats[k][:, left : left + SIZE][mask]
            labels[mask] = k + 1
        image += rng.normal(scale=1.5, size=image.shape)
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        truth.append(labels)
        drawn = [disc(c + s * np.array(error), 24) for c, s in zip(centers, (1, -1), strict=True)]
        layers.append([layer(m, z) for m, z in zip(drawn, depths, strict=True)])
    return np.array(images), np.array(truth), layers


def solved(images, layers, wanted, colors=True) -> list[PeopleLabels]:
    models = [np.stack([each.mask for each in row]) for row in layers]
    bones = np.zeros((FRAMES, len(layers[0]), 1, 2, 2))
    bones[:] = np.nan
    scene = survey(images, models)
    assert scene.plate is not None
    known = learn_part_colors(zip(images, layers, strict=True)) if colors else ()
    found = segment_block(Footage(list(images), models, bones), wanted, scene)
    return [label_people(one, layers[i], known) for i, one in zip(wanted, found, strict=True)]


@pytest.mark.parametrize("depths", [(2.0, 3.0), (3.0, 2.0)])
def test_the_nearer_is_in_front_and_edges_are_the_images(depths) -> None:
    images, truth, layers = crossing(depths=depths)
    for index, found in zip(range(3, 8), solved(images, layers, range(3, 8)), strict=True):
        there = truth[index] > 0
        right = found.labels == truth[index]
        assert right[there].mean() > 0.97
        assert (found.labels > 0)[~there].mean() < 0.01
        # better than where models put people
        ahead = [layers[index][k].mask for k in np.argsort(depths)]
        guess = np.where(ahead[0], np.argsort(depths)[0] + 1, 0)
        guess = np.where(~ahead[0] & ahead[1], np.argsort(depths)[1] + 1, guess)
        assert right[there].mean() > (guess == truth[index])[there].mean() + 0.01


def test_alike_people_are_told_apart_by_shape() -> None:
    images, truth, layers = crossing((COLORS[0], COLORS[0]), error=(1.5, 1.0))
    for index, found in zip(range(3, 8), solved(images, layers, range(3, 8)), strict=True):
        there = truth[index] > 0
        assert (found.labels == truth[index])[there].mean() > 0.94


def test_colors_help() -> None:
    images, truth, layers = crossing(error=(5.0, -4.0))
    scores = [
        np.mean([
            (found.labels == truth[i])[truth[i] > 0].mean()
            for i, found in zip(range(3, 8), solved(images, layers, range(3, 8), c), strict=True)
        ])
        for c in (True, False)
    ]  # fmt: skip
    assert scores[0] > scores[1] + 0.005


def test_one_person_is_the_cut_itself() -> None:
    images, _, layers = crossing()
    alone = [row[:1] for row in layers]
    models = [row[0].mask for row in alone]
    scene = survey(images, models)
    footage = Footage(
        list(images), [m[None] for m in models], np.full((FRAMES, 1, 1, 2, 2), np.nan)
    )
    for index, found in zip(range(4, 6), segment_block(footage, range(4, 6), scene), strict=True):
        labels = label_people(found, alone[index], ())
        np.testing.assert_array_equal(labels.labels, found.mask)
        assert len(labels.people) == 1 and labels.people[0] is found


def test_borders_belong_to_the_nearer() -> None:
    images, _, layers = crossing()
    (found,) = solved(images, layers, range(4, 5))
    labels = found.labels[found.box]
    assert set(np.unique(labels)) >= {1, 2}
    # the first is ahead wherever the second is seen, and not the other way round
    assert (found.ahead[0][labels == 2] > 0.95).all() and (found.ahead[1][labels == 1] < 0.05).all()
    assert (found.ahead[:, labels == 0] == 1).all()
    for number, alone in enumerate(found.people, 1):
        np.testing.assert_array_equal(alone.mask, found.labels == number)
        inside = alone.evidence[alone.mask[alone.trimap.box]]
        others = alone.evidence[(found.labels == 3 - number)[alone.trimap.box]]
        assert np.median(inside) > 0 > np.median(others)


def test_people_outside_the_image_get_nothing() -> None:
    images, truth, layers = crossing()
    gone = [[row[0], layer(np.zeros((SIZE, SIZE), bool), 3.0)] for row in layers]
    (found,) = solved(images, gone, range(1, 2))
    assert set(np.unique(found.labels)) == {0, 1}
    assert not found.people[1].report.person and not found.people[1].mask.any()
    there = truth[1] == 1
    assert (found.labels == 1)[there].mean() > 0.97


def test_colors_are_learnt_where_nobody_else_is() -> None:
    images, _, layers = crossing()
    one, other = learn_part_colors(zip(images, layers, strict=True))
    settings = PartColorSettings()
    red, blue = np.float32([[200, 80, 75]]), np.float32([[80, 90, 200]])
    part = np.zeros(1, int)
    for colors, own, else_ in ((one, red, blue), (other, blue, red)):
        assert colors.log_density(own, part, settings) > colors.log_density(else_, part, settings)
    # hidden all the time: nothing is learnt, and nothing said
    behind = [[row[0], replace(row[0], depth=row[0].depth + 1)] for row in layers]
    nobody = learn_part_colors(zip(images, behind, strict=True))[1]
    assert nobody.whole is None
    assert nobody.log_density(red, part, settings) == nobody.log_density(blue, part, settings)


@pytest.mark.parametrize(("gap", "near"), [(0, True), (9, True), (12, False)])
def test_people_are_near_within_reach(gap: int, near: bool) -> None:
    labels = np.zeros((40, 80), np.uint8)
    labels[10:30, 10:30] = 1
    labels[10:30, 30 + gap : 50 + gap] = 2
    assert near_each_other(labels, (1, 2), 10.0) == near
    labels[labels == 2] = 3  # the others do not matter
    assert near_each_other(labels, (1, 3), 10.0) == near
    assert not near_each_other(labels, (1,), 10.0)


def test_somebody_who_is_not_seen_is_near() -> None:
    labels = np.zeros((40, 80), np.uint8)
    labels[10:30, 10:30] = 1
    assert near_each_other(labels, (1, 2), 10.0)
    assert not near_each_other(labels, (2,), 10.0) and not near_each_other(labels, (), 10.0)
