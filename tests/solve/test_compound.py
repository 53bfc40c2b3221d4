"""States made of states: moving there and back, and energies that see one part."""

from __future__ import annotations

import pytest
import torch
from checks import check_energy
from synthetic import actor, cameras, random_motion
from tiny_graph import NODES, posed_strip, random_deformation, tiny_graph

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy import JointTarget, PosePrior, Reprojection, Rigidity, Tether, Trajectory
from perfcap.errors import InputError
from perfcap.solve import Compound, Energy, Huber, Objective, Step, of_part
from perfcap.solve.adjoint import tangent_gradient
from perfcap.solve.assembly import assemble
from perfcap.solve.layout import Layout
from perfcap.solve.stationarity import gradient

F64 = torch.float64
ACTOR = actor()
GRAPH = tiny_graph()


def state(batch: tuple[int, ...] = (), frames: int = 2) -> Compound:
    motion = random_motion(ACTOR.skeleton, frames, batch, seed=3)
    return Compound({"motion": motion, "deformation": random_deformation(batch, frames)})


def energies(frames: int = 2) -> dict[str, Energy[Compound]]:
    views = cameras(2, 64)
    seen = views.project(ACTOR.joints(random_motion(ACTOR.skeleton, frames, (), seed=4)))
    found = Detections.from_joints(seen, torch.ones_like(seen[..., 0]))
    nodes = GRAPH.nodes(posed_strip(frames=frames))
    of_motion = {
        "joints": Reprojection(ACTOR.landmarks, views, found, 0.3, Huber(3.0)),
        "prior": PosePrior(torch.zeros(27, dtype=F64), 0.5),
        "trajectory": Trajectory(frames, 1, angles=2.0),
    }
    of_nodes = {
        "rigidity": Rigidity(GRAPH, nodes, 0.6, Huber(0.5), 0.1),
        "tether": Tether(NODES, 0.3, unit=0.1),
    }
    return {
        **{name: of_part("motion", each) for name, each in of_motion.items()},
        **{name: of_part("deformation", each) for name, each in of_nodes.items()},
    }


@pytest.mark.parametrize("batch", [(), (3,)])
def test_local_undoes_retract(batch: tuple[int, ...]) -> None:
    here = state(batch)
    random = torch.Generator().manual_seed(1)
    frame = 0.3 * torch.randn(here.coordinates().frame.shape, generator=random, dtype=F64)
    assert frame.shape[-1] == 33 + 6 * NODES == here.frame_dim
    step = here.local(here.retract(Step(frame, here.coordinates().shared)))
    torch.testing.assert_close(step.frame, frame)


def test_a_part_moves_alone() -> None:
    here = state()
    frame = torch.zeros_like(here.coordinates().frame)
    frame[..., here.columns("deformation")] = 0.1
    there = here.retract(Step(frame, here.coordinates().shared))
    assert torch.equal(there.parts["motion"].angles, here.parts["motion"].angles)
    assert not torch.equal(there.parts["deformation"].rotation, here.parts["deformation"].rotation)


def test_shared_blocks_are_those_of_all_parts() -> None:
    motion = random_motion(ACTOR.skeleton, 2, (), seed=3)
    shared = Motion(motion.translation, motion.rotation, motion.angles, {"own": torch.ones(3)})
    both = Compound({"first": motion, "second": shared})
    assert both.shared_sizes == {"own": 3}
    step = Step(torch.zeros_like(both.coordinates().frame), torch.full((3,), 2.0))
    assert both.retract(step).parts["second"].shared["own"].tolist() == [3, 3, 3]


@pytest.mark.parametrize("name", ["joints", "prior", "tether", "rigidity", "trajectory"])
def test_energies_of_parts_pass_every_check(name: str) -> None:
    check_energy(energies()[name], state())


def test_normal_equations_hold_every_part_where_it_belongs() -> None:
    """Curvature and gradient of blocks that are added sparsely equal those of whole Jacobians."""
    here, own = state(), energies()
    whole = Objective(own)
    added = assemble(whole, here)
    rows = Objective({name: _Rows(each) for name, each in own.items() if name != "trajectory"})
    plain = assemble(rows, here)
    torch.testing.assert_close(added.curvature, plain.curvature)
    torch.testing.assert_close(added.frame_gradient, plain.frame_gradient)
    apart = added.curvature[..., here.columns("motion"), here.columns("deformation")]
    assert not apart.any()


def test_gradient_is_the_derivative_of_the_energy() -> None:
    here, objective = state(), Objective(energies())
    layout = Layout.of(here)
    half = gradient(objective, here, layout)
    zero = torch.zeros(1, layout.unknowns, dtype=F64)
    torch.testing.assert_close(2 * half, tangent_gradient(objective, here, zero))


def test_gradients_reach_weights_of_sparse_energies() -> None:
    weight = torch.tensor(0.7, dtype=F64, requires_grad=True)
    here = state()
    energy = of_part("deformation", Rigidity(GRAPH, GRAPH.nodes(posed_strip()), weight))
    half = gradient(Objective(rigid=energy), here, Layout.of(here))
    (slope,) = torch.autograd.grad(half.sum(), weight)
    torch.testing.assert_close(slope * weight, half.sum())


def test_what_does_not_fit_is_refused() -> None:
    motion = random_motion(ACTOR.skeleton, 2, (), seed=3)
    with pytest.raises(InputError, match="same frames"):
        Compound({"motion": motion, "deformation": random_deformation((), 3)})
    shared = Motion(motion.translation, motion.rotation, motion.angles, {"own": torch.ones(3)})
    with pytest.raises(InputError, match="name of its own"):
        Compound({"first": shared, "second": shared})
    target = JointTarget(ACTOR.landmarks, ACTOR.joints(motion).unsqueeze(-3))
    with pytest.raises(InputError, match="parts motion"):
        of_part("pose", target).add_to_blocks(
            Compound({"motion": motion}), torch.zeros(1, 2, 33, 33), torch.zeros(1, 2, 33)
        )


class _Rows(Energy[Compound]):
    """An energy by its rows alone."""

    def __init__(self, energy: Energy[Compound]) -> None:
        super().__init__(energy.weight, energy.kernel)
        self.own = energy

    def residual(self, state: Compound) -> object:  # type: ignore[override]
        return self.own.residual(state)
