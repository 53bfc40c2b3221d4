"""The rigidity of deformation graphs."""

from __future__ import annotations

import pytest
import torch
from checks import check_energy
from tiny_graph import NODES, posed_strip, random_deformation, tiny_graph

from perfcap.actor.deformation import Deformation
from perfcap.energy import Rigidity, _rigidity_numba, _rigidity_torch
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.solve import (
    BlockLinearization,
    Energy,
    GemanMcClure,
    LevenbergMarquardt,
    Objective,
    Residual,
    Status,
    TruncatedNewton,
    solve,
)
from perfcap.solve.coarse_space import CoarseSpace
from perfcap.solve.sparse_problem import SparseProblem


def rigid(nodes, rotation, translation):
    """All nodes turned and moved as one body."""
    turn = rotvec_to_matrix(rotation)
    moved = nodes @ turn.mT + translation
    return Deformation(rotation.expand_as(nodes).clone(), moved - nodes)


@pytest.fixture
def graph():
    return tiny_graph()


def test_checks(graph):
    nodes = graph.nodes(posed_strip((2,))).requires_grad_()
    state = random_deformation((2,))

    def pick(index):
        parts = state.rotation[index], state.translation[index]
        return Rigidity(graph, nodes[index], 0.6, GemanMcClure(3.0), 0.1), Deformation(*parts)

    energy = Rigidity(graph, nodes, 0.6, GemanMcClure(3.0), 0.1)
    check_energy(energy, state, pick=pick, inputs=[nodes])


def test_value_is_the_published_sum(graph):
    nodes, state = graph.nodes(posed_strip()), random_deformation()
    turn, moved = rotvec_to_matrix(state.rotation), nodes + state.translation
    total = 0.0
    for i, j in graph.edges.tolist():
        gap = moved[:, i] - moved[:, j]
        gap = gap - (turn[:, i] @ (nodes[:, i] - nodes[:, j]).unsqueeze(-1)).squeeze(-1)
        total += gap.square().sum()
    energy = Rigidity(graph, nodes, 0.6, unit=0.01)(state)
    torch.testing.assert_close(energy, 0.6 * total / NODES / 0.01**2)


def test_rigid_motions_are_free_and_flat(graph):
    nodes = graph.nodes(posed_strip())
    turn = torch.tensor([0.9, -1.4, 0.5], dtype=torch.float64)
    state = rigid(nodes, turn, torch.tensor([1.0, -2.0, 3.0], dtype=torch.float64))
    energy = Rigidity(graph, nodes)
    assert (energy(state) < 1e-28).all()
    equations = SparseProblem.of(Objective(rigidity=energy), state).linearize(state)
    assert equations.gradient.abs().max() < 1e-14
    # to turn and move all nodes further costs nothing either
    place = nodes + state.translation
    product = torch.zeros(2, NODES, 6, dtype=torch.float64)
    for axis in torch.eye(3, dtype=torch.float64):
        along = axis.expand_as(place)
        for twist in ((along, torch.linalg.cross(along, place)), (0 * along, along)):
            for curvature in equations.curvatures:
                running = torch.ones(2, dtype=torch.bool)
                curvature.add_product(torch.cat(twist, -1), product, running)
    assert product.abs().max() < 1e-13


def test_groups_move_rigidly_at_no_cost_within(graph):
    """Only edges between groups resist the modes of the coarse space."""
    nodes = graph.nodes(posed_strip())
    turn = torch.tensor([0.9, -1.4, 0.5], dtype=torch.float64)
    state = rigid(nodes, turn, torch.tensor([1.0, -2.0, 3.0], dtype=torch.float64))
    energy = Rigidity(graph, nodes)
    space = energy.coarse_space(state)
    assert space.groups == 2
    linear = energy.linearize_blocks(state).as_blocks()
    for group in range(space.groups):
        moved = torch.where((space.group == group)[:, None, None], space.modes, 0)
        seen = moved[:, graph.edges]  # F E 2 6 r
        change = (linear.jacobian @ seen).sum(-3)
        within = (space.group[graph.edges] == group).all(-1)
        assert change[:, within].abs().max() < 1e-13
        assert change[:, ~within].any()


def test_closed_form_blocks_are_the_derivative(graph):
    nodes, state = graph.nodes(posed_strip((2,))), random_deformation((2,))
    energy = Rigidity(graph, nodes, unit=0.3)
    linear = energy.linearize_blocks(state).as_blocks()
    dense = energy.linearize(state).frame.unflatten(-1, (NODES, 6))
    whole = torch.zeros_like(dense)
    for edge, ends in enumerate(graph.edges.tolist()):
        for slot, node in enumerate(ends):
            assert (linear.blocks[..., edge, slot] == node).all()
            whole[..., edge, :, node, :] += linear.jacobian[..., edge, slot, :, :]
    torch.testing.assert_close(whole, dense)


def test_edges_say_what_their_blocks_say(graph):
    nodes, state = graph.nodes(posed_strip()), random_deformation()
    linear = Rigidity(graph, nodes, unit=0.3).linearize_blocks(state)
    random = torch.Generator().manual_seed(0)
    weight = torch.rand(2, len(graph.edges), generator=random, dtype=torch.float64)
    direction = torch.randn(2, NODES, 6, generator=random, dtype=torch.float64)
    modes = torch.randn(2, NODES, 6, 4, generator=random, dtype=torch.float64)
    space = CoarseSpace(torch.tensor([0, 0, 1, 1, -1, 2]), 3, modes)
    parts = linear.turned, linear.residual.value, weight
    kinds = [
        twin.EdgeCurvature(linear.start, linear.end, linear.scale, *parts)
        for twin in (_rigidity_torch, _rigidity_numba)
    ]
    results = []
    for curvature in (linear.as_blocks().curvature(weight), *kinds):
        gradient, product = torch.zeros(2, 2, NODES, 6, dtype=torch.float64)
        diagonal = direction.new_zeros(2, NODES, 6, 6)
        coarse = direction.new_zeros(2, 3, 4, 3, 4)
        curvature.add_equations(gradient, diagonal)
        curvature.add_product(direction, product, torch.ones(2, dtype=torch.bool))
        curvature.add_coarse(space, coarse)
        results.append((gradient, diagonal, product, coarse))
    for other in results[1:]:
        torch.testing.assert_close(other[:3], results[0][:3], rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(results[1][3], results[2][3], rtol=1e-10, atol=1e-12)


def test_edges_within_a_group_add_nothing_to_its_coarse_matrix(graph):
    """So they are left out, and the matrix of a rigid state is that of its blocks."""
    nodes = graph.nodes(posed_strip())
    turn = torch.tensor([0.9, -1.4, 0.5], dtype=torch.float64)
    state = rigid(nodes, turn, torch.tensor([1.0, -2.0, 3.0], dtype=torch.float64))
    energy = Rigidity(graph, nodes, unit=0.3)
    space, linear = energy.coarse_space(state), energy.linearize_blocks(state)
    weight = torch.rand(2, len(graph.edges), dtype=torch.float64)
    found, expected = torch.zeros(2, 2, 2, 6, 2, 6, dtype=torch.float64)
    linear.curvature(weight).add_coarse(space, found)
    linear.as_blocks().curvature(weight).add_coarse(space, expected)
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-9)


def test_compiled_stretch_equals_plain_torch(graph):
    nodes, state = graph.nodes(posed_strip((3,))), random_deformation((3,))
    energy = Rigidity(graph, nodes, unit=0.3)
    parts = energy.start, energy.end, energy.rest, energy.scale, state
    compiled, plain = _rigidity_numba.stretch(*parts), _rigidity_torch.stretch(*parts)
    torch.testing.assert_close(compiled, plain, rtol=1e-12, atol=1e-12)


class Anchor(Energy[Deformation]):
    """Pulls the translation of every node to a target; rotations have nothing but rigidity."""

    def __init__(self, target):
        super().__init__(0.3)
        self.register_buffer("target", target)

    def residual(self, state):
        return Residual(state.translation - self.target)

    def linearize_blocks(self, state):
        shape = (*self.target.shape, 3)
        eye = torch.eye(3, dtype=torch.float64).expand(shape)
        nodes = torch.arange(NODES).expand(shape[:-2]).unsqueeze(-1)
        jacobian = torch.cat((torch.zeros_like(eye), eye), -1).unsqueeze(-3)
        return BlockLinearization(self.residual(state), nodes, jacobian)


def bent(graph):
    """Nodes, and where a smooth bend and a turn of all of them takes each."""
    nodes = graph.nodes(posed_strip())
    turn = torch.tensor([0.3, 0.8, -0.4], dtype=torch.float64)
    state = rigid(nodes + 0.05 * nodes.square(), turn, 0.2 * turn)
    return nodes, state.translation + 0.05 * nodes.square()


def test_rotations_follow_translations(graph):
    """They have no data of their own, and start far from where they end."""
    nodes, target = bent(graph)
    objective = Objective(rigidity=Rigidity(graph, nodes, 0.5), anchor=Anchor(target))
    start = Deformation(torch.zeros_like(nodes), torch.zeros_like(nodes))
    method = TruncatedNewton(max_steps=100, tolerance=1e-12)
    solution = solve(objective, start, method)
    assert (solution.status == Status.CONVERGED).all()
    assert (solution.state.translation - target).abs().max() < 0.02
    turn = torch.tensor([0.3, 0.8, -0.4], dtype=torch.float64)
    assert (solution.state.rotation - turn).abs().max() < 0.2


@pytest.mark.long
def test_minimum_is_that_of_the_dense_method(graph):
    nodes, target = bent(graph)
    start = random_deformation(size=0.1)
    method = TruncatedNewton(max_steps=200, tolerance=0.0, forcing=1e-5)
    objective = Objective(rigidity=Rigidity(graph, nodes, 0.5), anchor=Anchor(target))
    sparse = solve(objective, start, method)
    for f in range(2):
        one = slice(f, f + 1)
        objective = Objective(rigidity=Rigidity(graph, nodes[one], 0.5), anchor=Anchor(target[one]))
        exact = solve(objective, start[one], LevenbergMarquardt(max_steps=500, tolerance=1e-15))
        for name in ("rotation", "translation"):
            found, expected = getattr(sparse.state, name)[one], getattr(exact.state, name)
            torch.testing.assert_close(found, expected, rtol=0, atol=1e-8)


def test_nodes_of_another_graph_are_refused(graph):
    with pytest.raises(InputError, match="graph has 6 nodes"):
        Rigidity(graph, torch.zeros(2, 5, 3))


def test_nodes_of_other_frames_are_refused(graph):
    """Those of one frame were the rest of all."""
    nodes = graph.nodes(posed_strip(frames=1))
    with pytest.raises(InputError, match="made for 1 frames but the state has 2"):
        Rigidity(graph, nodes)(random_deformation())


def test_a_deformation_of_another_graph_is_refused(graph):
    """Compiled loops wrote beyond its end."""
    energy = Rigidity(graph, graph.nodes(posed_strip()))
    few = random_deformation()
    with pytest.raises(InputError, match=f"made for {NODES} nodes but the deformation has 2"):
        energy(Deformation(few.rotation[:, :2], few.translation[:, :2]))
