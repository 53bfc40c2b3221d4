"""Contours of a body of Gaussians meet the edges of images: nothing of the background is known.

The section of Rhodin et al. 2016 that defines its contour energy (5.2) is not in the text we have.
What follows is ours, in the spirit of what its authors and others say of it; docs/contours.md
derives it and compares its parts.

With the share B of the background that is seen through the body (``perfcap.render.density``), the
contour of the body is where B changes. Along it runs ``grad B``; what is seen there is
``grad I``. At an angle alpha between the two,

    E_sim  = - sum_pixels |grad B| |grad I| cos(2 alpha)
    E_flat =   sum_pixels |grad B| max(0, low - |grad I|)

reward contours along edges of either polarity, and make those expensive that cross flat parts of
the image. Both are linear in ``|grad B| (1, cos 2 beta, sin 2 beta)`` with the direction beta of
``grad B``: three numbers a pixel say all that matters of an image, whatever made them
(``perfcap.segment.edge_field`` does; a network may).

``|grad B|`` across a contour sums to one, so the energy is an integral along the contour, in
pixels. In pixel units (one percent of the person's height) it does not depend on the resolution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.shaped_volume import ShapedGaussians
from perfcap.actor.volume import GaussianCentres, Volume
from perfcap.energy import _contour_torch
from perfcap.energy._arguments import require_cameras, require_unit
from perfcap.energy._contour_fields import (
    Field,
    FlatField,
    FreeField,
    numbers,
    recorded,
    require_images,
    strength,
    whole,
)
from perfcap.energy._contour_pulls import Pulls
from perfcap.energy._contour_twice import ImageSlopes, bend_images
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import is_plain
from perfcap.render import _density_torch
from perfcap.render.density import LEAST, Splats, optical_depth
from perfcap.solve.majorized import Expansion, Majorized

_OUTLINE = 2.7  # squared distance of the outline from the middle of a Gaussian, squared deviations


class DensityContour(Majorized[Any]):
    """E_sim + E_flat of all frames and views, per pixel unit of contour.

    As a loss it is differentiable in centres, deviations, densities, cameras and the fields. To
    the solver it is a pull on every Gaussian: its slope, and the curvature that edges of the width
    ``1 / sqrt(bend)`` would have, across the contour; nothing is pulled along it.

    Args:
        points: centres of the Gaussians, such as ``GaussianCentres``; or centres and logarithms of
            widths, such as ``ShapedGaussians``: then the optical depth of a ray through the middle
            of each stays.
        volume: their deviations and densities.
        cameras: C views in pixels of the images, (C,) or (F, C).
        fields: ``[F][C]``, one for each image.
        weight: of the energy.
        unit: pixels that count as one, a number or (C,).
        bend: curvature of an edge of strength one, px^-2.
        offset: added to every frame; see ``Majorized``.
        shift: by how much Gaussians have moved in an image that was taken a little later than
            the others of its frame, (F, C, Q, 2) px; None for none.

    Raises:
        InputError: numbers of Gaussians, frames or views that do not fit, or edges and prices of
            different pixels.
    """

    deviations: Tensor
    densities: Tensor
    scale: Tensor
    shift: Tensor | None

    def __init__(
        self,
        points: GaussianCentres | ShapedGaussians,
        volume: Volume,
        cameras: Camera,
        fields: Sequence[Sequence[Field]],
        weight: float | Tensor = 1.0,
        unit: float | Tensor = 1.0,
        *,
        bend: float = 0.25,
        offset: float = 0.0,
        shift: Tensor | None = None,
    ) -> None:
        super().__init__(points, weight, offset)
        require_unit(unit)
        require_cameras(cameras)
        if volume.count != points.count or any(len(row) != cameras.views for row in fields):
            raise InputError(
                f"contours have {points.count} points of {volume.count} Gaussians, and fields of "
                f"{sorted({len(row) for row in fields})} views for {cameras.views} cameras; "
                "expected the same numbers"
            )
        require_images(fields)
        moved = (len(fields), cameras.views, points.count, 2)
        if shift is not None and shift.shape != moved:
            raise InputError(f"shift of contours is {tuple(shift.shape)}, expected {moved}")
        self.cameras, self.fields, self.bend = cameras, fields, bend
        self.register_buffer("deviations", volume.deviations)
        self.register_buffer("densities", volume.densities)
        scale = (1 / torch.as_tensor(unit)).to(volume.deviations).expand(cameras.views)
        self.register_buffer("scale", scale.contiguous())
        self.register_buffer("shift", shift)

    def lengths(self, points: Tensor) -> Tensor:
        """Contour of each frame (F,) about points (F, Q, 3), views added up, in units."""
        return self._priced(FlatField).values(points.detach())

    def support(self, points: Tensor) -> Tensor:
        """Share of each frame's contour that edges explain, (F,), -1 to 1, about points (F, Q, 3).

        ``|grad I| cos(2 alpha)`` over the strongest edge, averaged along the contour: nothing in a
        plain image, and nothing where texture has every direction.
        """
        along = -self._priced(FreeField).values(points.detach())
        return along / (self._strongest() * self.lengths(points)).clamp(min=1e-9)

    def lower_bound(self, points: Tensor) -> float:
        """What no frame's energy is below about points (F, Q, 3), unless contours grow by half."""
        best = self._most(lambda each: strength(each) - numbers(each.flat))
        return -1.5 * best * float(self.lengths(points).nan_to_num(0).amax())

    def _strongest(self) -> float:
        return self._most(strength)

    def _most(self, of: Callable[[Field], NDArray[Any]]) -> float:
        """Largest value of a function of the fields' pixels; 0 where there are none."""
        whole = (each for row in self.fields for each in row if 0 not in each.flat.shape)
        return max((float(of(each).max()) for each in whole), default=0.0)

    def _priced(self, kind: Callable[[Field], Field]) -> DensityContour:
        """The same contours in other fields, of weight one."""
        other = copy(self)
        other.fields = [[kind(each) for each in row] for row in self.fields]
        return other

    def values(self, points: Tensor) -> Tensor:
        """The energy of each frame, (*b, F)."""
        self._require_frames(points)
        if points.ndim > 3:
            return torch.stack([self.values(each) for each in points])
        splats = self._splats(points)
        if self._compiled_for(points):
            return Pulls(splats.detach(), self.fields, self.scale).value + self._unknown(points)
        rows = [
            torch.stack([self._energy(splats, f, c) for c in range(self.cameras.views)])
            for f in range(len(self.fields))
        ]
        return torch.stack(rows) @ self.scale.to(points) + self._unknown(points)

    def expand(self, points: Tensor) -> Expansion:
        """Value, slope in the centres, and curvature across the contour."""
        self._require_frames(points)
        if points.ndim > 3:
            parts = [self.expand(each) for each in points]
            return Expansion(
                torch.stack([part.value for part in parts]),
                torch.stack([part.gradient for part in parts]),
                torch.stack([part.curvature for part in parts]),
            )
        with torch.enable_grad():
            free = points.detach().requires_grad_()
            splats = self._splats(free)
        if self._compiled_for(points.detach()):
            pulls = Pulls(splats.detach(), self.fields, self.scale, self.bend)
            value, curved = pulls.value + self._unknown(points), pulls.curved
            with torch.enable_grad():
                total = pulls.on(splats)
        else:
            with torch.enable_grad():
                value = self.values(free)
                total = value.sum() + 0 * free.sum()  # also where nothing is seen
            curved = self._curved(splats.detach())
        (gradient,) = torch.autograd.grad(total, free)
        _, slope = self.cameras.linearize(points[..., :3].detach())
        xx, xy, yy = (self.scale.to(curved)[:, None, None] * curved).unbind(-1)
        bend = torch.stack((torch.stack((xx, xy), -1), torch.stack((xy, yy), -1)), -2)
        bent = (slope.mT @ bend @ slope).sum(-4)
        if points.shape[-1] == 4:
            bent = _with_width(bent, xx + yy, splats.detach())
        return Expansion(value.detach(), gradient, bent)

    def slope(self, points: Tensor) -> Tensor:
        """Gradient in the points, differentiable in all that the energy holds and in the points."""
        self._require_frames(points)
        if not self._by_image(points):
            return super().slope(points)
        if points.ndim > 3:
            return torch.stack([self.slope(each) for each in points])
        with torch.enable_grad():
            at = points if points.requires_grad else points.detach().requires_grad_()
            return self._slope_of(self._gaussians(at), at)

    def second_derivative(self, points: Tensor, moves: Tensor) -> Tensor:
        """Second derivative along moves of the points; see ``Majorized``."""
        if not self._by_image(points):
            return super().second_derivative(points, moves)
        if points.ndim > 3:
            pairs = zip(points, moves, strict=True)
            return torch.stack([self.second_derivative(*each) for each in pairs])
        with torch.enable_grad():
            at = points.detach().requires_grad_()
            splats = self._gaussians(at)
            slope = self._slope_of(splats, at, splats.detach())
            # each Gaussian on its own: entries of all of them make one pass
            own = [torch.autograd.grad(e.sum(), at, retain_graph=True)[0] for e in slope.unbind(-1)]
        none = points.new_zeros(points.shape[-1])
        each = torch.func.jacfwd(lambda move: self._gaussians(points.detach() + move))(none)
        along = each @ moves.unsqueeze(-4)  # F C Q 6 K
        images = bend_images(splats.detach().flatten(0, 1), self._whole(at), along.flatten(0, 1))
        bent = images.view(*along.shape[:2], *images.shape[1:])
        bent = (self.scale.to(bent)[:, None, None] * bent).sum(1)
        return bent + (moves.mT @ torch.stack(own, -1) @ moves).sum(-3)

    def _slope_of(self, splats: Tensor, points: Tensor, held: Tensor | None = None) -> Tensor:
        """Gradient in the points that Gaussians were made of; images see those ``held``."""
        seen = (splats if held is None else held).flatten(0, 1)
        pulls: Tensor = ImageSlopes.apply(seen, *self._whole(splats))  # type: ignore[no-untyped-call]
        pulls = self.scale.to(pulls)[:, None, None] * pulls.view_as(splats)
        return torch.autograd.grad(splats, points, pulls, create_graph=True)[0]

    def _gaussians(self, points: Tensor) -> Tensor:
        """Centre, form and thickness in pixels of the fields, (F, C, Q, 6)."""
        splats = self._splats(points)
        first = [[each.corner[::-1] for each in row] for row in self.fields]
        centre = splats.centre - splats.centre.new_tensor(first)[:, :, None]
        return torch.cat((centre, splats.form, splats.thickness[..., None]), -1)

    def _whole(self, like: Tensor) -> list[Tensor]:
        return [whole(each, like) for row in self.fields for each in row]

    def _by_image(self, points: Tensor) -> bool:
        """Whether kernels look at one image after the other."""
        return is_plain(*(e.detach() for e in (points, self.deviations, self.cameras.translation)))

    def _splats(self, points: Tensor) -> Splats:
        width, density = (each.to(points) for each in (self.deviations, self.densities))
        if points.shape[-1] == 4:
            thickness, width = width * density, points[..., 3].exp()
            density = thickness / width
        splats = Splats.seen_by(self.cameras, points[..., :3], width, density)
        if self.shift is None:
            return splats
        return replace(splats, centre=splats.centre + self.shift.to(points))

    def _unknown(self, points: Tensor) -> Tensor:
        """0 of each frame, (F,), and NaN where a Gaussian or a camera is not a finite number.

        Images leave out what is none, so that nothing would be as good as the best contour.
        """
        cameras, shift = self.cameras, self.shift
        views = [cameras.intrinsics, cameras.rotation, cameras.translation]
        of_frames = [
            points,
            *([] if shift is None else [shift]),
            *(views if cameras.moving else []),
        ]
        of_all = [self.deviations, self.densities, *([] if cameras.moving else views)]
        total = torch.stack([each.sum().to(points) for each in of_all]).sum()
        total = total + torch.stack([e.flatten(1).sum(1).to(points) for e in of_frames]).sum(0)
        return (0 * total).detach()

    def _compiled_for(self, points: Tensor) -> bool:
        wanted = torch.is_grad_enabled() and any(recorded(e) for row in self.fields for e in row)
        return not wanted and is_plain(points, self.deviations, self.cameras.translation)

    def _require_frames(self, points: Tensor) -> None:
        if points.shape[-3] != len(self.fields):
            raise InputError(
                f"contours have fields of {len(self.fields)} frames but the motion has "
                f"{points.shape[-3]}; give those of the same frames"
            )

    def _image(self, splats: Splats, frame: int, view: int) -> tuple[Tensor, ...]:
        """Splats, edges and price of an image, in pixels of the field."""
        field, like = self.fields[frame][view], splats.centre
        first = like.new_tensor([field.corner[1], field.corner[0]])
        edges, flat = (torch.as_tensor(part).to(like) for part in (field.edges, field.flat))
        centre, form, thick = (
            each[frame, view][None] for each in (splats.centre, splats.form, splats.thickness)
        )
        return centre - first, form, thick, edges, flat

    def _energy(self, splats: Splats, frame: int, view: int) -> Tensor:
        """Of one image, differentiable."""
        *shapes, edges, flat = self._image(splats, frame, view)
        if not flat.numel():
            return flat.sum()
        centre, form, thickness = shapes
        depth, slope = optical_depth(centre, form, thickness, (flat.shape[0], flat.shape[1]))
        return _contour_torch.contour(depth[0], slope[0], edges, flat).sum()

    def _curved(self, splats: Splats) -> Tensor:
        """Curvature for a shift of each splat, entries xx, xy, yy, (F, C, Q, 3)."""
        found = torch.zeros_like(splats.form)
        for frame in range(found.shape[0]):
            for view in range(found.shape[1]):
                *shapes, edges, flat = self._image(splats, frame, view)
                centre, form, thickness = shapes
                size = (flat.shape[0], flat.shape[1])
                depth, slope = _density_torch.draw(centre, form, thickness, size, LEAST)
                bent = _contour_torch.curvature(depth[0], slope[0], edges, flat, self.bend)
                bent = torch.where(depth[0] > 0, bent, 0.0)[None]
                found[frame, view] = _density_torch.gather(centre, form, thickness, bent, LEAST)[0]
        return found


def _with_width(bent: Tensor, across: Tensor, splats: Splats) -> Tensor:
    """Curvature (F, Q, 4, 4) where widths are unknown as well.

    A width that grows by a share moves the outline by that share of its distance from the middle.

    Args:
        bent: in the centres, (F, Q, 3, 3).
        across: in a move of the outline, px^-2, (F, C, Q).
        splats: (F, C, Q).
    """
    determinant = splats.form[..., 0] * splats.form[..., 2] - splats.form[..., 1].square()
    variance = determinant.clamp(min=1e-12).rsqrt()  # px^2
    width = (_OUTLINE * variance * across).sum(-2)
    whole = bent.new_zeros(*bent.shape[:-2], 4, 4)
    # what moves the middle and the width at once counts twice at most
    whole[..., :3, :3], whole[..., 3, 3] = bent, width
    return 2 * whole
