"""What is left of the background behind a body of Gaussians? Ray casting in an absorbing medium.

A body is a density ``sum_q c_q exp(-|x - mu_q|^2 / (2 sigma_q^2))`` per metre that absorbs light
(Rhodin et al. 2015 and 2016). Along a ray a Gaussian integrates in closed form, so that the share
of the background that is still seen, and its slope across the image, are

    B = exp(-sum_q sqrt(2 pi) sigma_q cbar_q),    grad B = -B grad(sum_q sqrt(2 pi) sigma_q cbar_q),

where ``cbar_q = c_q exp(-d_q^2 / (2 sigma_q^2))`` is the largest density of Gaussian q on the ray,
which passes it at the distance ``d_q``. No order, no occlusion to decide: B is smooth in
everything.

In an image, ``d_q^2 / sigma_q^2`` is a quadratic form of the distance from where the centre
projects to, up to the third order in the angle that a Gaussian spans: its inverse is
``sigma_q^2 J J'`` with the derivative J of the projection, so any camera will do, lens distortion
included. A Gaussian of 10 cm at 5 m is wrong by two thousandths of its thickness.

Letters of the paper: B is ``background``, ``sqrt(2 pi) sigma_q c_q`` the ``thickness``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import NEAR, Camera
from perfcap.geometry.record import Record
from perfcap.render import _density_torch
from perfcap.render.label_map import LARGEST

LEAST = 1e-4  # optical depth below which a Gaussian is left out of a pixel


@dataclass(frozen=True)
class Splats(Record):
    """Images of Q Gaussians, themselves Gaussians.

    Attributes:
        centre: where they project to, (*b, Q, 2) px.
        form: entries xx, xy, yy of the inverse covariances, (*b, Q, 3) px^-2.
        thickness: optical depth of a ray through the middle, (*b, Q); 0 behind the camera.
    """

    centre: Tensor
    form: Tensor
    thickness: Tensor

    @classmethod
    def seen_by(
        cls, cameras: Camera, points: Tensor, deviations: Tensor, densities: Tensor
    ) -> Splats:
        """Gaussians in C views; differentiable.

        Args:
            cameras: C views, (C,) or (F, C) or (*b, F, C).
            points: centres in the world, (*b, F, Q, 3) m.
            deviations: standard deviations, (Q,) or (*b, F, Q), m.
            densities: in the middle of each, likewise, 1/m.

        Returns:
            Of batch (*b, F, C).
        """
        pixels, slope = cameras.linearize(points)
        spread = deviations.unsqueeze(-2) if deviations.ndim > 1 else deviations
        thick = math.sqrt(2 * math.pi) * deviations * densities
        thick = thick.unsqueeze(-2) if thick.ndim > 1 else thick
        x, y = slope.unbind(-2)
        variance = spread.square()
        xx, xy, yy = (variance * (a * b).sum(-1) for a, b in ((x, x), (x, y), (y, y)))
        determinant = xx * yy - xy * xy
        form = torch.stack((yy, -xy, xx), -1) / determinant.clamp(min=1e-12).unsqueeze(-1)
        front = cameras.to_camera(points)[..., 2] > 2 * NEAR
        shown = torch.where(front & (determinant > 1e-12), thick, torch.zeros_like(thick))
        return cls(pixels, form, shown)


def background(splats: Splats, size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Share of the background that is seen, (*b, H, W), and its slope in x and y, (*b, 2, H, W).

    Differentiable once in the splats, on any device; on the CPU compiled kernels draw one image
    after the other.

    Raises:
        InputError: an image too large, or splats whose shapes do not fit each other.
    """
    _check(splats, size)
    lead = splats.thickness.shape[:-1]
    centre, form, thickness = (
        each.reshape(-1, *each.shape[len(lead) :]) for each in _fields(splats)
    )
    depth, descent = optical_depth(centre, form, thickness, size)
    left = torch.exp(-depth)
    return left.view(*lead, *size), (left.unsqueeze(-3) * descent).view(*lead, 2, *size)


def optical_depth(
    centre: Tensor, form: Tensor, thickness: Tensor, size: tuple[int, int]
) -> tuple[Tensor, Tensor]:
    """Optical depth (B, H, W) of splats (B, Q) and minus its slope, (B, 2, H, W)."""
    if centre.device.type != "cpu" or centre.dtype != torch.float64:
        return _density_torch.draw(centre, form, thickness, size, LEAST)
    drawn: tuple[Tensor, Tensor] = _Drawn.apply(centre, form, thickness, size)  # type: ignore[no-untyped-call]
    return drawn


class _Drawn(torch.autograd.Function):
    """The compiled kernels as a function that torch can differentiate once."""

    @staticmethod
    def forward(
        ctx: Any, centre: Tensor, form: Tensor, thickness: Tensor, size: tuple[int, int]
    ) -> tuple[Tensor, Tensor]:
        from perfcap.render import _density_numba

        ctx.save_for_backward(centre, form, thickness)
        depth = centre.new_zeros(len(centre), *size)
        slope = centre.new_zeros(len(centre), 2, *size)
        arrays = [each.detach().contiguous().numpy() for each in (centre, form, thickness)]
        for image in range(len(centre)):
            one = (each[image] for each in arrays)
            _density_numba.draw(*one, LEAST, depth[image].numpy(), slope[image].numpy())
        return depth, slope

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *pulls: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:
        from perfcap.render import _density_numba

        saved = [each.contiguous() for each in ctx.saved_tensors]
        found = [torch.empty_like(each) for each in saved]
        on_depth, on_slope = (pull.contiguous().numpy() for pull in pulls)
        for image in range(len(saved[0])):
            _density_numba.pull_back(
                *(each[image].numpy() for each in saved),
                LEAST,
                on_depth[image],
                on_slope[image],
                *(each[image].numpy() for each in found),
            )
        return found[0], found[1], found[2], None


def _fields(splats: Splats) -> tuple[Tensor, Tensor, Tensor]:
    return splats.centre, splats.form, splats.thickness


def _check(splats: Splats, size: tuple[int, int]) -> None:
    lead = splats.thickness.shape
    if splats.centre.shape != (*lead, 2) or splats.form.shape != (*lead, 3):
        raise InputError(
            f"splats have centre {tuple(splats.centre.shape)}, form {tuple(splats.form.shape)} and "
            f"thickness {tuple(lead)}; expected (*b, Q, 2), (*b, Q, 3) and (*b, Q)"
        )
    if len(size) != 2 or not all(1 <= side <= LARGEST for side in size):
        raise InputError(f"size is {size}; expected height and width from 1 to {LARGEST} pixels")
