"""Particle search: known minima, chance, bad input."""

import pytest
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.particles import ParticleSettings, _diffuse, _weights, search_particles

TRUTH = torch.tensor([0.4, -0.3, 0.2, 0.1], dtype=torch.float64)
SPREAD = torch.full((4,), 0.3, dtype=torch.float64)


def waves(particles: Tensor) -> Tensor:
    """A bowl with a local minimum every 0.25 in each dimension, lowest at TRUTH, where it is 0."""
    off = particles - TRUTH
    return (off.square() + 0.05 * (1 - torch.cos(8 * torch.pi * off))).sum(-1)


def start() -> tuple[Tensor, Tensor]:
    return TRUTH + 0.5, TRUTH + 0.25  # both within 0.04 of a local minimum in every dimension


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("seed", range(5))
def test_leaves_local_minima(seed: int) -> None:
    found = search_particles(waves, start(), SPREAD, seeded(seed))
    assert (found.value - TRUTH).abs().max() < 0.125  # in the basin of the lowest one
    torch.testing.assert_close(waves(found.value[None])[0], found.energy)


def test_same_seed_same_bits() -> None:
    one, two = (search_particles(waves, start(), SPREAD, seeded(3)) for _ in range(2))
    assert torch.equal(one.value, two.value)
    assert torch.equal(one.energy, two.energy)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_never_worse_than_a_hypothesis(order: tuple[int, int]) -> None:
    pair = (TRUTH, TRUTH + 3)
    found = search_particles(waves, (pair[order[0]], pair[order[1]]), SPREAD, seeded(0))
    assert torch.equal(found.value, TRUTH)


def test_unit_of_the_energy_changes_nothing() -> None:
    # a power of two keeps every bit
    one = search_particles(waves, start(), SPREAD, seeded(1))
    two = search_particles(lambda x: 1024 * waves(x), start(), SPREAD, seeded(1))
    assert torch.equal(one.value, two.value)


def test_counts_what_it_asks() -> None:
    asked: list[int] = []

    def counted(particles: Tensor) -> Tensor:
        asked.append(len(particles))
        return waves(particles)

    found = search_particles(counted, start(), SPREAD, seeded(0))
    assert asked == [80] * 15
    assert found.evaluations == sum(asked)


def test_moves_by_a_share_of_the_covariance() -> None:
    particles = torch.randn(2000, 2, generator=seeded(0), dtype=torch.float64)
    particles = particles @ torch.tensor([[1.0, 0.8], [0.0, 0.3]], dtype=torch.float64)
    moved = _diffuse(particles, 0.4, seeded(1)) - particles
    torch.testing.assert_close(moved.T.cov(), 0.4 * particles.T.cov(), atol=0.05, rtol=0)


def test_weights_sharpen_and_drop_the_infinite() -> None:
    energies = torch.tensor([1.0, 2.0, torch.inf], dtype=torch.float64)
    soft, sharp = _weights(energies, 1), _weights(energies, 3)
    assert soft[0] == sharp[0] == 1
    assert soft[1] > sharp[1] > 0
    assert soft[2] == sharp[2] == 0


def test_energy_that_is_no_number() -> None:
    half = search_particles(
        lambda x: torch.where(x[:, 0] > TRUTH[0] + 0.2, torch.nan, waves(x)),
        (TRUTH + 0.5, TRUTH - 0.25),
        SPREAD,
        seeded(0),
    )
    assert half.energy.isfinite()
    none = search_particles(
        lambda x: torch.full_like(x[:, 0], torch.nan), start(), SPREAD, seeded(0)
    )
    assert torch.equal(none.value, start()[0])
    assert none.energy.isinf()


def test_bad_input() -> None:
    good = start()
    for pair, spread, message in (
        ((good[0][:3], good[1]), SPREAD, r"hypotheses\[0\] has shape"),
        ((good[0], good[1] * torch.nan), SPREAD, r"hypotheses\[1\] is not finite"),
        (good, 0 * SPREAD, "spread must be"),
    ):
        with pytest.raises(InputError, match=message):
            search_particles(waves, pair, spread, seeded(0))
    empty = torch.zeros(0)
    with pytest.raises(InputError, match="h at least 1"):
        search_particles(waves, (empty, empty), empty, seeded(0))
    with pytest.raises(InputError, match="one number each"):
        search_particles(lambda x: x, good, SPREAD, seeded(0))
    with pytest.raises(InputError, match="iterations of ParticleSettings is 0"):
        ParticleSettings(iterations=0)
    with pytest.raises(InputError, match="diffusion of ParticleSettings is nan"):
        ParticleSettings(diffusion=float("nan"))
    with pytest.raises(InputError, match="sharpening of ParticleSettings is inf"):
        ParticleSettings(sharpening=float("inf"))
