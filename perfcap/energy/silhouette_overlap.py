"""Overlap of the rendered silhouette and a mask, pixel by pixel."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from perfcap.energy._arguments import require_cameras, require_frames
from perfcap.energy._outline_rows import OutlineRows, square_root
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import is_plain
from perfcap.geometry.product import multiply_views
from perfcap.render.soft_silhouette import SoftSilhouette, require_size
from perfcap.solve.energy import (
    Coupling,
    Energy,
    Linearization,
    Residual,
    State,
    Step,
    seen_columns,
)
from perfcap.solve.kernels import Kernel, Quadratic

if TYPE_CHECKING:
    from perfcap.solve.sparse import BlockLinearization

Surface = Callable[[Any], Tensor]
Points = Callable[[Tensor, Tensor], Any]


class SilhouetteOverlap(Energy[Any]):
    """Squared difference of coverage and mask (Liu 2013, Eq. 7 and 8; MuVS, Eq. 5; soft form).

    A residual group is a view of a frame: ``sqrt(trust / area) * (coverage - mask)`` at each of
    its pixels, with the area of the mask. Its squared norm is zero for a mask of the same softness
    that fits, and 1 where nothing is drawn. A view with an empty mask counts for nothing.

    As a loss it is differentiable in whatever the surface, the cameras and the masks come from,
    with any first-order method. For Gauss-Newton methods it offers ``linearize`` (a skeleton's
    motion, ``LevenbergMarquardt``) and ``linearize_blocks`` (a deformation graph,
    ``TruncatedNewton``), whose few rows have the value, the gradient and the curvature of all
    pixels. Only pixels within the band about the rendered outline pull, so it refines what already
    overlaps to about a band's width: correspondences of contours come first.

    Args:
        surface: world vertices (*b, F, V, 3) of a state, such as ``actor.surface``; ``sees`` of it,
            if it has that, are the shared blocks that move them.
        silhouette: draws them, in the image size of all views.
        cameras: C views, (C,) or (F, C) or (*b, F, C).
        masks: what should be covered, (*b, F, C, H, W), bool or floats from 0 to 1.
        trust: how much each pixel counts, of a shape that broadcasts to ``masks``; 1 if not given.
        weight: of the energy.
        kernel: acts on the squared norm of a view.
        points: chosen points of the surface, made of vertices (*b, F, N, 1) and weights of the
            same shape, with the derivatives that the method needs: ``partial(SkinnedPoints,
            actor)``, ``partial(EmbeddedPoints, graph, posed)``, of a ``DeformedSurface`` its
            ``points``, or, of a ``ShapedPoints``, ``chosen``. Without it ``linearize``
            differentiates the whole surface, which is much slower.

    Raises:
        InputError: shapes, types or sizes that do not fit.
    """

    coupling = Coupling.FRAME
    masks: Tensor
    scale: Tensor

    def __init__(
        self,
        surface: Surface,
        silhouette: SoftSilhouette,
        cameras: Camera,
        masks: Tensor,
        trust: Tensor | None = None,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        points: Points | None = None,
    ) -> None:
        super().__init__(weight, kernel)
        _check(silhouette, cameras, masks, trust)
        self.surface, self.silhouette, self.cameras = surface, silhouette, cameras
        self.points = points
        self.sees = getattr(surface, "sees", ())
        area = masks.sum((-2, -1), keepdim=True, dtype=_floating(masks))
        scale = torch.where(area > 0, area.clamp_min(1e-6).rsqrt(), 0.0)
        scale = scale if trust is None else scale * trust.to(scale).sqrt()
        self.register_buffer("masks", masks, persistent=False)
        self.register_buffer("scale", scale, persistent=False)

    def residual(self, state: Any) -> Residual:
        """(*b, F, C, H * W)."""
        surface = self.surface(state)
        coverage = self.silhouette.seen_by(self.cameras, surface)
        require_frames(self, self.masks.shape[-4], coverage.shape[-4])
        error = self.scale.to(coverage) * (coverage - self.masks.to(coverage))
        lost = _lost(surface)
        if lost is not None:
            error = torch.where(lost[..., None, None, None], torch.nan, error)
        return Residual(error.flatten(-2))

    def linearize(self, state: Any) -> Linearization:
        """Residual of as many rows a view as there are unknowns and one: (*b, F, C, D + S' + 1).

        Not the rows of ``residual``, but with their norm, and so with the same energy.
        """
        frames = self._outline_rows(state)
        vertices = self._used(frames, state)
        points, derivative = self._linearize_points(state, vertices)
        slope = multiply_views(self.cameras.linearize(points)[1], derivative)  # *b F C N 2 D+S'
        by_frame = slope.reshape(-1, *slope.shape[-4:])
        pairs = zip(frames, by_frame, strict=True)
        products = torch.stack([rows.contract(each) for rows, each in pairs])
        root = square_root(products).view(*slope.shape[:-3], *products.shape[-2:])
        of_frame, of_shared = _split(root[..., :-1], state)
        return Linearization(Residual(root[..., -1]), of_frame, of_shared)

    def add_to_blocks(self, state: Any, curvature: Tensor, gradient: Tensor) -> Tensor | None:
        """Products of outline rows, where points tell what each of them sees; see ``OffersBlocks``.

        For states of many unknowns, whose square roots would cost more than all else.
        """
        plain = is_plain(curvature, gradient, self.masks, self.scale, self.weight)
        if state.shared_sizes or not plain or not getattr(self.points, "in_parts", False):
            return None
        assert self.points is not None
        frames = self._outline_rows(state)
        vertices = self._used(frames, state).unsqueeze(-1)
        parts = self.points(vertices, torch.ones_like(vertices)).linearize_parts(state)
        camera = self.cameras.linearize(parts.points)[1].flatten(0, -5)  # P C N 2 3
        lead = state.coordinates().frame.shape[:-1]
        weight = self.weight.to(gradient)
        each = (weight.unsqueeze(-1) if weight.ndim else weight).expand(lead).flatten()
        blocks, pulls = curvature.flatten(0, 1), gradient.flatten(0, 1)
        values = []
        for frame, (rows, own) in enumerate(zip(frames, parts.frames(), strict=True)):
            value, pull, square = rows.summed(camera[frame], own.dense(), self.kernel)
            blocks[frame] += each[frame] * square
            pulls[frame] += each[frame] * pull
            values.append(each[frame] * value)
        return torch.stack(values).view(len(curvature), -1).sum(-1)

    def gradient(self, state: Any) -> tuple[Tensor, Tensor | None]:
        """Half the gradient, (*b, F, D) and (*b, S'), differentiable in all that it is made of.

        In what moves the outline, where its second derivative would be needed, it is
        differentiated as Gauss-Newton does.
        """
        frames = self._outline_rows(state)
        points, derivative = self._linearize_points(state, self._used(frames, state))
        pixels, camera = self.cameras.linearize(points)  # *b F C N 2 3
        slope = multiply_views(camera, derivative)
        parts = zip(frames, slope.flatten(0, -5), pixels.flatten(0, -4), strict=True)
        pulls, squares = zip(*(rows.pull(*each) for rows, *each in parts), strict=True)
        lead = state.coordinates().frame.shape[:-1]
        strength = self.kernel.slope(torch.stack(squares).view(*lead, -1))
        weight = self.weight.to(strength)[(..., *[None] * (2 if self.weight.ndim else 0))]
        pulled = torch.stack(pulls).view(*lead, *pulls[0].shape)  # *b F C D+S'
        of_frame, of_shared = _split(((weight * strength).unsqueeze(-1) * pulled).sum(-2), state)
        return of_frame, None if of_shared is None else of_shared.sum(-2)

    def second_order(self, state: Any, pull: Tensor) -> None:
        """None: coverage has no second derivative, so Gauss-Newton's curvature is all there is."""

    def linearize_blocks(self, state: Any) -> BlockLinearization:
        """Residual of five rows an outline edge, and one group for the pixels that see none.

        Not the rows of ``residual``, but with their norm, and so with the same energy.

        Raises:
            InputError: there is a robust kernel, which would act on edges instead of views; or
                there are no points.
        """
        from perfcap.solve.sparse import BlockLinearization

        if self.points is None or not isinstance(self.kernel, Quadratic):
            raise InputError(
                f"SilhouetteOverlap has kernel {type(self.kernel).__name__} and points "
                f"{self.points}; linearize_blocks needs the Quadratic kernel and points"
            )
        frames = self._outline_rows(state)
        vertices = self._used(frames, state)
        chosen = self.points(vertices.unsqueeze(-1), torch.ones_like(vertices.unsqueeze(-1)))
        points, blocks, derivative = chosen.linearize_blocks(state)
        slope = self.cameras.linearize(points)[1].flatten(0, -5)  # B C N 2 3
        parts = zip(frames, slope, blocks.flatten(0, -3), derivative.flatten(0, -5), strict=True)
        groups = [_block_groups(*each) for each in parts]
        lead = state.coordinates().frame.shape[:-1]
        value, names, jacobian = (
            _stack(column, lead, fill)
            for column, fill in zip(zip(*groups, strict=True), (0, -1, 0), strict=True)
        )
        return BlockLinearization(Residual(value), names, jacobian)

    def _outline_rows(self, state: Any) -> list[OutlineRows]:
        """Rows of every frame, *b and F in one; one frame's images at a time."""
        surface = self.surface(state).detach()
        local = self.cameras.to_camera(surface)
        require_frames(self, self.masks.shape[-4], local.shape[-4])
        lost = _lost(surface)
        pixels = self.cameras.project_camera(local).flatten(0, -4)  # B C V 2
        depth = local[..., 2].flatten(0, -3)
        shape = (*local.shape[:-2], *self.silhouette.size)
        masks = self.masks.expand(shape).flatten(0, -4)
        scale = self.scale.expand(shape).flatten(0, -4)
        rows = []
        for frame in range(len(pixels)):
            coverage, derivative = self.silhouette.linearize(pixels[frame], depth[frame])
            here = scale[frame].to(coverage)
            error = here * (coverage - masks[frame].to(coverage))
            found = OutlineRows.of(derivative, error, here)
            if lost is not None and lost.flatten()[frame]:
                found = replace(found, rest=torch.full_like(found.rest, torch.nan))
            rows.append(found)
        return rows

    @staticmethod
    def _used(frames: list[OutlineRows], state: State) -> Tensor:
        """Vertices of each frame's outline (*b, F, N), padded with vertex 0; at least one."""
        lead = state.coordinates().frame.shape[:-1]
        used = _stack([rows.vertices for rows in frames], lead)
        return used if used.shape[-1] else used.new_zeros(*lead, 1)

    def _linearize_points(self, state: Any, vertices: Tensor) -> tuple[Tensor, Tensor]:
        """Vertices (*b, F, N, 3) and their derivative in all unknowns, (*b, F, N, 3, D + S')."""
        if self.points is not None:
            chosen = self.points(vertices.unsqueeze(-1), torch.ones_like(vertices.unsqueeze(-1)))
            points, of_frame, of_shared = chosen.linearize(state)
            return points, of_frame if of_shared is None else torch.cat((of_frame, of_shared), -1)
        here = state.coordinates()
        index = vertices.unsqueeze(-1).expand(*vertices.shape, 3)

        def moved(tangent: Tensor) -> tuple[Tensor, Tensor]:
            # rows of a frame see that frame only, so all frames share one tangent
            frame, shared = tangent.tensor_split((state.frame_dim,))
            step = Step(frame.expand_as(here.frame), shared.expand_as(here.shared))
            points = self.surface(state.retract(step)).gather(-2, index)
            return points, points

        zero = here.frame.new_zeros(state.frame_dim + here.shared.shape[-1])
        derivative, points = torch.func.jacfwd(moved, has_aux=True)(zero)
        of_frame, of_shared = _split(derivative, state)
        seen = seen_columns(state.shared_sizes, self.sees)
        if of_shared is None or not of_shared[..., seen].shape[-1]:
            return points, of_frame
        return points, torch.cat((of_frame, of_shared[..., seen]), -1)


def _lost(surface: Tensor) -> Tensor | None:
    """Frames (*b, F) with vertices that are no numbers; None where there are none.

    They are not drawn, so that nothing of a surface seemed to be a surface that is out of sight.
    """
    if torch._C._functorch.is_functorch_wrapped_tensor(surface):
        return None
    finite = surface.detach().isfinite()
    return None if bool(finite.all()) else ~finite.flatten(-2).all(-1)


def _split(derivative: Tensor, state: State) -> tuple[Tensor, Tensor | None]:
    """Columns of a frame, (..., D), and of what is shared, (..., S'), None if there are none."""
    frame, shared = derivative.tensor_split((state.frame_dim,), -1)
    return frame, shared if shared.shape[-1] else None


def _block_groups(
    rows: OutlineRows, slope: Tensor, blocks: Tensor, derivative: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Groups of one frame: value (G, 5), blocks (G, 2 k), jacobian (G, 2 k, 5, q).

    Args:
        rows: of the frame.
        slope: derivative of pixels in the vertices, (C, N, 2, 3).
        blocks: that vertices see, (N, k).
        derivative: of the vertices in them, (N, k, 3, q).
    """
    root = square_root(rows.products)  # E 5 5
    names, jacobians = [], []
    for end in range(2):
        vertex = rows.ends[:, end]
        toward = root[:, :, 2 * end : 2 * end + 2] @ slope[rows.view, vertex]  # E 5 3
        names.append(blocks[vertex])
        jacobians.append(toward.unsqueeze(1) @ derivative[vertex])
    value, name, jacobian = root[..., -1], torch.cat(names, 1), torch.cat(jacobians, 1)
    rest = torch.zeros_like(value[:1]) if len(value) else value.new_zeros(1, 5)
    rest[0, 0] = rows.rest.sum().sqrt()
    none = name.new_full((1, name.shape[1]), -1)
    still = jacobian.new_zeros(1, *jacobian.shape[1:])
    return torch.cat([value, rest]), torch.cat([name, none]), torch.cat([jacobian, still])


def _stack(frames: Iterable[Tensor], lead: torch.Size, fill: float = 0) -> Tensor:
    """Lists of different lengths as one tensor (*b, F, N, ...), padded at the end."""
    padded = torch.nn.utils.rnn.pad_sequence(list(frames), batch_first=True, padding_value=fill)
    return padded.reshape(*lead, *padded.shape[1:])


def _floating(masks: Tensor) -> torch.dtype:
    """Of the masks, or where they are bool one that the coverage's is cast from."""
    return masks.dtype if masks.is_floating_point() else torch.float64


def _check(
    silhouette: SoftSilhouette, cameras: Camera, masks: Tensor, trust: Tensor | None
) -> None:
    require_size(cameras, silhouette.size)
    require_cameras(cameras)
    if masks.shape[-3:] != (cameras.views, *silhouette.size) or masks.ndim < 4:
        raise InputError(
            f"masks has shape {tuple(masks.shape)}; expected (*b, F, {cameras.views}, "
            f"{silhouette.size[0]}, {silhouette.size[1]}): the views and size of the silhouette"
        )
    if masks.dtype != torch.bool and not masks.is_floating_point():
        raise InputError(f"masks has dtype {masks.dtype}; expected bool, or floats from 0 to 1")
    low, high = (float(x) for x in masks.detach().aminmax()) if masks.numel() else (0.0, 1.0)
    if not 0 <= low <= high <= 1:
        raise InputError(f"masks has values from {low:g} to {high:g}; expected 0 to 1")
    if trust is None:
        return
    sides = zip(trust.shape[::-1], masks.shape[::-1], strict=False)
    fits = trust.ndim <= masks.ndim and all(one in (1, other) for one, other in sides)
    counts = not trust.is_floating_point() and trust.dtype != torch.bool
    if counts and trust.numel() and int(trust.max()) > 1:
        raise InputError(
            f"trust is {trust.dtype} up to {int(trust.max())}; expected bool, or floating-point "
            "weights from 0 on: divide bytes by 255"
        )
    if not fits or not bool((trust >= 0).all()):
        raise InputError(
            f"trust has shape {tuple(trust.shape)} and least {float(trust.min()):g}; expected "
            f"weights from 0 on that broadcast to the masks, {tuple(masks.shape)}"
        )
