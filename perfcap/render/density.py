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
from perfcap.geometry.plain import is_plain
from perfcap.geometry.record import Record
from perfcap.render import _density_torch
from perfcap.render.label_map import require_image_size

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
    lead = splats.thickness.shape[:-1]
    _check(splats.centre, splats.form, splats.thickness, size)
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
    _check(centre, form, thickness, size)
    if centre.dtype != torch.float64 or not is_plain(centre.detach()):
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


def _check(centre: Tensor, form: Tensor, thickness: Tensor, size: tuple[int, int]) -> None:
    lead = thickness.shape
    if centre.shape != (*lead, 2) or form.shape != (*lead, 3):
        raise InputError(
            f"splats have centre {tuple(centre.shape)}, form {tuple(form.shape)} and "
            f"thickness {tuple(lead)}; expected (*b, Q, 2), (*b, Q, 3) and (*b, Q)"
        )
    require_image_size(size)


# --- How much of each Gaussian does a pixel see? Visibility in an absorbing medium ----------------
#
# Along a ray the light that arrives from depth s is ``T(s) = exp(-tau(s))`` with the optical depth
# in front of it. A Gaussian's visibility is the integral of T times its own density (Rhodin et al.
# 2015, Eq. 3): what it absorbs. Those of all Gaussians and of the background add up to one.

STEPS = 48  # intervals along a ray
_REACH = 3.5  # deviations of a Gaussian on either side of its middle
_FAINT = 1e-3  # optical depth of a Gaussian that a ray does not touch
_CHUNK = 1 << 22  # numbers at once


def visibilities(
    camera: Camera, points: Tensor, deviations: Tensor, densities: Tensor, pixels: Tensor
) -> tuple[Tensor, Tensor]:
    """What pixels see of Gaussians, and of what is behind them.

    Within an interval of the ray, the light it absorbs is shared out by optical depth.

    Args:
        camera: of one view at one time, batch (1,).
        points: centres in the world, (Q, 3) m.
        deviations: (Q,) m.
        densities: in the middle of each, (Q,) 1/m.
        pixels: (P, 2).

    Returns:
        Visibility of each Gaussian (P, Q) and of the background (P,): each row adds up to one.
    """
    local = camera.to_camera(points)[0]
    plane = camera.to_plane(pixels[None])[0]
    rays = torch.nn.functional.normalize(torch.nn.functional.pad(plane, (0, 1), value=1.0), dim=-1)
    chunk = max(1, _CHUNK // (len(points) * (STEPS + 1)))
    parts = [_seen(local, deviations, densities, some) for some in torch.split(rays, chunk)]
    return torch.cat([seen for seen, _ in parts]), torch.cat([left for _, left in parts])


def _seen(
    local: Tensor, deviations: Tensor, densities: Tensor, rays: Tensor
) -> tuple[Tensor, Tensor]:
    """Visibilities (P, Q), background (P,), of Gaussians (Q, 3) in camera axes on rays (P, 3)."""
    middle = rays @ local.mT  # P Q
    squared = (local.square().sum(-1) - middle.square()).clamp(min=0)
    thickness = math.sqrt(2 * math.pi) * deviations * densities
    thickness = thickness * torch.exp(-0.5 * squared / deviations.square())
    thickness = torch.where(middle > 2 * NEAR, thickness, 0.0)
    touched = thickness > _FAINT
    near = torch.where(touched, middle - _REACH * deviations, torch.inf).amin(-1)
    far = torch.where(touched, middle + _REACH * deviations, -torch.inf).amax(-1)
    empty = ~touched.any(-1)
    near, far = torch.where(empty, 0.0, near), torch.where(empty, 1.0, far)
    share = torch.linspace(0, 1, STEPS + 1, dtype=rays.dtype, device=rays.device)
    depth = near[:, None] + (far - near)[:, None] * share  # P K
    place = (depth[:, :, None] - middle[:, None]) / deviations  # P K Q
    passed = thickness[:, None] * torch.special.ndtr(place)
    # tails beyond the ends belong to the first and the last interval
    passed = torch.cat((0 * passed[:, :1], passed[:, 1:-1], thickness[:, None]), 1)
    each = passed.diff(dim=1)  # P K-1 Q
    light = torch.exp(-passed.sum(-1))  # P K
    lost = -light.diff(dim=1)
    whole = each.sum(-1).clamp(min=1e-12)
    seen = ((lost / whole)[..., None] * each).sum(1)
    return seen, light[:, -1]
