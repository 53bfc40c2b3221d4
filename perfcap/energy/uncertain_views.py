"""Reprojection into views whose clocks, places and lenses are not quite as they are stated."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.detect.detections import Detections
from perfcap.energy._arguments import (
    known_places,
    require_cameras,
    require_confidence,
    require_frames,
    require_unit,
    seen_by,
)
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import left_jacobian, rotvec_to_matrix, skew
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel

CLOCK = "clock"
"""Shared: frames by which each of C views is late, (C,): it shows frame f at f + clock."""
CAMERAS = "cameras"
"""Shared: rotation vector and shift of each camera, in its own axes, (6 C,): radians, metres."""
LENS = "lens"
"""Shared: log of the factor by which the focal length of each view is longer, (C,)."""

_BLOCKS = {CLOCK: 1, CAMERAS: 6, LENS: 1}  # unknowns a view


class UncertainViews(Energy[Motion]):
    """Distance of projected points from what each view shows a little earlier or later.

    A residual group is one point in one view, ``(project_c(x_f) - d_c(f + t_c)) / unit``: the
    motion is in the time of view frames with t = 0, and detections between frames are those of a
    smooth spline. A camera turned by w and shifted by s sees ``exp(w) (R x + t) + s``, and a lens
    that is longer by ``exp(l)`` sees that much farther from the axis, before any distortion. Any
    block may be missing from a motion; what it stands for is then as stated. At the ends of the
    clip, and next to frames that do not see the point, nothing counts.

    Args:
        points: N points, one for each detected one.
        cameras: C fixed views.
        detections: (F, C, N), of one clip.
        weight: of the energy.
        kernel: acts on the squared distance, in ``unit``.
        unit: pixels that count as one, a number or (C,).

    Raises:
        InputError: cameras that move, or that are of other views than the detections; confidences
            that are none.
    """

    coupling = Coupling.FRAME
    scale: Tensor

    def __init__(
        self,
        points: Points,
        cameras: Camera,
        detections: Detections,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float | Tensor = 1.0,
    ) -> None:
        if cameras.moving:
            raise InputError("cameras move; clocks and small errors of fixed cameras are solved")
        if detections.joints2d.dim() != 4 or detections.views != cameras.views:
            raise InputError(
                f"detections have joints2d {tuple(detections.joints2d.shape)} for {cameras.views} "
                "cameras; expected one clip of as many views, (F, C, N, 2)"
            )
        super().__init__(weight, kernel)
        require_unit(unit)
        sure = detections.confidence2d
        require_confidence(sure, "confidence2d")
        require_cameras(cameras)
        places = known_places(detections.joints2d, sure, "joints2d")
        detections = replace(detections, joints2d=places)
        self.points, self.sees = points, (*seen_by(points), *_BLOCKS)
        self.cameras, self.detections = cameras, detections
        scale = 1 / torch.as_tensor(unit).to(detections.joints2d)
        self.register_buffer("scale", scale.expand(cameras.views).clone())

    def residual(self, motion: Motion) -> Residual:
        """(F, C * N, 2)."""
        local = self._local(self.points(motion), motion)
        shown, sure, _ = self._shown(motion)
        wide = local * self._wider(motion)
        return self._residual(self.cameras.project_camera(wide), shown, sure)

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form in all blocks."""
        joints, frame, shared = self.points.linearize(motion)
        local = self._local(joints, motion)
        wider = self._wider(motion)
        pixels, slope = self._project(local * wider)  # F C N 2, F C N 2 3
        slope = slope * wider.unsqueeze(-2)
        shown, sure, speed = self._shown(motion)
        turned = slope @ self._turned(motion)[:, None]
        rows = (self.scale[:, None, None, None] * turned).unsqueeze(-1)  # F C N 2 3 1
        of_frame = (rows * frame[:, None, :, None]).sum(-2).flatten(-4, -3)
        parts = self._blocks(motion, local, slope, speed)
        sizes = motion.shared_sizes
        if shared is not None:
            own = [name for name in sizes if name in self.points.sees]
            moved = (rows * shared[:, None, :, None]).sum(-2).flatten(-4, -3)
            parts |= dict(zip(own, torch.split(moved, [sizes[n] for n in own], -1), strict=True))
        columns = [parts[name] for name in sizes if name in parts]
        of_shared = torch.cat(columns, -1) if columns else None
        return Linearization(self._residual(pixels, shown, sure), of_frame, of_shared)

    def _residual(self, pixels: Tensor, shown: Tensor, sure: Tensor) -> Residual:
        error = (pixels - shown) * self.scale[:, None, None]
        return Residual(error.flatten(-3, -2), sure.flatten(-2))

    def _local(self, points: Tensor, motion: Motion) -> Tensor:
        """Points in the axes of each camera as it really stands, (F, C, N, 3)."""
        require_frames(self, self.detections.frame_count, points.shape[-3])
        for block, size in _BLOCKS.items():
            own, wanted = motion.shared.get(block), size * self.cameras.views
            if own is not None and tuple(own.shape) != (wanted,):
                raise InputError(
                    f"the motion shares {block} of shape {tuple(own.shape)}, expected ({wanted},): "
                    f"{size} a view"
                )
        local = self.cameras.to_camera(points)
        if CAMERAS not in motion.shared:
            return local
        turn, shift = motion.shared[CAMERAS].reshape(-1, 2, 3).unbind(-2)
        return local @ rotvec_to_matrix(turn).mT + shift[:, None]

    def _wider(self, motion: Motion) -> Tensor:
        """By what each lens makes x, y and z of points larger, (C, 1, 3)."""
        longer = motion.shared.get(LENS)
        if longer is None:
            return torch.ones_like(self.cameras.translation)[:, None]
        factor = longer.exp()[:, None]
        return torch.cat((factor, factor, torch.ones_like(factor)), -1)[:, None]

    def _turned(self, motion: Motion) -> Tensor:
        """Rotation from the world of each camera as it really stands, (C, 3, 3)."""
        if CAMERAS not in motion.shared:
            return self.cameras.rotation
        return rotvec_to_matrix(motion.shared[CAMERAS].reshape(-1, 6)[:, :3]) @ (
            self.cameras.rotation
        )

    def _project(self, local: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels of local points and their slopes in these, (F, C, N, 2) and (F, C, N, 2, 3)."""
        eye, none = torch.eye(3).to(local)[None], local.new_zeros(1, 3)
        found = [
            replace(self.cameras.select([view]), rotation=eye, translation=none).linearize(points)
            for view, points in enumerate(local.unbind(-3))
        ]
        pixels, slopes = (
            torch.cat(parts, axis)
            for axis, parts in zip((-3, -4), zip(*found, strict=True), strict=True)
        )
        return pixels, slopes

    def _blocks(
        self, motion: Motion, local: Tensor, slope: Tensor, speed: Tensor
    ) -> dict[str, Tensor]:
        """Columns of the blocks there are, (F, C N, 2, C), or 6 C of them for cameras."""
        views = torch.eye(self.cameras.views).to(local)
        scale = self.scale[:, None, None]
        found = {}
        if CLOCK in motion.shared:
            own = (-scale * speed).unsqueeze(-1)  # F C N 2 1
            found[CLOCK] = (own * views[:, None, None]).flatten(1, 2)
        if CAMERAS in motion.shared:
            turn, shift = motion.shared[CAMERAS].reshape(-1, 2, 3).unbind(-2)
            still = local - shift[:, None]  # turned, not shifted: what the rotation moves
            lever = -skew(still) @ left_jacobian(turn)[:, None]  # F C N 3 3
            own = scale.unsqueeze(-1) * torch.cat((slope @ lever, slope), -1)  # F C N 2 6
            spread = own.unsqueeze(-2) * views[:, None, None, :, None]  # F C N 2 C 6
            found[CAMERAS] = spread.flatten(-2).flatten(1, 2)
        if LENS in motion.shared:
            moved = (slope[..., :2] * local[..., None, :2]).sum(-1, keepdim=True)  # F C N 2 1
            found[LENS] = (scale.unsqueeze(-1) * moved * views[:, None, None]).flatten(1, 2)
        return found

    def _shown(self, motion: Motion) -> tuple[Tensor, Tensor, Tensor]:
        """What views show in the time of the motion: pixels, confidence, pixels a frame."""
        seen = self.detections
        clock = motion.shared.get(CLOCK)
        if clock is None:
            return seen.joints2d, seen.confidence2d, torch.zeros_like(seen.joints2d)
        return smooth_at(seen, clock)


_KNOTS = (6.0, 3), (-36.0, 2), (90.0, 1)  # factors of the fifth powers of what is left to a knot


def _spline(apart: Tensor) -> tuple[Tensor, Tensor]:
    """Quintic cardinal B-spline at distances (...,), six of which sum to one, and its slope."""
    x, side = apart.abs().clamp(max=3), apart.sign()
    value, slope = torch.zeros_like(x), torch.zeros_like(x)
    for factor, knot in _KNOTS:
        left = (knot - x).clamp(min=0)
        value = value + factor / 720 * left**5
        slope = slope - factor / 144 * left**4 * side
    return value, slope


def smooth_at(detections: Detections, clock: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Detections of each view so many frames later, on a quintic spline that smooths.

    Means over six frames with the weights of a B-spline: motion of constant acceleration keeps its
    shape, and noise is as small between frames as on them (to 1.3 %). A spline through the
    detections has half the noise midway, which pulls clocks towards half a frame.

    Args:
        detections: (F, C, 16).
        clock: frames, (C,).

    Returns:
        Pixels (F, C, 16, 2), confidence (F, C, 16), 0 where one of the six is not seen or not in
        the clip, and the change of the pixels a frame, (F, C, 16, 2).
    """
    frames = detections.frame_count
    place = torch.arange(frames).to(clock)[:, None] + clock  # F C
    first = place.detach().floor().long() - 2
    taps = first[..., None] + torch.arange(6, device=first.device)  # F C 6
    inside = ((taps >= 0) & (taps < frames)).all(-1)
    index, view = taps.clamp(0, frames - 1), torch.arange(detections.views)[:, None]
    apart = place[..., None] - taps
    weight, slope = _spline(apart)
    values = detections.joints2d[index, view.to(index.device)]  # F C 6 16 2
    sure = detections.confidence2d[index, view.to(index.device)]  # F C 6 16
    pixels, speed = (torch.einsum("fct,fctnk->fcnk", w, values) for w in (weight, slope))
    known = (sure > 0).all(-2) & inside[..., None]
    return pixels, torch.einsum("fct,fctn->fcn", weight, sure) * known, speed
