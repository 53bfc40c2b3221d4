"""Deformations as points of a manifold."""

import pytest
import torch

from perfcap.actor import Deformation
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.solve.energy import Step

F64 = torch.float64


def random_deformation(
    lead: tuple[int, ...], nodes: int = 7, seed: int = 1, dtype: torch.dtype = F64
) -> Deformation:
    random = torch.Generator().manual_seed(seed)
    turn, shift = torch.randn((2, *lead, nodes, 3), generator=random, dtype=dtype)
    # shorter than half a turn, where the inverse is unique
    return Deformation(2.5 * turn / (1 + turn.norm(dim=-1, keepdim=True)), shift)


@pytest.mark.parametrize("lead", [(5,), (2, 5), (2, 3, 1)])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_local_undoes_retract(lead: tuple[int, ...], dtype: torch.dtype) -> None:
    here = random_deformation(lead, dtype=dtype)
    step = random_deformation(lead, seed=2, dtype=dtype).coordinates()
    there = here.retract(step)
    back = here.local(there)
    assert there.rotation.dtype == back.frame.dtype == dtype
    assert back.frame.shape == (*lead, here.frame_dim)
    assert back.shared.shape == (*lead[:-1], sum(here.shared_sizes.values()))
    assert (back.frame - step.frame).abs().max() < 50 * torch.finfo(dtype).eps


def test_retract_of_local_arrives() -> None:
    here, goal = random_deformation((2, 3)), random_deformation((2, 3), seed=2)
    there = here.retract(here.local(goal))
    turns = rotvec_to_matrix(there.rotation) - rotvec_to_matrix(goal.rotation)
    assert turns.abs().max() < 1e-13
    assert (there.translation - goal.translation).abs().max() < 1e-14


def test_zero_step_is_the_identity() -> None:
    here = random_deformation((4,))
    there = here.retract(Step(torch.zeros(4, 42, dtype=F64), torch.zeros(0, dtype=F64)))
    assert torch.allclose(there.rotation, here.rotation, atol=1e-15)
    assert torch.equal(there.translation, here.translation)
    assert here.local(here).frame.abs().max() < 1e-15


def test_tangent_is_node_after_node_in_world_axes() -> None:
    here = random_deformation((2,))
    step = Step(torch.zeros(2, 42, dtype=F64), torch.zeros(0, dtype=F64))
    step.frame[1, 6 * 3 : 6 * 4] = torch.tensor([0.3, -0.2, 0.5, 1.0, 2.0, 3.0], dtype=F64)
    there = here.retract(step)
    expected = rotvec_to_matrix(step.frame[1, 18:21]) @ rotvec_to_matrix(here.rotation[1, 3])
    assert torch.allclose(rotvec_to_matrix(there.rotation[1, 3]), expected, atol=1e-13)
    assert torch.equal(there.translation[1, 3], here.translation[1, 3] + step.frame[1, 21:24])
    still = torch.ones(2, 7, dtype=torch.bool)
    still[1, 3] = False
    assert torch.allclose(there.rotation[still], here.rotation[still], atol=1e-15)
    assert torch.equal(there.translation[still], here.translation[still])


def test_batch_equals_loop() -> None:
    here, step = random_deformation((2, 3)), random_deformation((2, 3), seed=2).coordinates()
    there = here.retract(step)
    for element in range(2):
        alone = Deformation(here.rotation[element], here.translation[element])
        alone = alone.retract(Step(step.frame[element], step.shared[element]))
        assert torch.equal(alone.rotation, there.rotation[element])
        assert torch.equal(alone.translation, there.translation[element])


def test_retract_differentiates() -> None:
    here = random_deformation((2,), nodes=2)

    def moved(frame: torch.Tensor) -> torch.Tensor:
        return here.retract(Step(frame, frame.new_zeros(0))).coordinates().frame

    frame = (0.3 * random_deformation((2,), 2, seed=2).coordinates().frame).requires_grad_()
    assert torch.autograd.gradcheck(moved, (frame,), check_forward_ad=True)


def test_frames_are_selected_together() -> None:
    here = random_deformation((2, 6))
    part = here[torch.tensor([4, 1])]
    assert (part.frames, part.nodes) == (2, 7)
    assert torch.equal(part.rotation, here.rotation[:, [4, 1]])
    assert torch.equal(part.translation, here.translation[:, [4, 1]])
    assert here[1:3].rotation.shape == (2, 2, 7, 3)


def test_identity_and_sizes() -> None:
    like = torch.zeros((), dtype=torch.float32)
    still = Deformation.identity((2, 3), 5, like)
    assert still.rotation.shape == still.translation.shape == (2, 3, 5, 3)
    assert still.rotation.dtype == torch.float32
    assert not still.rotation.any()
    assert not still.translation.any()
    assert (still.frame_dim, still.shared_sizes, still.block_dim) == (30, {}, 6)
    assert still.to(torch.zeros((), dtype=F64)).translation.dtype == F64


@pytest.mark.parametrize("shapes", [((3, 4, 3), (3, 5, 3)), ((4, 3), (4, 3)), ((1, 4, 2),) * 2])
def test_mismatched_parts_are_refused(shapes: tuple[tuple[int, ...], ...]) -> None:
    with pytest.raises(ValueError, match="deformation has rotation"):
        Deformation(torch.zeros(shapes[0]), torch.zeros(shapes[1]))
