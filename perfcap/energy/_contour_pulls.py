"""Contour energies of images by compiled kernels: value, slope and curvature in every Gaussian."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.energy._contour_fields import Field, numbers
from perfcap.render.density import LEAST, Splats

Floats = NDArray[np.float64]


class Pulls:
    """What all images say of their splats, by the compiled kernels.

    Args:
        splats: (F, C, Q), without a graph.
        fields: ``[F][C]``.
        scale: of the energy of each view, (C,).
        bend: curvature of an edge of strength one, px^-2; None for the value alone.

    Attributes:
        value: of each frame, (F,).
        curved: of each splat, entries xx, xy, yy, (F, C, Q, 3).
    """

    def __init__(
        self,
        splats: Splats,
        fields: Sequence[Sequence[Field]],
        scale: Tensor,
        bend: float | None = None,
    ) -> None:
        like, splats = splats.centre, splats.map(Tensor.double)
        scale = scale.double()
        value, curved = scale.new_zeros(len(fields)), torch.zeros_like(splats.form)
        of = [torch.zeros_like(e) for e in (splats.centre, splats.form, splats.thickness)]
        for frame, row in enumerate(fields):
            for view, field in enumerate(row):
                first = splats.centre.new_tensor([field.corner[1], field.corner[0]])
                shapes = (
                    (splats.centre[frame, view] - first).numpy(),
                    splats.form[frame, view].numpy(),
                    splats.thickness[frame, view].numpy(),
                )
                a, b, c, d = (each[frame, view].numpy() for each in (*of, curved))
                into = None if bend is None else (a, b, c, d)
                value[frame] += scale[view] * _look(shapes, field, bend, into)
        self.value, self.curved = value.to(like), curved.to(like)
        weights = (scale.reshape(-1, *[1] * (each.ndim - 2)) for each in of)
        self._of = [(weight * each).to(like) for weight, each in zip(weights, of, strict=True)]

    def on(self, splats: Splats) -> Tensor:
        """A number whose gradient in the splats is that of the energy."""
        parts = (splats.centre, splats.form, splats.thickness)
        sums = [(pull * part).sum() for pull, part in zip(self._of, parts, strict=True)]
        return torch.stack(sums).sum()


def _look(
    shapes: tuple[Floats, Floats, Floats],
    field: Field,
    bend: float | None,
    into: tuple[Floats, Floats, Floats, Floats] | None,
) -> float:
    """Energy of one image; its derivatives are written ``into`` arrays."""
    from perfcap.energy import _contour_rows_numba

    edges, flat = numbers(field.edges), numbers(field.flat)
    found = into or tuple(np.empty_like(each) for each in (*shapes, shapes[1]))
    stiff = 0.0 if bend is None else bend
    value: float = _contour_rows_numba.look(
        shapes, LEAST, edges, flat, stiff, into is not None, found[:3], found[3]
    )
    return value
