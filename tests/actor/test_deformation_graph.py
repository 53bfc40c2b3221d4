"""The graph of small meshes that are hard, and of whole characters."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perfcap.actor import Deformation, DeformationGraph
from perfcap.actor.graph_sampling import fall_off
from perfcap.errors import InputError
from perfcap.geometry.folding import find_folds
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.geometry.surface_topology import surface_topology
from perfcap.io.gltf_read import load_template

F64 = torch.float64
ROOT = Path(__file__).parents[2]
CHARACTERS = {
    "demo": ROOT / "models/actors/sam/actor.glb",
    "skirt": ROOT / "../shared/data/rendered/dev_skirt/template.glb",
}


def sheet(points, rings, around, closed):
    """Grid of (rings, around) points as a mesh; ``closed`` joins the last column to the first."""
    index = np.arange(rings * around).reshape(rings, around)
    if closed:
        index = np.concatenate((index, index[:, :1]), 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack((np.stack((a, b, c), -1), np.stack((a, c, d), -1)), 2)
    return np.asarray(points).reshape(-1, 3), faces.reshape(-1, 3)


def tube(radii, heights, around=24):
    angle = np.arange(around) * 2 * np.pi / around
    points = [[(r * np.cos(a), h, r * np.sin(a)) for a in angle]
              for r, h in zip(radii, heights, strict=True)]  # fmt: skip
    return sheet(points, len(heights), around, closed=True)


def joined(*meshes):
    sizes = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    vertices = np.concatenate([vertices for vertices, _ in meshes])
    return vertices, np.concatenate([f + n for (_, f), n in zip(meshes, sizes[:-1], strict=True)])


def dressed():
    """A leg in a flared skirt that fits at the top and hangs free below."""
    heights = np.linspace(0, 1, 21)
    leg = tube(np.full(21, 0.10), heights)
    return joined(leg, tube(0.11 + 0.12 * (1 - heights[8:]), heights[8:]))


@cache
def character(name):
    path = CHARACTERS[name]
    if not path.exists():
        pytest.skip(f"no {name} template beside the checkout")
    template = load_template(path)
    return template, DeformationGraph.build(template.vertices, template.faces)


def random_deformation(lead, nodes, size=0.3, dtype=F64):
    random = torch.Generator().manual_seed(4)
    return Deformation(*(size * torch.randn((2, *lead, nodes, 3), generator=random, dtype=dtype)))


def rigid(graph, posed, turn, shift):
    """All nodes in one rigid motion about the origin, (F, 3) each, and where points go."""
    rotation = rotvec_to_matrix(turn)
    nodes = graph.nodes(posed)
    moved = nodes @ rotation.mT + shift
    expected = posed @ rotation.mT + shift
    return Deformation(turn[:, None].expand_as(nodes), moved - nodes), expected


def assert_sound(graph, vertices, faces):
    """What every graph must satisfy, whatever the mesh."""
    size, edges = len(graph), graph.edges.numpy()
    weights = graph.influence_weights
    assert torch.isfinite(weights).all()
    assert (weights >= 0).all()
    torch.testing.assert_close(weights.sum(1), torch.ones(len(vertices), dtype=weights.dtype))
    assert (weights[:, :-1] >= weights[:, 1:]).all()
    assert 0 <= graph.influences.min() <= graph.influences.max() < size
    assert (graph.radius > 0).all()
    assert len(graph.node_vertex.unique()) == size
    assert {tuple(e) for e in edges} == {(j, i) for i, j in edges}
    assert len({tuple(e) for e in edges}) == len(edges)
    assert (edges[:, 0] != edges[:, 1]).all() if len(edges) else True
    joins = coo_array((np.ones(len(edges)), edges.T), shape=(size, size))
    assert connected_components(joins, directed=False)[0] == 1
    place = surface_topology(vertices, faces).place
    first = np.unique(place, return_index=True)[1][place]
    assert torch.equal(graph.influences, graph.influences[first])
    assert torch.equal(weights, weights[first])


@pytest.mark.long
@pytest.mark.parametrize("name", list(CHARACTERS))
def test_graph_of_a_character(name):
    template, graph = character(name)
    assert_sound(graph, template.vertices, template.faces)
    assert len(graph) == 1000
    degree = torch.bincount(graph.edges[:, 0]).float()
    assert degree.min() >= 3
    assert 5.5 < degree.mean() < 6.5
    assert graph.radius.quantile(0.95) < 2 * graph.radius.quantile(0.05)
    parts = surface_topology(template.vertices, template.faces)
    with_nodes = parts.component[parts.place[graph.node_vertex.numpy()]]
    assert set(with_nodes) == set(range(parts.components))


def test_nodes_are_shared_by_area():
    template, graph = character("skirt")
    parts = surface_topology(template.vertices, template.faces)
    on_skirt = (parts.component[parts.place[graph.node_vertex.numpy()]] == 1).mean()
    assert on_skirt == pytest.approx(1.198 / (1.198 + 1.873), abs=0.03)


def test_skirt_hangs_by_its_waist():
    template, graph = character("skirt")
    parts = surface_topology(template.vertices, template.faces)
    nodes = graph.node_vertex.numpy()
    part, height = parts.component[parts.place[nodes]], template.vertices[nodes, 1]
    i, j = graph.edges.numpy().T
    bridges = part[i] != part[j]
    assert bridges.sum() > 2 * 12
    assert height[i[bridges]].min() > 1.0


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_identity_returns_the_posed_vertices(dtype):
    template, graph = character("demo")
    vertices = torch.tensor(template.vertices, dtype=dtype)
    graph = DeformationGraph.build(vertices, template.faces)
    posed = torch.stack((vertices, vertices + 5))
    assert torch.equal(graph(posed, graph.identity(posed)), posed)


def test_rigid_motion_of_the_nodes_is_one_of_the_surface():
    template, graph = character("demo")
    vertices = torch.tensor(template.vertices)
    posed = torch.stack((vertices, vertices.flip(-1)))
    turn = torch.tensor([[0.3, -2.0, 0.8], [0.0, 0.0, 0.0]], dtype=F64)
    deformation, expected = rigid(graph, posed, turn, torch.tensor([1.0, 2, 3], dtype=F64))
    torch.testing.assert_close(graph(posed, deformation), expected, rtol=0, atol=1e-13)


def test_build_is_deterministic_and_takes_tensors():
    vertices, faces = dressed()
    first = DeformationGraph.build(vertices, faces, 60)
    again = DeformationGraph.build(torch.tensor(vertices), torch.tensor(faces), 60)
    for name, buffer in first.named_buffers():
        assert torch.equal(buffer, again.get_buffer(name))


def test_forward_is_equation_15():
    vertices, faces = dressed()
    graph = DeformationGraph.build(vertices, faces, 40)
    posed = torch.tensor(vertices).expand(2, 3, -1, -1) + 0.4
    deformation = random_deformation((2, 3), len(graph))
    result = graph(posed, deformation)
    for b, f, v in ((0, 0, 5), (1, 2, 700), (1, 0, 411)):
        expected = torch.zeros(3, dtype=F64)
        for k, share in zip(graph.influences[v], graph.influence_weights[v], strict=True):
            g = posed[b, f, graph.node_vertex[k]]
            turn = rotvec_to_matrix(deformation.rotation[b, f, k])
            expected += share * (turn @ (posed[b, f, v] - g) + g + deformation.translation[b, f, k])
        torch.testing.assert_close(result[b, f, v], expected)
    alone = graph(posed[1], Deformation(deformation.rotation[1], deformation.translation[1]))
    torch.testing.assert_close(result[1], alone, rtol=0, atol=1e-14)


def test_forward_differentiates():
    vertices, faces = tube(np.full(2, 0.1), np.arange(2) * 0.1, 3)
    graph = DeformationGraph.build(vertices, faces, 3)
    posed = torch.tensor(vertices)[None]
    state = random_deformation((1,), len(graph))

    def moved(posed, rotation, translation):
        return graph(posed, Deformation(rotation, translation))

    for rotation in (state.rotation, torch.zeros_like(state.rotation)):
        inputs = (posed, rotation, state.translation)
        inputs = tuple(x.clone().requires_grad_() for x in inputs)
        assert torch.autograd.gradcheck(moved, inputs, check_forward_ad=True)


def test_sheets_that_face_each_other_are_not_coupled():
    """An arm beside the body: near through the air, far along the surface."""
    length = np.linspace(0, 1, 41)
    there = [[(x, y, 0.0) for x in np.linspace(0, 0.2, 9)] for y in length]
    back = [[(x, y, 0.03) for x in np.linspace(0, 0.2, 9)] for y in length[::-1]]
    vertices, faces = sheet(there + back, 82, 9, closed=False)
    graph = DeformationGraph.build(vertices, faces, 60)
    assert_sound(graph, vertices, faces)
    far = vertices[:, 1] < 0.7  # the sheets meet at the top
    nodes = vertices[graph.node_vertex.numpy()]
    other = nodes[graph.influences.numpy(), 2] != vertices[:, None, 2]
    assert (graph.influence_weights.numpy()[far] * other[far]).max() == 0
    i, j = graph.edges.numpy().T
    assert not ((nodes[i, 2] != nodes[j, 2]) & (nodes[i, 1] < 0.7)).any()


def test_hem_is_free_and_waist_is_not():
    vertices, faces = dressed()
    graph = DeformationGraph.build(vertices, faces, 120)
    assert_sound(graph, vertices, faces)
    nodes = graph.node_vertex.numpy()
    skirt = nodes >= 21 * 24
    i, j = graph.edges.numpy().T
    bridges = skirt[i] != skirt[j]
    assert bridges.any()
    assert vertices[nodes[i[bridges]], 1].min() > 0.75


def test_small_parts_are_held_by_three_nodes():
    body = tube(np.full(11, 0.1), np.linspace(0, 1, 11))
    button = (np.array([[0.11, 0.5, 0], [0.11, 0.51, 0], [0.11, 0.5, 0.01]]), np.array([[0, 1, 2]]))
    thread = (button[0] + [0.005, 0, 0], button[1])
    vertices, faces = joined(body, button, thread)
    graph = DeformationGraph.build(vertices, faces, 50)
    assert_sound(graph, vertices, faces)
    nodes = graph.node_vertex.numpy()
    for first in (len(body[0]), len(body[0]) + 3):
        own = np.flatnonzero((nodes >= first) & (nodes < first + 3))
        assert len(own) == 1
        assert (graph.edges[:, 0] == own[0]).sum() >= 3
        assert (graph.influences[first : first + 3, 0] == own[0]).all()


def test_parts_beyond_the_nodes_and_lone_vertices_ride_along():
    body = tube(np.full(5, 0.1), np.linspace(0, 0.4, 5))
    speck = np.array([[0.12, 0, 0], [0.13, 0, 0], [0.12, 0, 0.01]])
    rise = np.array([0, 0.4 / 30, 0])
    specks = [(speck + n * rise, np.array([[0, 1, 2]])) for n in range(30)]
    vertices, faces = joined(body, *specks)
    vertices = np.concatenate((vertices, [[0.0, 0.2, 0.11]]))
    graph = DeformationGraph.build(vertices, faces, 20)
    assert_sound(graph, vertices, faces)
    assert len(graph) == 20
    near = np.argmin(np.linalg.norm(vertices[:-1] - vertices[-1], axis=1))
    assert torch.equal(graph.influences[-1], graph.influences[near])
    posed = torch.tensor(vertices)[None]
    turn = torch.tensor([[0.0, 0.5, 0.0]], dtype=F64)
    deformation, expected = rigid(graph, posed, turn, torch.ones(3, dtype=F64))
    torch.testing.assert_close(graph(posed, deformation), expected)


@pytest.mark.parametrize(("nodes", "influences"), [(1, 1), (1, 6), (2, 4), (7, 1), (5000, 6)])
def test_extreme_sizes(nodes, influences):
    vertices, faces = dressed()
    graph = DeformationGraph.build(vertices, faces, nodes, influences)
    assert len(graph) == min(nodes, len(vertices))
    assert graph.influences.shape == (len(vertices), influences)
    if nodes > 2:
        assert_sound(graph, vertices, faces)
    posed = torch.tensor(vertices)[None]
    assert graph(posed, random_deformation((1,), len(graph))).isfinite().all()


def test_broken_meshes_give_sound_graphs():
    vertices, faces = dressed()
    random = np.random.default_rng(2)
    keep = random.random(len(faces)) > 0.05  # holes
    doubled = random.integers(0, len(faces), 40)  # non-manifold edges
    faces = np.concatenate((faces[keep], faces[doubled][:, ::-1], [[3, 3, 9], [0, 0, 0]]))
    torn, corners = vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    torn[faces.ravel() == 30] = torn[faces.ravel() == 31][0]  # triangles without area
    graph = DeformationGraph.build(torn, corners, 100)
    assert_sound(graph, torn, corners)


def test_one_triangle_is_a_graph():
    vertices = np.eye(3)
    graph = DeformationGraph.build(vertices, np.array([[0, 1, 2]]))
    assert_sound(graph, vertices, np.array([[0, 1, 2]]))


def test_influences_do_not_jump_along_an_edge():
    template, graph = character("demo")
    parts = surface_topology(template.vertices, template.faces)
    a, b = parts.representative[parts.edges].T
    dense = torch.zeros(len(template.vertices), len(graph), dtype=F64)
    dense.scatter_add_(1, graph.influences, graph.influence_weights)
    short = np.linalg.norm(template.vertices[a] - template.vertices[b], axis=1) < 0.002
    assert short.sum() > 200
    change = (dense[a[short]] - dense[b[short]]).abs().amax(1)
    assert change.quantile(0.99) < 0.1


def test_folds_of_a_torn_graph_are_found():
    vertices, faces = dressed()
    graph = DeformationGraph.build(vertices, faces, 120)
    posed = torch.tensor(vertices).expand(2, -1, -1)
    still = graph.identity(posed)
    shift = still.translation.clone()
    shift[1, 7] = 0.5
    folds = find_folds(posed, graph(posed, Deformation(still.rotation, shift)), torch.tensor(faces))
    assert folds.count[0] == 0
    assert folds.count[1] > 0


def test_fall_off_ends_at_the_weakest():
    weights = fall_off(np.array([0.0, 0.03, 0.06, np.inf]), np.full(4, 0.06))
    assert (np.diff(weights) < 0).all()
    assert weights[-1] == 0
    assert fall_off(np.array([0.0, 0.05, 0.08]), np.full(3, 0.06))[-1] == 0


def test_bad_input_is_refused():
    vertices, faces = dressed()
    with pytest.raises(InputError, match="none of three distinct corners"):
        DeformationGraph.build(vertices, np.zeros((4, 3), int))
    with pytest.raises(InputError, match="not finite"):
        DeformationGraph.build(np.where(vertices == 0, np.nan, vertices), faces)
    with pytest.raises(InputError, match="nodes is 0"):
        DeformationGraph.build(vertices, faces, 0)
    graph = DeformationGraph.build(vertices, faces, 10)
    posed = torch.tensor(vertices)[None]
    with pytest.raises(InputError, match="posed has shape"):
        graph(posed[:, :-1], graph.identity(posed))
    with pytest.raises(InputError, match="posed has shape"):
        graph(posed, Deformation.identity((2,), 10, posed))


def test_graphs_whose_numbers_do_not_fit_each_other() -> None:
    """Compiled loops read beyond the nodes and the vertices."""
    vertices, faces = tube([0.1] * 9, np.linspace(0, 1, 9), 12)
    whole = DeformationGraph.build(vertices, faces, nodes=12)
    names = "node_vertex", "edges", "influences", "influence_weights", "radius"
    parts = {name: getattr(whole, name) for name in names}
    for name, change, message in (
        ("influences", lambda x: x + 12, "influences names nodes"),
        ("influences", lambda x: x - 12, "influences names nodes"),
        ("node_vertex", lambda x: x + len(vertices), "node_vertex names vertices"),
        ("node_vertex", lambda x: x - len(vertices), "node_vertex names vertices"),
        ("node_vertex", lambda x: x[:3], r"radius has shape \(12,\), expected \(3\)"),
        ("edges", lambda x: x + 12, "edges names nodes"),
        ("radius", lambda x: x[:3], "radius has shape"),
        ("influence_weights", lambda x: 2 * x, "sum to one but for 1"),
        ("influence_weights", lambda x: torch.nan * x, "sum to one but for nan"),
    ):
        with pytest.raises(InputError, match=message):
            DeformationGraph(**parts | {name: change(parts[name])})
