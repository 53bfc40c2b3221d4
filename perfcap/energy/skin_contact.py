"""Skins of two people that do not pass through each other."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy._arguments import require_confidence, require_unit
from perfcap.errors import InputError
from perfcap.geometry.plain import is_readable
from perfcap.solve.compound import Compound
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel

_UNIT = 1e-3  # how far the length of a normal may be from one


class SkinContact(Energy[Compound]):
    """Depth of one person's points below the other's skin, one-sided and soft; not in the papers.

    A residual group is one pair, ``max(0, n . (q - p) - allowed) / unit``: p of one person, q the
    place on the other's skin that is nearest to it and n the normal there, out of the body, which
    stays what it was when the pairs were found. Both people move: two named parts of a state.

    Args:
        names: of both people's motions in the state; that of p first.
        inside: the points p, N a frame.
        skin: the points q.
        normals: n, (*b, F, N, 3), unit vectors in the world.
        confidence: of the pairs, (*b, F, N); 0 for those that pad a list. 1 if not given.
        allowed: depth of the pairs that costs nothing, (*b, F, N), metres; 0 if not given.
        weight: of the energy.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one.

    Raises:
        InputError: points and normals that do not fit each other, or of another length than one;
            negative confidence.
    """

    coupling = Coupling.FRAME
    normals: Tensor
    confidence: Tensor | None
    allowed: Tensor | None

    def __init__(
        self,
        names: tuple[str, str],
        inside: SkinnedPoints,
        skin: SkinnedPoints,
        normals: Tensor,
        confidence: Tensor | None = None,
        allowed: Tensor | None = None,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float = 1.0,
    ) -> None:
        counts = {inside.count, skin.count, normals.shape[-2]}
        given = [each for each in (confidence, allowed) if each is not None]
        fits = all(each.shape == normals.shape[:-1] for each in given)
        if len(counts) != 1 or normals.shape[-1] != 3 or not fits or names[0] == names[1]:
            raise InputError(
                f"contact of {names[0]!r} and {names[1]!r} has {inside.count} and {skin.count} "
                f"points and normals {tuple(normals.shape)}; give two people, and as many points "
                "of each, (*b, F, N, 3), and confidences or depths (*b, F, N)"
            )
        require_unit(unit)
        _require_normals(normals, confidence)
        super().__init__(weight, kernel)
        self.names, self.inside, self.skin, self.unit = names, inside, skin, unit
        self.register_buffer("normals", normals)
        self.register_buffer("confidence", confidence)
        self.register_buffer("allowed", allowed)

    def residual(self, state: Compound) -> Residual:
        """(*b, F, N, 1)."""
        one, other = (state.parts[name] for name in self.names)
        return Residual(self._depth(self.inside(one), self.skin(other)), self.confidence)

    def linearize(self, state: Compound) -> Linearization:
        """Closed form: derivatives of both points along the normal; none where nothing touches."""
        one, other = (state.parts[name] for name in self.names)
        along = self.normals.unsqueeze(-2)  # *b F N 1 3
        inside, moves, _ = self.inside.linearize(one, along)
        skin, yields, _ = self.skin.linearize(other, along)
        depth = self._depth(inside, skin)
        frame = depth.new_zeros(*depth.shape, state.frame_dim)
        touches = (depth > 0).unsqueeze(-1) / self.unit
        frame[..., state.columns(self.names[0])] = -touches * moves
        frame[..., state.columns(self.names[1])] = touches * yields
        return Linearization(Residual(depth, self.confidence), frame)

    def _depth(self, inside: Tensor, skin: Tensor) -> Tensor:
        below = torch.einsum("...k,...k->...", self.normals, skin - inside)
        below = below if self.allowed is None else below - self.allowed
        return below.clamp(min=0).unsqueeze(-1) / self.unit


def _require_normals(normals: Tensor, confidence: Tensor | None) -> None:
    """Refuse normals of another length than one where they count, and negative confidences."""
    if confidence is not None:
        require_confidence(confidence)
    if not is_readable(normals):
        return
    length = torch.linalg.vector_norm(normals.detach(), dim=-1)
    length = length if confidence is None else length[confidence > 0]
    if not bool(((length - 1).abs() < _UNIT).all()):
        raise InputError("contact: normals are not of length one everywhere; divide by the norm")
