"""Energies of one's own that do not fit the state: compiled loops wrote beyond arrays."""

import pytest
import torch
from block_toy import Blocks, Chain
from toy import Frames, cosine_basis

from perfcap.errors import InputError
from perfcap.solve import (
    BlockLinearization,
    Bounds,
    Energy,
    LevenbergMarquardt,
    Objective,
    Residual,
    TruncatedNewton,
    WindowEnergy,
    solve,
)
from perfcap.solve.coarse_space import CoarseSpace, aggregate

F64 = torch.float64


class Data(Energy[Frames]):
    """Values of one."""

    def residual(self, state):
        return Residual((state.frame - 1).unsqueeze(-1))


class Window(WindowEnergy[Frames]):
    """Values themselves, changed by a function of features and their derivative."""

    def __init__(self, change):
        super().__init__(cosine_basis(2, 5), torch.ones(2, dtype=F64))
        self.change = change

    def features(self, state):
        return state.frame

    def linearize_features(self, state):
        return self.change(*super().linearize_features(state))


@pytest.mark.parametrize(
    "change",
    [
        lambda y, slope: (y[:2], slope[:2]),
        lambda y, slope: (y, slope[:2]),
        lambda y, slope: (y[:, :1], slope),
        lambda y, slope: (y, slope[:, :1]),
        lambda y, slope: (y, slope[..., :1]),
        lambda y, slope: (y.expand(4, 5, 3), slope.expand(4, 5, 3, 3)),
    ],
)
def test_features_of_other_frames_or_unknowns(change) -> None:
    state = Frames(torch.zeros(5, 3, dtype=F64), torch.zeros(0, dtype=F64))
    with pytest.raises(InputError, match="linearize_features returned features"):
        solve(Objective(data=Data(), window=Window(change)), state, LevenbergMarquardt())


def test_features_that_become_more() -> None:
    def change(y, slope):
        return (torch.cat((y, y), -1), torch.cat((slope, slope), -2)) if y.any() else (y, slope)

    state = Frames(torch.zeros(5, 3, dtype=F64), torch.zeros(0, dtype=F64))
    with pytest.raises(InputError, match="6 features and had 3 before"):
        solve(Objective(data=Data(), window=Window(change)), state, LevenbergMarquardt())


class Added(Data):
    """Adds itself, of a value that is not of each element."""

    def add_to_blocks(self, state, curvature, gradient):
        return torch.zeros(3, dtype=F64)


def test_values_of_other_batch_elements() -> None:
    state = Frames(torch.zeros(5, 3, dtype=F64), torch.zeros(0, dtype=F64))
    with pytest.raises(InputError, match="add_to_blocks has shape"):
        solve(Objective(data=Added()), state, LevenbergMarquardt())


class OddChain(Chain):
    """A chain whose blocks or derivatives are changed by a function, and a space of motions."""

    def __init__(self, change, space=None):
        super().__init__(torch.ones(2, 5, 2, dtype=F64))
        self.change = change
        if space is not None:
            self.coarse_space = lambda state: space

    def linearize_blocks(self, state):
        found = super().linearize_blocks(state)
        return BlockLinearization(found.residual, *self.change(found.blocks, found.jacobian))


def solved(change, space=None):
    state = Blocks(torch.zeros(2, 6, 2, dtype=F64))
    return solve(Objective(chain=OddChain(change, space)), state, TruncatedNewton())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda blocks, slope: (blocks + 5, slope), "energy 'chain' names blocks"),
        (lambda blocks, slope: (blocks - 5, slope), "energy 'chain' names blocks"),
        (lambda blocks, slope: (blocks.double(), slope), "energy 'chain' has a derivative"),
        (lambda blocks, slope: (blocks[..., :1], slope), "energy 'chain' has a derivative"),
        (lambda blocks, slope: (blocks, slope[..., :1]), "energy 'chain' has a derivative"),
        (lambda blocks, slope: (blocks, slope[..., :1, :]), "energy 'chain' has a derivative"),
        (lambda blocks, slope: (blocks[:1], slope[:1]), "energy 'chain' has a derivative"),
        (lambda blocks, slope: (blocks > 0, slope), "energy 'chain' has a derivative"),
    ],
)
def test_blocks_that_there_are_none_of(change, message) -> None:
    with pytest.raises(InputError, match=message):
        solved(change)


def test_motions_of_other_groups_or_blocks() -> None:
    group, modes = torch.arange(6) // 2, torch.eye(2, dtype=F64).expand(2, 6, 2, 2)
    for space, message in (
        (CoarseSpace(group, 1, modes), "group names groups 0 to 2"),
        (CoarseSpace(group[:2], 3, modes), "group has shape"),
        (CoarseSpace(group, 3, modes[:, :2]), "modes has shape"),
        (CoarseSpace(group, 3, modes[..., :1, :]), "modes has shape"),
        (CoarseSpace(group, 3, modes[:1].expand(5, 6, 2, 2)), "modes has shape"),
        (CoarseSpace(group, 3, modes[..., :0]), "coarse space has 3 groups, 0 modes"),
        (CoarseSpace(group.double(), 3, modes), "a group of torch.float64"),
        (CoarseSpace(group, 3, modes * torch.nan), "not all finite"),
    ):
        with pytest.raises(InputError, match=message):
            solved(lambda *parts: parts, space)


def test_edges_of_other_nodes() -> None:
    edges = torch.tensor([[0, 1], [1, 0], [1, 2], [2, 1]]).numpy()
    for far in (edges + 1, edges - 1):
        with pytest.raises(InputError, match="edges names nodes"):
            aggregate(far, 3)


def test_tensors_without_numbers() -> None:
    """They ended in tracebacks."""
    nothing, zeros = torch.zeros(3, device="meta"), torch.zeros(5, 3, dtype=F64)
    state = Frames(zeros, torch.zeros(0, dtype=F64))
    bounds = Bounds.on_frames(nothing, nothing)
    with pytest.raises(InputError, match="bounds has tensors on the meta device"):
        solve(Objective(data=Data()), state, bounds=bounds)
    with pytest.raises(InputError, match="initial state has tensors on the meta device"):
        solve(Objective(data=Data()), Frames(zeros.to("meta"), state.shared))
    with pytest.raises(InputError, match="objective has tensors on the meta device"):
        solve(Objective(data=Data().to("meta")), state)
