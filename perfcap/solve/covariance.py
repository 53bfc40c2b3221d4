"""How well shared unknowns are known at a minimum."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.solve.assembly import assemble
from perfcap.solve.energy import Objective, State
from perfcap.solve.factorization import factorize

_RIDGE = 1e-9  # of the mean curvature of a frame, for what no energy sees


def shared_covariance(objective: Objective, state: State) -> Tensor:
    """Covariance (*b, S, S) of a state's shared unknowns at a minimum of an objective.

    Laplace's approximation: energies are twice negative log likelihoods, so that it is the inverse
    of the Gauss-Newton matrix, here with all frames eliminated, window energies included. Errors
    that frames share, and bounds, are not in it.
    """
    equations = assemble(objective, state)
    layout = equations.layout
    size = equations.curvature.diagonal(dim1=-2, dim2=-1).mean((-2, -1))
    frames = (_RIDGE * size)[:, None].expand(-1, layout.frames * layout.frame_dim)
    none = frames.new_zeros(len(frames), layout.shared_dim)
    factors = factorize(equations, torch.cat((frames, none), -1))
    assert factors.shared is not None
    inverse = torch.cholesky_inverse(factors.shared.cholesky)
    return inverse.reshape(*layout.batch, *inverse.shape[1:])
