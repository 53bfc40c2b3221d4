"""The own min-cut against scipy's maximum flow, and the random field against enumeration."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from perfcap.segment.min_cut import DIRECTIONS, MinCut, solve_min_cut
from perfcap.segment.random_field import BandField, Smoothness, solve_field
from perfcap.segment.trimap import FOREGROUND, PROBABLE_BACKGROUND, Trimap


def grid(rng, height, width, largest):
    """Eight-connected nodes with random symmetric capacities."""
    padded = np.full((height + 2, width + 2), -1, np.int32)
    padded[1:-1, 1:-1] = np.arange(height * width).reshape(height, width)
    shifted = [padded[1 + y : 1 + y + height, 1 + x : 1 + x + width] for y, x in DIRECTIONS]
    neighbor = np.stack([plane.ravel() for plane in shifted], 1)
    capacity = np.zeros_like(neighbor)
    for direction in range(4):
        linked = neighbor[:, direction] >= 0
        flow = rng.integers(0, largest, linked.sum())
        capacity[linked, direction] = flow
        capacity[neighbor[linked, direction], 7 - direction] = flow
    return neighbor, capacity


def oracle(neighbor, capacity, excess):
    """The source's side of the least cut by scipy, and the flow."""
    size = len(excess)
    node, direction = np.nonzero(capacity)
    sources, sinks = np.nonzero(excess > 0)[0], np.nonzero(excess < 0)[0]
    rows = np.concatenate([node, np.full(len(sources), size), sinks])
    columns = np.concatenate([neighbor[node, direction], sources, np.full(len(sinks), size + 1)])
    values = np.concatenate([capacity[node, direction], excess[sources], -excess[sinks]])
    graph = coo_matrix((values.astype(np.int32), (rows, columns)), (size + 2, size + 2)).tocsr()
    result = maximum_flow(graph, size, size + 1)
    left = graph - result.flow
    left.data = (left.data > 0).astype(np.int32)
    left.eliminate_zeros()
    reached = np.zeros(size + 2, bool)
    reached[breadth_first_order(left, size, return_predecessors=False)] = True
    return reached[:size], result.flow_value


@pytest.mark.parametrize("largest", [1, 2, 10, 1000])
def test_equals_maximum_flow_on_random_grids(largest):
    rng = np.random.default_rng(largest)
    for _ in range(25):
        neighbor, capacity = grid(rng, *rng.integers(1, 9, 2), largest)
        excess = rng.integers(-3 * largest, 3 * largest + 1, len(neighbor)).astype(np.int32)
        excess[rng.random(len(excess)) < 0.3] = 0
        labels, flow = solve_min_cut(neighbor, capacity, excess)
        expected, expected_flow = oracle(neighbor, capacity, excess)
        assert flow == expected_flow
        np.testing.assert_array_equal(labels, expected)


def test_long_thin_grid_with_both_ends_pulling():
    neighbor, capacity = grid(np.random.default_rng(0), 2, 400, 30)
    excess = np.zeros(len(neighbor), np.int32)
    excess[0], excess[-1] = 10_000, -10_000
    labels, flow = solve_min_cut(neighbor, capacity, excess)
    expected, expected_flow = oracle(neighbor, capacity, excess)
    assert flow == expected_flow
    np.testing.assert_array_equal(labels, expected)


def test_arguments_are_left_alone_and_nothing_is_a_problem():
    neighbor, capacity = grid(np.random.default_rng(1), 5, 5, 10)
    excess = np.arange(-12, 13, dtype=np.int32)
    before = capacity.copy(), excess.copy()
    solve_min_cut(neighbor, capacity, excess)
    np.testing.assert_array_equal(capacity, before[0])
    np.testing.assert_array_equal(excess, before[1])
    labels, flow = solve_min_cut(
        np.zeros((0, 8), np.int32), np.zeros((0, 8), np.int32), np.zeros(0, np.int32)
    )
    assert labels.shape == (0,)
    assert flow == 0


def field_energy(trimap, image, evidence, smoothness, motion, foreground):
    """The energy in the module's docstring, term by term."""
    height, width = trimap.labels.shape
    pairs = [
        ((r, c), (r + y, c + x), np.hypot(y, x))
        for r in range(height)
        for c in range(width)
        for y, x in DIRECTIONS[4:]
        if 0 <= r + y < height and 0 <= c + x < width
    ]
    pairs = [p for p in pairs if trimap.band[p[0]] or trimap.band[p[1]]]
    squared = [float(((image[a] - image[b]) ** 2).sum()) for a, b, _ in pairs]
    total = -float((evidence * foreground)[trimap.band].sum())
    for (a, b, length), difference in zip(pairs, squared, strict=True):
        if foreground[a] != foreground[b]:
            value = smoothness.contrast * np.exp(-difference / (2 * np.mean(squared)))
            value += smoothness.temporal * np.exp(-(max(motion[a], motion[b]) ** 2))
            total += value / length
    return total


def test_field_has_least_energy_of_all_labellings():
    rng = np.random.default_rng(3)
    smoothness = Smoothness(contrast=1.0, temporal=0.7)
    for _ in range(5):
        labels = np.full((3, 3), PROBABLE_BACKGROUND, np.uint8)
        labels[0, 0], labels[2, 2] = FOREGROUND, 0
        whole = (slice(0, 3), slice(0, 3))
        trimap = Trimap(labels, np.zeros((3, 3), np.float32), whole, (3, 3), 3.0, 1.0, 1.0)
        image = rng.uniform(0, 30, (3, 3, 3)).astype(np.float32)
        evidence = rng.normal(scale=1.5, size=(3, 3)).astype(np.float32)
        motion = rng.uniform(0, 2, (3, 3)).astype(np.float32)
        found = solve_field(trimap, image, evidence, smoothness, motion)
        energy = field_energy(trimap, image, evidence, smoothness, motion, found)
        foreground = labels == FOREGROUND
        best = np.inf
        for choice in itertools.product((False, True), repeat=int(trimap.band.sum())):
            foreground[trimap.band] = choice
            best = min(best, field_energy(trimap, image, evidence, smoothness, motion, foreground))
        assert energy == pytest.approx(best, abs=0.1)  # capacities are 1/256 nat
        assert (found[labels == FOREGROUND]).all()
        assert not (found[labels == 0]).any()


@pytest.mark.parametrize("largest", [1, 10, 1000])
def test_a_cut_asked_again_is_that_of_the_last_question(largest):
    rng = np.random.default_rng(largest)
    for _ in range(10):
        neighbor, capacity = grid(rng, *rng.integers(1, 9, 2), largest)
        cut = MinCut(neighbor, capacity)
        for _ in range(4):
            excess = rng.integers(-3 * largest, 3 * largest + 1, len(neighbor)).astype(np.int32)
            excess[rng.random(len(excess)) < 0.3] = 0
            np.testing.assert_array_equal(cut.solve(excess), oracle(neighbor, capacity, excess)[0])


def test_a_field_asked_again_and_a_band_in_a_corner():
    rng = np.random.default_rng(5)
    labels = np.zeros((40, 50), np.uint8)
    labels[25:, 30:] = PROBABLE_BACKGROUND
    labels[32:, 38:] = FOREGROUND
    whole = slice(0, 40), slice(0, 50)
    trimap = Trimap(labels, np.zeros((40, 50), np.float32), whole, (40, 50), 20.0, 4.0, 4.0)
    image = rng.uniform(0, 60, (40, 50, 3)).astype(np.float32)
    motion = rng.uniform(0, 2, (40, 50)).astype(np.float32)
    field = BandField(trimap, image, Smoothness(), motion)
    for _ in range(3):
        evidence = rng.normal(scale=9, size=(40, 50)).astype(np.float32)
        found = field.solve(evidence)
        assert found[25:, 30:].mean() not in (0, 1)
        assert not found[:25].any() and found[labels == FOREGROUND].all()
        once = solve_field(trimap, image, evidence, Smoothness(), motion)
        np.testing.assert_array_equal(found, once)
        # what is not open, and has no open neighbour, has no say
        other = image.copy()
        other[:23] = 7
        np.testing.assert_array_equal(
            solve_field(trimap, other, evidence, Smoothness(), motion), once
        )


def test_a_field_without_anything_open():
    labels = np.zeros((6, 7), np.uint8)
    labels[2:4] = FOREGROUND
    whole = slice(0, 6), slice(0, 7)
    trimap = Trimap(labels, np.zeros((6, 7), np.float32), whole, (6, 7), 2.0, 1.0, 1.0)
    nothing = np.zeros((6, 7), np.float32)
    found = solve_field(trimap, np.zeros((6, 7, 3), np.float32), nothing, Smoothness(), nothing)
    np.testing.assert_array_equal(found, labels == FOREGROUND)
