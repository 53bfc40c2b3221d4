"""States and kernels of one's own that contradict themselves are refused by name."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import torch
from toy import Frames

from perfcap.errors import InputError
from perfcap.solve import Adam, Bounds, Energy, Kernel, Objective, Residual, Step, solve

F64 = torch.float64
BOX = Bounds.on_frames(torch.full((3,), -0.5, dtype=F64), torch.full((3,), 0.5, dtype=F64))


class ToOne(Energy):
    """Unknowns that should be 1, each frame a group."""

    def residual(self, state):
        return Residual((state.frame - 1).unsqueeze(-2))


def start(kind=Frames, at: float = 0.0):
    return kind(torch.full((4, 3), at, dtype=F64), torch.zeros(0, dtype=F64))


class Twice(Frames):
    def retract(self, step):
        return Twice(self.frame + 2 * step.frame, self.shared)


class Elsewhere(Frames):
    def retract(self, step):
        return Elsewhere(self.frame + step.frame, self.shared)

    def coordinates(self):
        return Step(torch.zeros_like(self.frame), self.shared)


class InPlace(Frames):
    def retract(self, step):
        self.frame.add_(step.frame)
        return self


class Bare(Frames):
    def retract(self, step):
        return self.frame + step.frame


class Clamped(Frames):
    def retract(self, step):
        return Clamped((self.frame + step.frame).clamp(0, 0.4), self.shared)


@pytest.mark.parametrize("method", [None, Adam()])
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Twice, "bounds hold coordinates of a Twice .* moves one by -0.002"),
        (Elsewhere, "bounds hold coordinates of a Elsewhere .* moves one by 0;"),
        (InPlace, "retract of InPlace changes the state in place"),
        (Bare, "retract of Bare returned a Tensor"),
    ],
)
def test_bounds_on_what_steps_do_not_add_to(kind, message, method) -> None:
    """The first ended at 0.9 and the second at 1, outside of the box and CONVERGED."""
    with pytest.raises(InputError, match=message):
        solve(Objective(one=ToOne()), start(kind), method, BOX)


def test_a_state_may_end_where_bounds_do_not() -> None:
    for at in (0.0, 0.4):
        found = solve(Objective(one=ToOne()), start(Clamped, at), bounds=BOX)
        torch.testing.assert_close(found.state.frame, torch.full((4, 3), 0.4, dtype=F64))
    free = solve(Objective(one=ToOne()), start(Twice))  # unbounded steps may be any coordinates
    torch.testing.assert_close(free.state.frame, torch.ones(4, 3, dtype=F64))


def test_sizes_that_contradict_coordinates() -> None:
    class Fewer(Frames):
        frame_dim = 2

    class Shared(Frames):
        shared_sizes = {"all": 2}  # noqa: RUF012

    for kind in (Fewer, Shared):
        with pytest.raises(InputError, match=rf"initial is a {kind.__name__} of frame_dim"):
            solve(Objective(one=ToOne()), start(kind))


@dataclass(frozen=True)
class Own(Kernel):
    """A kernel of two functions."""

    cost: object
    weight: object

    def value(self, squared):
        return self.cost(squared)

    def slope(self, squared):
        return self.weight(squared)


def same(squared):
    return squared


@pytest.mark.parametrize(
    ("kernel", "message"),
    [
        (Own(same, lambda s: -torch.ones_like(s)), "whose slope is -1; expected numbers from 0"),
        (Own(same, torch.zeros_like), "is 0, but its value grows by 1 for"),
        (Own(torch.log1p, lambda s: 1 / (1 + s.sqrt())), "is 0.366, but its value grows by 0.25"),
        (Own(same, lambda s: torch.ones(())), r"whose slope is \(\) for squared residuals \(4, 1"),
        (Own(same, lambda s: 1.0), "whose slope is float"),
        (Own(torch.sum, torch.ones_like), r"whose value is \(\)"),
    ],
)
def test_kernels_that_are_none(kernel, message) -> None:
    """The first two were CONVERGED where they began."""
    with pytest.raises(InputError, match=f"^energy 'one' has a Own .*{message}"):
        solve(Objective(one=ToOne(kernel=kernel)), start())


def test_kernels_of_ones_own_that_are_right() -> None:
    cauchy = Own(torch.log1p, lambda s: 1 / (1 + s))
    one = torch.ones(4, 3, dtype=F64)
    found = solve(Objective(one=ToOne(kernel=cauchy)), start())
    torch.testing.assert_close(found.state.frame, one)
    # Adam needs no slope
    loss = Own(torch.log1p, lambda s: -s)
    found = solve(Objective(one=ToOne(kernel=loss)), start(), Adam())
    torch.testing.assert_close(found.state.frame, one, atol=1e-2, rtol=0)


def test_a_kernel_that_pulls_at_nothing_is_told() -> None:
    cut = Own(lambda s: s.clamp(max=0.01), lambda s: (s < 0.01).to(s))
    with pytest.warns(UserWarning, match="slope is 0 at all residuals where they start"):
        solve(Objective(one=ToOne(kernel=cut)), start())
