"""A round of conjugate gradients in torch: for GPUs, and what the kernels must equal."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.solve.search import Search


def invert(diagonal: Tensor, damping: Tensor, running: Tensor, inverse: Tensor) -> None:
    """Write inverses (P, M, q, q) of diagonal blocks, lower triangles, plus a damping (P, M, q).

    A block that rounding has left indefinite is inverted as if it were diagonal; the identity
    stands in for those of problems that do not run.
    """
    eye = torch.eye(diagonal.shape[-1]).to(diagonal)
    plain = diagonal.diagonal(dim1=-2, dim2=-1) + damping
    damped = diagonal + damping.unsqueeze(-1) * eye
    factor, failed = torch.linalg.cholesky_ex(
        torch.where(running[:, None, None, None], damped, eye)
    )
    good = (failed == 0)[..., None, None]
    exact = torch.cholesky_inverse(torch.where(good, factor, eye))
    rough = torch.where(plain > 0, 1 / plain, 1).unsqueeze(-1) * eye
    inverse.copy_(torch.where(good, exact, rough))


class Rounds:
    """The two halves of a round; in between, ``search.product`` may be corrected."""

    def __init__(self, search: Search) -> None:
        self.search = search

    def go(self) -> None:
        """Go along the direction to the minimum of each running problem.

        The preconditioned residual there takes the place of the product.
        """
        search = self.search
        product = search.product + search.damping * search.direction
        bend = (search.direction * product).sum((-2, -1))
        search.running.logical_and_(bend > 0)
        running = search.running[:, None, None]
        length = torch.where(search.running, search.slope / bend, 0)[:, None, None]
        search.step.add_(torch.where(running, length * search.direction, 0))
        search.residual.sub_(torch.where(running, length * product, 0))
        search.rounds.add_(search.running)
        search.running.logical_and_(length.flatten() * search.slope > search.worth)
        self.precondition()

    def precondition(self) -> None:
        """Write the residual as the diagonal blocks see it to ``product``."""
        search = self.search
        image = (search.preconditioner @ search.residual.unsqueeze(-1)).squeeze(-1)
        search.product.copy_(image)

    def turn(self) -> None:
        """Find the direction conjugate to those before, from the preconditioned residual.

        The first one, for which ``slope`` is zero, is that residual.
        """
        search, running = self.search, self.search.running
        slope = (search.residual * search.product).sum((-2, -1))
        ratio = torch.where(search.slope > 0, slope / search.slope, 0)[:, None, None]
        search.direction.mul_(ratio).add_(search.product)
        search.slope.copy_(torch.where(running, slope, search.slope))
        running.logical_and_(slope > search.enough)
        search.product.zero_()
