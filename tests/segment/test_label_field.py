"""Several labels: expansions of least energy."""

from itertools import product

import numpy as np
import pytest

from perfcap.errors import InputError
from perfcap.segment.label_field import FieldSettings, LabelField


def field(rng, shape=(3, 3), labels=3, settings=None, open_=None):
    image = rng.uniform(0, 255, (*shape, 3)).astype(np.float32)
    nats = rng.uniform(0, 6, (labels, *shape)).astype(np.float32)
    chosen = np.ones(shape, bool) if open_ is None else open_
    return LabelField.of(image, nats, chosen, settings or FieldSettings(2.0, 0.7)), nats, image


def cheapest(model: LabelField, start, count):
    """The least energy of all labellings that keep what is not open."""
    rows, columns = np.nonzero(model.open)
    best = np.inf
    for values in product(range(count), repeat=len(rows)):
        labels = start.copy()
        labels[rows, columns] = values
        best = min(best, model.energy(labels))
    return best


@pytest.mark.parametrize("seed", range(6))
def test_two_labels_have_the_least_energy_of_all(seed) -> None:
    rng = np.random.default_rng(seed)
    open_ = rng.random((3, 4)) < 0.8
    model, _, _ = field(rng, (3, 4), 2, open_=open_)
    start = rng.integers(0, 2, (3, 4)).astype(np.uint8)
    found = model.solve(start)
    assert model.energy(found) == pytest.approx(cheapest(model, start, 2))
    np.testing.assert_array_equal(found[~open_], start[~open_])


@pytest.mark.parametrize("seed", range(6))
def test_no_change_to_one_label_is_left(seed) -> None:
    rng = np.random.default_rng(seed)
    model, _, _ = field(rng)
    found = model.solve(rng.integers(0, 3, (3, 3)).astype(np.uint8))
    energy = model.energy(found)
    for label in range(3):
        for chosen in product((False, True), repeat=9):
            other = np.where(np.reshape(chosen, (3, 3)), np.uint8(label), found)
            assert energy <= model.energy(other) + 1e-9
    assert energy <= cheapest(model, found, 3) * 1.5 + 1e-9


def test_energy_is_that_of_the_paper() -> None:
    rng = np.random.default_rng(3)
    settings = FieldSettings(contrast=3.0, potts=0.25)
    model, nats, image = field(rng, (4, 5), 3, settings)
    labels = rng.integers(0, 3, (4, 5)).astype(np.uint8)
    pairs, total = [], 0.0
    for r, c, (dr, dc) in product(range(4), range(5), ((0, 1), (1, -1), (1, 0), (1, 1))):
        if r + dr < 4 and 0 <= c + dc < 5:
            pairs.append(((r, c), (r + dr, c + dc), np.hypot(dr, dc)))
    squared = [float(((image[a] - image[b]) ** 2).sum()) for a, b, _ in pairs]
    for (a, b, length), square in zip(pairs, squared, strict=True):
        if labels[a] != labels[b]:
            total += (3.0 * np.exp(-square / (2 * np.mean(squared))) + 0.25) / length
    above = nats - nats.min(0)
    total += float(np.take_along_axis(above, labels[None].astype(int), 0).sum())
    assert model.energy(labels) == pytest.approx(total, abs=0.2)


def test_without_neighbours_each_pixel_has_its_cheapest_label() -> None:
    rng = np.random.default_rng(0)
    model, nats, _ = field(rng, (7, 8), 4, FieldSettings(0.0, 0.0))
    found = model.solve(np.zeros((7, 8), np.uint8))
    np.testing.assert_array_equal(found, nats.argmin(0))


def test_forbidden_labels_are_not_taken() -> None:
    rng = np.random.default_rng(1)
    image = np.zeros((6, 6, 3), np.float32)
    nats = rng.uniform(0, 1, (3, 6, 6)).astype(np.float32)
    nats[2] = np.inf
    model = LabelField.of(image, nats, np.ones((6, 6), bool))
    assert (model.solve(np.zeros((6, 6), np.uint8)) < 2).all()


def test_arrays_must_fit() -> None:
    image, nats = np.zeros((4, 4, 3), np.float32), np.zeros((2, 4, 4), np.float32)
    with pytest.raises(InputError, match="expected"):
        LabelField.of(image, nats, np.ones((4, 5), bool))
    nats[0, 0, 0] = np.nan
    with pytest.raises(InputError, match="not numbers"):
        LabelField.of(image, nats, np.ones((4, 4), bool))


def test_a_field_without_labels() -> None:
    """It ended in a traceback."""
    with pytest.raises(InputError, match="there are no labels"):
        field(np.random.default_rng(0), labels=0)
    open_, links = np.ones((3, 3), bool), np.zeros((3, 3, 4), np.int32)
    with pytest.raises(InputError, match="there are no labels"):
        LabelField(open_, np.zeros((0, 3, 3), np.int32), links)
