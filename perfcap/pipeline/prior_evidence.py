"""How stiff the trajectory prior of a solved window should be: the evidence decides.

Around a solution the data are a Gaussian likelihood. With y the features of the trajectory prior in
the cosine basis, k counting cosines, B the mean over frames of the data's curvature in the
features, and b_k = B y_k - g_k with the gradient g of the data,

    y_k ~ N(0, diag(1 / (s q_k))),      likelihood ~ exp(-(y_k' B y_k) / 2 + b_k' y_k),

where q_k is the penalty of cosine k and s a factor for each feature: one for the translation, one
for the rotation, one for each angle. The s of largest evidence, the integral over y, is found by
expectation maximisation (Dempster et al. 1977; MacKay 1992; Tipping 2001, "relevance"): in turn
the posterior moments of y_k, and

    s_e = (n + number of cosines) / (n / s0 + sum_k q_k E[y_ke^2]),

a Gamma prior that counts as n cosines of the first solve's stiffness s0. That the curvature is
averaged over frames makes cosines independent, as in Whittle's likelihood (1953), and every
iteration one eigenvalue problem of 34 x 34.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy.trajectory import Trajectory
from perfcap.pipeline.config import PoseConfig
from perfcap.solve import Objective
from perfcap.solve.assembly import assemble
from perfcap.temporal.subspace import dct_basis

_ITERATIONS = 15
_NOT_DATA = ("trajectory", "prior", "poses")
_TINY = 1e-12


@torch.no_grad()
def evident_stiffness(objective: Objective, motion: Motion, config: PoseConfig) -> Tensor:
    """Factors on the curvature of translation, rotation and each angle, (N, 2 + A).

    Args:
        objective: of windows, whose ``trajectory`` has the rank and the edge of the second solve.
        motion: the solution of the first, (N, F).
        config: says how the first one's prior was, and how far it counts.
    """
    trajectory = objective.energies["trajectory"]
    assert isinstance(trajectory, Trajectory)
    curvature, information = _likelihood(objective, trajectory, motion)
    weight = trajectory.weight.to(curvature).reshape(-1, 1)
    seen = (1 - trajectory.keep).square().to(curvature)
    rest = motion.frames - len(seen)
    penalty = weight * torch.cat((seen, seen.new_ones(rest)))
    stated = config.evidence.rank / config.trajectory.rank
    start = stated ** (2 * config.evidence.edge)
    found = _maximize(curvature, information, penalty, start, config.evidence.strength)
    return config.evidence.share * torch.where(found.isfinite(), found, start)


def _likelihood(
    objective: Objective, trajectory: Trajectory, motion: Motion
) -> tuple[Tensor, Tensor]:
    """B (N, E, E) and b (N, F, E) of the data around a motion (N, F)."""
    data = Objective({n: e for n, e in objective.items() if n not in _NOT_DATA})
    equations = assemble(data, motion)
    features, jacobian = trajectory.linearize_features(motion)
    # columns are orthogonal, so this is the pseudoinverse, transposed
    back = jacobian / jacobian.square().sum(-2, keepdim=True).clamp(min=_TINY)
    curvature = (back @ equations.curvature @ back.mT).mean(-3)
    pull = (back @ equations.frame_gradient.unsqueeze(-1)).squeeze(-1)
    basis = dct_basis(motion.frames, dtype=features.dtype, device=features.device)
    information = (basis @ features) @ curvature - basis @ pull
    return curvature.nan_to_num(), information.nan_to_num()


def _maximize(
    curvature: Tensor, information: Tensor, penalty: Tensor, start: float, strength: float
) -> Tensor:
    """Stiffness of each group of features, (N, G), by expectation maximisation.

    With s = S^2 and S^-1 B S^-1 = U L U', the posterior covariance of cosine k is
    ``S^-1 U (L + q_k)^-1 U' S^-1``. The constant cosine has no penalty and tells nothing.
    """
    count = curvature.shape[-1]
    group = torch.tensor([0] * 3 + [1] * 4 + list(range(2, count - 5)), device=curvature.device)
    member = torch.nn.functional.one_hot(group).to(curvature)  # E G
    told, penalty = information[..., 1:, :], penalty[..., 1:].unsqueeze(-2)  # N 1 K
    cosines = penalty.shape[-1] * member.sum(0)
    factor = curvature.new_full((len(curvature), member.shape[-1]), start)
    for _ in range(_ITERATIONS):
        root = (factor @ member.mT).rsqrt().unsqueeze(-1)  # N E 1
        values, vectors = torch.linalg.eigh(root * curvature * root.mT)
        spread = 1 / (values.clamp(min=0).unsqueeze(-1) + penalty + _TINY)  # N E K
        axes = root * vectors
        mean = axes @ (spread * (axes.mT @ told.mT))
        second = mean.square() + axes.square() @ spread
        size = (penalty * second).sum(-1) @ member
        factor = (strength + cosines) / (strength / start + size)
    return factor
