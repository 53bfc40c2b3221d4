"""What the loop of damped methods promises, whatever the linear model is."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
import torch
from block_toy import Blocks, StiffChain, block_toy
from torch import Tensor

from perfcap.solve import (
    Energy,
    LevenbergMarquardt,
    Objective,
    Residual,
    Status,
    TruncatedNewton,
    solve,
)
from perfcap.solve.damped_loop import Proposal, Run, advance, minimize
from perfcap.solve.progress import Outcome, Progress
from perfcap.solve.sparse import BlockLinearization

METHODS = {
    "dense": LevenbergMarquardt(100, 1e-13, damping=1e-6),
    "sparse": TruncatedNewton(100, tolerance=0.0, forcing=1e-4),
}
GOOD, BAD = 0.5, -0.5  # of the way to the minimum at zero


@dataclass(frozen=True)
class Square:
    """``x^2`` of each element, whose steps are a script; it writes down what it is asked for."""

    x: Tensor
    script: list[list[float]]  # steps, elements
    leads_on: bool = True
    hole: tuple[float, float] = (1e6, 1e6)  # between, it has no derivative
    log: list[str] = field(default_factory=list)

    @property
    def equations(self) -> Square:
        return self

    @property
    def terms(self) -> dict[str, Tensor]:
        return self.evaluate(self.x, "")

    def finite(self) -> Tensor:
        low, high = self.hole
        return (self.x < low) | (self.x > high)

    def at(self, state: Tensor) -> Square:
        self.log.append("linearize")
        return replace(self, x=state)

    def merge(self, moved: Tensor, stayed: Square, state: Tensor) -> Square:
        self.log.append("merge")
        return replace(self, x=torch.where(moved, self.x, stayed.x))

    def evaluate(self, state: Tensor, word: str = "evaluate") -> dict[str, Tensor]:
        self.log.extend([word] if word else [])
        return {"one": 0.25 * state.square(), "other": 0.75 * state.square()}

    def retract(self, state: Tensor, step: Tensor) -> Tensor:
        return state + step.squeeze(-1)

    def propose(self, run: Any, final: bool) -> Proposal:
        assert torch.equal(torch.where(torch.tensor(run.running), self.x, run.state), run.state)
        share = torch.tensor(
            self.script[max(each.steps for each in run.progress)], dtype=torch.float64
        )
        valid = torch.tensor(run.running)
        step = torch.where(valid, -share * run.state, 0)
        return Proposal(
            step=step.unsqueeze(-1),
            valid=valid,
            promised=torch.where(valid, run.state.square(), 0),
            share=torch.zeros_like(run.state),
            negligible=torch.zeros_like(valid),
            leads_on=self.leads_on,
        )


class Endless(Progress):
    def _converged(self, outcome: Outcome, eps: float) -> bool:
        return outcome.valid and abs(outcome.after) <= self.tolerance


def run_of(script: list[list[float]], *, tolerance: float = 0.0, **more: Any) -> Run[Any, Proposal]:
    x = torch.linspace(1, 2, len(script[0]), dtype=torch.float64)
    model = Square(x, script, **more)
    fresh = Endless(1e-3, tolerance)
    return Run.start(x.shape, model, x, model.terms, model.finite(), fresh)


def test_a_trial_is_linearized_at_once_while_steps_succeed() -> None:
    run = run_of([[GOOD], [BAD], [BAD], [GOOD], [GOOD]])
    minimize(run, 5)
    # the first bad one in vain; the good one after them once it is accepted
    expected = ["linearize"] * 2 + ["evaluate"] * 2 + ["linearize"] * 2
    assert run.model.log == expected


@pytest.mark.parametrize(("leads_on", "expected"), [(True, 3), (False, 2)])
def test_a_last_step_that_leads_nowhere_is_not_linearized(leads_on: bool, expected: int) -> None:
    run = run_of([[GOOD]] * 3, leads_on=leads_on)
    found = minimize(run, 3)
    assert Counter(run.model.log) == {"linearize": expected} | ({} if leads_on else {"evaluate": 3})
    assert found.state.item() == GOOD**3 and found.energy.item() == GOOD**6


def test_rejected_and_ended_elements_stay_to_the_last_bit() -> None:
    script = [[1.0, GOOD, GOOD], [GOOD, BAD, GOOD], [GOOD, GOOD, BAD]]
    run = run_of(script, tolerance=1e-12)
    states = [run.state]
    for trial, after in advance(run, 3):
        stays = ~trial.accepted
        assert torch.equal(after.state[stays], states[-1][stays])
        assert torch.equal(after.energy, after.state.square())
        assert torch.equal(after.terms["one"], 0.25 * after.energy)
        states, last = [*states, after.state], after
    assert last.solution().steps.tolist() == [1, 3, 3]
    assert last.solution().status.tolist() == [Status.CONVERGED, *[Status.MAX_STEPS] * 2]
    assert states[-1].tolist() == [0.0, 1.5 * GOOD**2, 2 * GOOD**2]


def test_an_element_whose_model_is_lost_ends_and_the_others_go_on() -> None:
    found = minimize(run_of([[GOOD, GOOD]] * 4, hole=(0.4, 0.6)), 4)
    assert found.status.tolist() == [Status.NOT_FINITE] * 2
    assert found.steps.tolist() == [1, 2]
    assert found.state.tolist() == [0.5, 0.5]  # where the energy is a number


def test_a_model_that_is_lost_where_nobody_goes_is_no_loss() -> None:
    found = minimize(run_of([[GOOD, BAD], [GOOD, GOOD]], hole=(2.9, 3.1)), 2)  # 2 -> 3 rejected
    assert found.status.tolist() == [Status.MAX_STEPS] * 2
    assert found.state.tolist() == [GOOD**2, 2 * GOOD]


def test_damping_follows_the_gain() -> None:
    """Nielsen's rule, at its ends and between; nothing overflows on a surprise."""

    def after(progress: Progress, gained: float, promised: float = 1.0) -> Progress:
        outcome = Outcome(0.0, True, promised, gained, 1e9, 1e9 - gained, 1e9, False)
        return progress.after(outcome, 1e-16)

    fresh = Endless(9.0, 0.0)
    assert after(fresh, 1.0).damping == 3.0
    assert after(fresh, 1e8, 1e-300).damping == 3.0
    assert after(fresh, 0.5).damping == 9.0
    assert after(fresh, 1e-12).damping == pytest.approx(18.0)
    often = fresh
    for factor in (4, 8, 16):
        again = after(often, -1.0)
        assert again.damping == factor * often.damping
        often = again
    assert after(after(often, 1.0), -1.0).damping == pytest.approx(often.damping / 3 * 4)
    stalled = after(replace(often, damping=1e21), -1.0)
    assert (stalled.status, stalled.running, stalled.steps) == (Status.STALLED, False, 4)
    assert after(stalled, 1.0) is stalled


class Valley(Energy[Blocks]):
    """Rosenbrock's function of every block (a, b), whose first Newton step is far too long."""

    def residual(self, state: Blocks) -> Residual:
        a, b = state.values.unbind(-1)
        return Residual(torch.stack((10 * (b - a.square()), 1 - a), -1))

    def linearize_blocks(self, state: Blocks) -> BlockLinearization:
        a = state.values[..., 0]
        one, none = torch.ones_like(a), torch.zeros_like(a)
        jacobian = torch.stack((-20 * a, 10 * one, -one, none), -1).unflatten(-1, (1, 2, 2))
        blocks = torch.arange(a.shape[-1]).expand(a.shape).unsqueeze(-1)
        return BlockLinearization(self.residual(state), blocks, jacobian)


def valleys() -> tuple[Objective, Blocks]:
    """Five of three blocks each, in which steps are rejected at other times."""
    random = torch.Generator().manual_seed(0)
    start = 2 * torch.randn(5, 1, 3, 2, generator=random, dtype=torch.float64)
    return Objective(valley=Valley(), same=Valley(0.5)), Blocks(start)


@pytest.mark.long
@pytest.mark.parametrize("name", METHODS)
def test_energy_never_rises_and_belongs_to_the_state(name: str) -> None:
    objective, state = valleys()
    before, rejected = objective(state), 0
    for steps in range(1, 25):
        found = solve(objective, state, replace(METHODS[name], max_steps=steps))
        energy, report = found.energy.reshape(5), objective.report(found.state)
        assert (energy <= before).all()
        going = (found.status == Status.MAX_STEPS).reshape(5)
        rejected += int((going & (energy == before)).sum())
        for key, term in found.terms.items():
            torch.testing.assert_close(term.reshape(5), report[key], rtol=1e-12, atol=1e-15)
        before = energy
    assert rejected > 5  # so that this was worth asking


@pytest.mark.long
@pytest.mark.parametrize("name", METHODS)
def test_batch_equals_loop_where_steps_are_rejected(name: str) -> None:
    objective, state = valleys()
    together = solve(objective, state, METHODS[name])
    assert len(set(together.steps.flatten().tolist())) > 1
    for index in range(5):
        alone = solve(objective, Blocks(state.values[index]), METHODS[name])
        assert alone.steps.item() == together.steps[index].item()
        assert alone.status.item() == together.status[index].item() == Status.CONVERGED
        found = together.state.values[index]
        torch.testing.assert_close(alone.state.values, found, rtol=0, atol=1e-9)


def test_both_models_lead_to_the_same_minimum() -> None:
    """Elements of a batch to the one, frames to the other."""
    objective, state = block_toy(frames=1, batch=(3,), chain=StiffChain)
    dense, sparse = (solve(objective, state, method) for method in METHODS.values())
    assert (dense.status == Status.CONVERGED).all() and (sparse.status == Status.CONVERGED).all()
    torch.testing.assert_close(dense.state.values, sparse.state.values, rtol=0, atol=1e-6)
    torch.testing.assert_close(dense.energy, sparse.energy.squeeze(-1), rtol=1e-10, atol=0)
