"""Points that a deformation graph carries."""

from __future__ import annotations

import pytest
import torch
from tiny_graph import VERTICES, posed_strip, random_deformation, tiny_graph

from perfcap.actor import Deformation, EmbeddedPoints, _embedded_points_torch
from perfcap.errors import InputError
from perfcap.solve import Step


def some_points(batch=(), frames=2, count=11, seed=0):
    random = torch.Generator().manual_seed(seed)
    corners = torch.randint(0, VERTICES, (*batch, frames, count, 2), generator=random)
    corners[..., 0, :] = 7  # both corners at one vertex
    share = torch.rand(*batch, frames, count, 1, generator=random, dtype=torch.float64)
    weights = torch.cat((share, 1 - share), -1)
    weights[..., -1, :] = 0  # as padding
    return corners, weights


@pytest.fixture
def points():
    corners, weights = some_points((2,))
    return EmbeddedPoints(tiny_graph(), posed_strip((2,)), corners, weights)


def test_points_are_those_of_the_deformed_surface(points):
    state = random_deformation((2,))
    surface = tiny_graph()(posed_strip((2,)), state)
    corners, weights = some_points((2,))
    slots = corners.flatten(-2).unsqueeze(-1).expand(-1, -1, -1, 3)
    picked = surface.gather(-2, slots).unflatten(-2, (-1, 2))
    expected = (weights.unsqueeze(-1) * picked).sum(-2)
    torch.testing.assert_close(points(state), expected)
    torch.testing.assert_close(points.linearize_blocks(state)[0], expected)


def test_derivative_against_differences(points):
    state = random_deformation((2,))
    _, blocks, derivative = points.linearize_blocks(state)
    nodes = state.nodes
    whole = derivative.new_zeros(*derivative.shape[:3], 3, nodes + 1, 6)
    for slot in range(blocks.shape[-1]):
        place = blocks[..., slot, None, None, None].expand(-1, -1, -1, 3, 1, 6) % (nodes + 1)
        whole.scatter_add_(-2, place, derivative[..., slot, :, None, :])
    assert not whole[..., nodes, :].any()
    step = 1e-6
    for unknown in range(state.frame_dim):
        tangent = torch.zeros(2, 2, state.frame_dim, dtype=torch.float64)
        tangent[..., unknown] = step
        none = tangent.new_zeros(2, 0)
        after, before = (points(state.retract(Step(s * tangent, none))) for s in (1, -1))
        closed = whole[..., unknown // 6, unknown % 6]
        torch.testing.assert_close(closed, (after - before) / (2 * step), rtol=0, atol=1e-8)


def test_a_node_is_seen_once(points):
    _, blocks, derivative = points.linearize_blocks(random_deformation((2,)))
    for seen in blocks.flatten(0, -2):
        used = seen[seen >= 0]
        assert len(used.unique()) == len(used)
    assert not derivative[blocks < 0].any()
    assert (blocks[..., -1, :] == -1).all()
    assert (blocks >= 0).sum(-1).amax() == blocks.shape[-1]


def test_derivative_along_directions(points):
    state = random_deformation((2,))
    directions = torch.randn(2, 2, 11, 2, 3, dtype=torch.float64)
    _, _, whole = points.linearize_blocks(state)
    _, _, along = points.linearize_blocks(state, directions)
    torch.testing.assert_close(along, directions.unsqueeze(-3) @ whole)


def test_compiled_equals_plain_torch(points):
    state = random_deformation((2,))
    embedding, directions = points._embedding(), torch.randn(2, 2, 11, 2, 3, dtype=torch.float64)
    plain = _embedded_points_torch.linearize(embedding, state, directions)
    found, _, derivative = points.linearize_blocks(state, directions)
    torch.testing.assert_close((found, derivative), plain, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(points(state), plain[0], rtol=1e-12, atol=1e-12)


def test_compiled_merge_equals_plain_torch(points):
    graph = tiny_graph()
    corners, weights = some_points((2,))
    given = graph, graph.influence_weights, posed_strip((2,)), corners, weights
    plain = _embedded_points_torch.merge(*given)
    for found, expected in zip(points._embedding(), plain, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-12)


def test_batch_equals_loop(points):
    state = random_deformation((2,))
    corners, weights = some_points((2,))
    for b in range(2):
        alone = EmbeddedPoints(tiny_graph(), posed_strip((2,))[b], corners[b], weights[b])
        own = Deformation(state.rotation[b], state.translation[b])
        torch.testing.assert_close(points(state)[b], alone(own))


def test_corners_may_be_shared_by_frames():
    corners, weights = some_points(frames=1)
    graph, posed, state = tiny_graph(), posed_strip(), random_deformation()
    shared = EmbeddedPoints(graph, posed, corners[0], weights[0])(state)
    repeated = EmbeddedPoints(graph, posed, corners.expand(2, -1, -1), weights.expand(2, -1, -1))
    torch.testing.assert_close(shared, repeated(state))


def test_gradient_reaches_posed_and_deformation():
    posed = posed_strip().requires_grad_()
    corners, weights = some_points()
    state = random_deformation()
    rotation = state.rotation.requires_grad_()
    points = EmbeddedPoints(tiny_graph(), posed, corners, weights)
    total = points(Deformation(rotation, state.translation)).square().sum()
    gradients = torch.autograd.grad(total, (posed, rotation))
    assert all(bool(g.isfinite().all() and g.any()) for g in gradients)


def test_no_points_at_all():
    corners = torch.zeros(2, 0, 2, dtype=torch.int64)
    points = EmbeddedPoints(tiny_graph(), posed_strip(), corners, torch.zeros(2, 0, 2))
    assert points(random_deformation()).shape == (2, 0, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"posed": torch.zeros(2, 5, 3)}, "graph deforms 18 vertices"),
        ({"corners": torch.full((2, 11, 2), 18)}, "surface has 18 vertices"),
        ({"weights": torch.zeros(2, 11, 3)}, "of one shape"),
        ({"posed": posed_strip(frames=3)}, r"give corners \(3, 11, 2\)"),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    corners, weights = some_points()
    given = {"posed": posed_strip(), "corners": corners, "weights": weights} | change
    with pytest.raises(InputError, match=message):
        EmbeddedPoints(tiny_graph(), **given)


def test_deformations_and_directions_of_something_else_are_refused(points):
    """Compiled loops wrote beyond the end of arrays, and the process died."""
    good = random_deformation((2,))
    for part in ((slice(1),), (slice(None), slice(1)), (slice(None), slice(None), slice(2))):
        other = Deformation(good.rotation[part], good.translation[part])
        for call in (points, points.linearize_blocks):
            with pytest.raises(InputError, match="deformation has shape"):
                call(other)
    for shape in ((2, 1, 11, 1, 3), (2, 2, 4, 1, 3), (2, 2, 11, 1, 2)):
        with pytest.raises(InputError, match="directions have shape"):
            points.linearize_blocks(good, torch.zeros(shape, dtype=torch.float64))
