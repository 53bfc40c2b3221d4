"""Columns of the inverse matrix at some unknowns, kept as halves so that more can join."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve.factorization import Factorization


@dataclass(frozen=True)
class InverseColumns:
    """``E' H^-1 E`` for unit vectors E, as a sum of squares: nothing cancels.

    Args:
        index: unknowns, (B, m).
        usable: which of them are meant; the others are padding, (B, m).
        frame: their frames, (B, m); anything for shared unknowns.
        own: ``L_f^-1 e`` in the frame's own factor, zero for shared unknowns, (B, m, D).
        common: the same in the factors of what couples frames, (B, m, rows).
    """

    index: Tensor
    usable: Tensor
    frame: Tensor
    own: Tensor
    common: Tensor

    @classmethod
    def at(cls, factorization: Factorization, index: Tensor, usable: Tensor) -> InverseColumns:
        """Columns at unknowns (B, m)."""
        layout = factorization.layout
        batch = torch.arange(len(index), device=index.device)[:, None]
        in_frame = (index < layout.frame_unknowns).unsqueeze(-1)  # B m 1
        place = index.clamp(max=layout.frame_unknowns - 1)
        frame = place.div(layout.frame_dim, rounding_mode="floor")
        inner = place - frame * layout.frame_dim
        own = factorization.frame_half(batch, frame, inner) * in_frame
        common = own[..., :0]
        if factorization.window is not None:
            window = factorization.window.half_rows(batch, frame, inner) * in_frame
            common = torch.cat((common, window), -1)
        if factorization.shared is not None:
            common = torch.cat((common, factorization.shared.half_rows(batch, index)), -1)
        return cls(index, usable, frame, own, common)

    def join(self, other: InverseColumns) -> InverseColumns:
        """These columns and others of the same factorization."""
        return InverseColumns(
            torch.cat((self.index, other.index), 1),
            torch.cat((self.usable, other.usable), 1),
            torch.cat((self.frame, other.frame), 1),
            torch.cat((self.own, other.own), 1),
            torch.cat((self.common, other.common), 1),
        )

    def block(self) -> Tensor:
        """``E' H^-1 E``, (B, m, m)."""
        together = self.frame.unsqueeze(-1) == self.frame.unsqueeze(-2)
        return (self.own @ self.own.mT) * together + self.common @ self.common.mT
