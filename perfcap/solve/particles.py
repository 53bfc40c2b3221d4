"""Global search by interacting simulated annealing (Gall et al. 2007; Liu et al. 2013, Sec. 4.1.2).

Particles in h dimensions are weighed, selected and diffused for a fixed number of iterations; the
weights sharpen and the diffusion follows the particles' own covariance, so they gather at the
lowest minimum they met. No derivative is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.setting_checks import Settings, require_counts, require_sizes

Values = Callable[[Tensor], Tensor]  # energies (N,) of particles (N, h)


@dataclass(frozen=True)
class ParticleSettings(Settings):
    """How far a search goes.

    Liu et al. state iterations, particles and their limit. The rest is ours: the weights of
    iteration k are ``exp(-(k + 1)^sharpening (E - min E) / mean(E - min E))``, which no unit of
    the energy changes; particles are moved by ``diffusion`` times their covariance.

    Args:
        iterations: rounds of selection and diffusion.
        per_dimension: particles for each of the h dimensions.
        most: limit of the number of particles.
        sharpening: exponent of the annealing schedule.
        diffusion: share of the covariance.
    """

    iterations: int = 15
    per_dimension: int = 20
    most: int = 300
    sharpening: float = 0.7
    diffusion: float = 0.4

    def __post_init__(self) -> None:
        """Refuse what no search can use."""
        super().__post_init__()
        require_counts(self, "iterations", "per_dimension", "most")
        require_sizes(self, "sharpening", "diffusion", finite=True)

    def count(self, dimensions: int) -> int:
        """Particles of a search in h ``dimensions``: 20 h, at most 300.

        Example:
            >>> ParticleSettings().count(3), ParticleSettings().count(39)
            (60, 300)
        """
        return min(self.per_dimension * dimensions, self.most)


@dataclass(frozen=True)
class Found:
    """The best particle (h,) of all iterations, its energy () and how many energies were asked."""

    value: Tensor
    energy: Tensor
    evaluations: int


def search_particles(
    energy: Values,
    hypotheses: tuple[Tensor, Tensor],
    spread: Tensor,
    generator: torch.Generator,
    settings: ParticleSettings | None = None,
) -> Found:
    """Minimise an energy from two hypotheses (Liu et al. 2013, Eq. 6).

    Particles begin evenly between the two, diffused by a Gaussian. The hypotheses stay among them,
    so the result is never worse than either. An energy that is not a number counts as infinite;
    where all are, the result is the first hypothesis, of infinite energy.

    Args:
        energy: energies (N,) of particles (N, h), in any unit.
        hypotheses: local optimum and prediction, (h,) each.
        spread: standard deviation of the first diffusion, (h,), in units of the parameters.
        generator: of the random numbers, on the hypotheses' device.
        settings: iterations and particles.
    """
    settings = settings if settings is not None else ParticleSettings()
    _require_start(hypotheses, spread)
    count = max(settings.count(len(spread)), 2)
    particles = _between(hypotheses, spread, count, generator)
    best, least = hypotheses[0], torch.full_like(spread[0], torch.inf)
    for k in range(settings.iterations):
        energies = _energies(energy, particles)
        lowest = int(energies.argmin())
        if energies[lowest] < least:
            best, least = particles[lowest], energies[lowest]
        weights = _weights(energies, (k + 1) ** settings.sharpening)
        particles = _diffuse(_select(particles, weights, generator), settings.diffusion, generator)
    return Found(best, least, count * settings.iterations)


def _between(
    hypotheses: tuple[Tensor, Tensor], spread: Tensor, count: int, generator: torch.Generator
) -> Tensor:
    """Particles (count, h) evenly from the first hypothesis to the second; these two stay."""
    share = torch.linspace(0, 1, count, dtype=spread.dtype, device=spread.device)[:, None]
    noise = _normal((count, len(spread)), spread, generator)
    inside = torch.lerp(hypotheses[0], hypotheses[1], share) + spread * noise
    return torch.cat((hypotheses[0][None], inside[1:-1], hypotheses[1][None]))


def _energies(energy: Values, particles: Tensor) -> Tensor:
    """Energies (N,), infinite where they are not a number."""
    energies = energy(particles)
    if energies.shape != particles.shape[:1]:
        raise InputError(
            f"energy returned {tuple(energies.shape)} for {len(particles)} particles; "
            f"it must return one number each"
        )
    return torch.where(energies.isnan(), torch.inf, energies)


def _weights(energies: Tensor, sharpness: float) -> Tensor:
    """Weights (N,) whose largest is one; all alike where no energy is finite or all are equal."""
    finite = energies.isfinite()
    if not bool(finite.any()):
        return torch.ones_like(energies)
    above = energies - energies[finite].min()
    scale = above[finite].mean()
    if not bool(scale > 0):
        return finite.to(energies)
    return torch.where(finite, torch.exp(-sharpness * above / scale), 0)


def _select(particles: Tensor, weights: Tensor, generator: torch.Generator) -> Tensor:
    """Keep each particle with the chance of its weight; draw a weighed one in place of others."""
    chance = torch.rand(
        len(weights), generator=generator, dtype=weights.dtype, device=weights.device
    )
    drawn = torch.multinomial(weights, len(weights), replacement=True, generator=generator)
    return torch.where((chance < weights)[:, None], particles, particles[drawn])


def _diffuse(particles: Tensor, share: float, generator: torch.Generator) -> Tensor:
    """Move particles by a Gaussian of a share of their covariance.

    Random sums of the particles' deviations have that covariance, whatever its rank: no matrix is
    factorised, and particles that have become one stay where they are.
    """
    deviation = particles - particles.mean(0)
    mix = _normal((len(particles), len(particles)), particles, generator)
    return particles + math.sqrt(share / (len(particles) - 1)) * mix @ deviation


def _normal(shape: tuple[int, int], like: Tensor, generator: torch.Generator) -> Tensor:
    return torch.randn(shape, generator=generator, dtype=like.dtype, device=like.device)


def _require_start(hypotheses: tuple[Tensor, Tensor], spread: Tensor) -> None:
    for name, value in (("hypotheses[0]", hypotheses[0]), ("hypotheses[1]", hypotheses[1])):
        if value.shape != spread.shape:
            raise InputError(
                f"{name} has shape {tuple(value.shape)} but spread {tuple(spread.shape)}; "
                f"give one number for each released parameter"
            )
        if not bool(value.isfinite().all()):
            raise InputError(f"{name} is not finite; give a pose that was solved or predicted")
    if spread.ndim != 1 or len(spread) == 0:
        raise InputError(f"spread has shape {tuple(spread.shape)}; it must be (h,), h at least 1")
    if not bool((spread.isfinite() & (spread > 0)).all()):
        raise InputError("spread must be finite and positive in every dimension")
