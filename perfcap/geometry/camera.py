"""Pinhole cameras with OpenCV's lens distortion, and cameras placed by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain
from perfcap.geometry.record import Record
from perfcap.geometry.rotation import rotvec_to_matrix

# A point nearer than this is projected as if it were this far: finite, and still pulled forward.
NEAR = 0.05  # m


@dataclass(frozen=True)
class Camera(Record):
    """Calibrated views: x right, y down, z forward, pixel centres at integer coordinates.

    A world point X (metres) has camera coordinates ``rotation @ X + translation`` and the pixel
    ``intrinsics @ distorted(x / z)``. The batch ``*b`` is (C,) for fixed cameras, (F, C) for
    cameras that move, or (*windows, F, C).

    Attributes:
        intrinsics: (*b, 3, 3), pixels.
        rotation: world to camera, (*b, 3, 3).
        translation: world to camera, (*b, 3), metres.
        distortion: (*b, 5), OpenCV's k1, k2, p1, p2, k3, or None.
        size: image (height, width) in pixels of each view, C pairs.
    """

    intrinsics: Tensor
    rotation: Tensor
    translation: Tensor
    distortion: Tensor | None = None
    size: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        batch = self.intrinsics.shape[:-2]
        for name, shape in (("intrinsics", (3, 3)), ("rotation", (3, 3)), ("translation", (3,))):
            found, expected = tuple(getattr(self, name).shape), (*batch, *shape)
            if found != expected:
                raise ValueError(f"camera {name} has shape {found}, expected {expected}")
        if self.distortion is not None and self.distortion.shape != (*batch, 5):
            raise ValueError(
                f"camera distortion has shape {tuple(self.distortion.shape)}, expected "
                f"{(*batch, 5)}: k1, k2, p1, p2, k3"
            )
        if not batch:
            raise ValueError("a Camera has at least a view axis; add one with [None]")

    @property
    def views(self) -> int:
        """C, the number of views."""
        return self.intrinsics.shape[-3]

    @property
    def moving(self) -> bool:
        """Whether there is a camera a frame, rather than one for all frames."""
        return self.intrinsics.dim() > 3

    def to_camera(self, points: Tensor) -> Tensor:
        """Camera coordinates (*b, F, C, N, 3) of world points (*b, F, N, 3), metres."""
        rotated = points.unsqueeze(-3) @ self.rotation.mT
        return rotated + self.translation.unsqueeze(-2)

    def project(self, points: Tensor) -> Tensor:
        """Pixels (*b, F, C, N, 2) of world points (*b, F, N, 3) in metres."""
        return self.project_camera(self.to_camera(points))

    def project_camera(self, local: Tensor) -> Tensor:
        """Pixels (..., C, N, 2) of points in camera coordinates (..., C, N, 3)."""
        plane = local[..., :2] / local[..., 2:].clamp(min=NEAR)
        return self._to_pixels(self._distort(plane))

    def linearize(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels (*b, F, C, N, 2) and their derivative in the world points (*b, F, C, N, 2, 3)."""
        if points.ndim < 2 or points.shape[-1] != 3:
            raise InputError(
                f"points have shape {tuple(points.shape)}, expected (*b, F, N, 3), metres"
            )
        if self._compiled_for(points):
            from perfcap.geometry import _projection_numba

            pinhole = self.intrinsics, self.rotation, self.translation
            lens = None if self.distortion is None else (self.distortion, self.radius_limit())
            return _projection_numba.linearize(points, pinhole, lens, NEAR)
        local = self.to_camera(points)
        depth = local[..., 2].clamp(min=NEAR)
        plane = local[..., :2] / depth[..., None]
        scale = 1 / depth
        in_front = (local[..., 2] > NEAR).to(scale.dtype)
        # rows of d(plane)/d(local), contracted with the camera rotation right away
        rotation = self.rotation.unsqueeze(-3)  # *b C 1 3 3
        toward = (in_front[..., None] * plane)[..., None] * rotation[..., 2:, :]
        jacobian = scale[..., None, None] * (rotation[..., :2, :] - toward)
        if self.distortion is not None:
            jacobian = self._distort_jacobian(plane) @ jacobian
        pixels = self._to_pixels(self._distort(plane))
        return pixels, self.intrinsics[..., None, :2, :2] @ jacobian

    def _compiled_for(self, points: Tensor) -> bool:
        """Whether only numbers are asked for, of cameras and points with matching frames."""
        lead, frames = self.intrinsics.shape[:-3], points.shape[:-2]
        fits = lead == frames[len(frames) - len(lead) :] and points.numel() > 0
        return fits and is_plain(
            points, self.intrinsics, self.rotation, self.translation, self.distortion
        )

    def to_plane(self, pixels: Tensor) -> Tensor:
        """Undistorted coordinates (x/z, y/z), (..., C, N, 2), of pixels (..., C, N, 2)."""
        offset = pixels - self.intrinsics[..., None, :2, 2]
        bent = torch.linalg.solve(self.intrinsics[..., :2, :2], offset.mT).mT
        plane: Tensor = bent
        if self.distortion is not None:
            for _ in range(10):  # fixed point: contracts by the size of the distortion
                plane = plane - (self._distort(plane) - bent)
        return plane

    def _to_pixels(self, plane: Tensor) -> Tensor:
        focal = self.intrinsics[..., :2, :2]
        return plane @ focal.mT + self.intrinsics[..., None, :2, 2]

    def _distort(self, plane: Tensor) -> Tensor:
        """OpenCV's radial and tangential model on the plane z = 1."""
        if self.distortion is None:
            return plane
        k1, k2, p1, p2, k3 = (c.unsqueeze(-1) for c in self.distortion.unbind(-1))
        x, y = plane.unbind(-1)
        # the polynomial folds back far outside the image: it is held constant out there
        r2 = (x * x + y * y).minimum(self.radius_limit())
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        scale = r2 / (x * x + y * y).clamp(min=1e-12)
        dx = 2 * p1 * x * y * scale + p2 * (r2 + 2 * x * x * scale)
        dy = p1 * (r2 + 2 * y * y * scale) + 2 * p2 * x * y * scale
        return torch.stack((x * radial + dx, y * radial + dy), -1)

    def _distort_jacobian(self, plane: Tensor) -> Tensor:
        """Derivative (..., 2, 2) of ``_distort``, by two forward-mode tangents."""
        columns = [
            torch.func.jvp(self._distort, (plane,), (torch.eye(2).to(plane)[i].expand_as(plane),))[
                1
            ]
            for i in range(2)
        ]
        return torch.stack(columns, -1)

    def radius_limit(self) -> Tensor:
        """Squared radius on the plane z = 1 beyond which distortion is held constant, (*b, 1)."""
        focal = self.intrinsics[..., (0, 1), (0, 1)]
        centre = self.intrinsics[..., :2, 2]
        far = centre.abs() if not self.size else centre.maximum(self._extent() - centre)
        return 2.25 * (far / focal).square().sum(-1, keepdim=True)

    def _extent(self) -> Tensor:
        sizes = self.intrinsics.new_tensor([(width, height) for height, width in self.size])
        return sizes.expand(*self.intrinsics.shape[:-2], 2)

    def frames(self, index: slice | Tensor) -> Self:
        """The cameras of some frames; fixed cameras are returned as they are."""
        if not self.moving:
            return self
        return self.map(lambda each: each[index])

    def every_frame(self, frames: int) -> Self:
        """Cameras (F, C), from fixed ones too."""
        if self.moving:
            return self
        return self.map(lambda each: each.expand(frames, *each.shape))

    def apart(self) -> Self:
        """Cameras for frames that are batch elements of one frame each, (F, 1, C) where moving."""
        if not self.moving:
            return self
        return replace(
            self,
            intrinsics=self.intrinsics.unsqueeze(-4),
            rotation=self.rotation.unsqueeze(-4),
            translation=self.translation.unsqueeze(-3),
            distortion=None if self.distortion is None else self.distortion.unsqueeze(-3),
        )

    def select(self, views: list[int]) -> Self:
        """The cameras of some views, in the order given."""
        views = torch.arange(self.views)[views].tolist()  # of True and False, too
        distortion = None if self.distortion is None else self.distortion[..., views, :]
        return replace(
            self,
            intrinsics=self.intrinsics[..., views, :, :],
            rotation=self.rotation[..., views, :, :],
            translation=self.translation[..., views, :],
            distortion=distortion,
            size=tuple(self.size[i] for i in views) if self.size else (),
        )

    @classmethod
    def cat(cls, records: Sequence[Self]) -> Self:
        """Cameras of more views, or where they move of more frames."""
        joined = super().cat(records)
        if joined.moving or not all(each.size for each in records):
            return joined if joined.moving else replace(joined, size=())
        return replace(joined, size=tuple(pair for each in records for pair in each.size))

    def to(self, like: Tensor) -> Self:
        """The same cameras with the type and device of a tensor."""
        return self.map(lambda each: each.to(like))

    def nudged(self, step: Tensor) -> Self:
        """Cameras that see ``exp(w) (R x + t) + s`` of what was ``R x + t``.

        Args:
            step: rotation vector w and shift s of each view in its own axes, (C, 6): radians,
                metres.
        """
        turn, shift = step.to(self.translation).reshape(-1, 2, 3).unbind(-2)
        matrix = rotvec_to_matrix(turn)
        moved = (matrix @ self.translation[..., None])[..., 0] + shift
        return replace(self, rotation=matrix @ self.rotation, translation=moved)

    @property
    def centre(self) -> Tensor:
        """Optical centres in the world, (*b, 3), metres."""
        return -(self.rotation.mT @ self.translation.unsqueeze(-1)).squeeze(-1)


def look_at(eye: Tensor, target: Tensor, up: Tensor) -> tuple[Tensor, Tensor]:
    """World-to-camera motion of a camera at ``eye`` that looks at ``target``.

    Camera axes are OpenCV's: x right, y down, z forward; ``up`` appears upwards in the image.

    Args:
        eye: optical centre in the world, (*b, 3) m.
        target: point that is seen in the middle of the image, (*b, 3) m.
        up: any vector not along the line of sight, (*b, 3); the three shapes broadcast.

    Returns:
        Rotation (*b, 3, 3) and translation (*b, 3) that take world points to camera axes.

    Raises:
        InputError: eye and target coincide, or up is along the line of sight.
    """
    eye, target, up = torch.broadcast_tensors(eye, target, up)  # type: ignore[no-untyped-call]
    forward = target - eye
    right = torch.linalg.cross(forward, up)
    # relative to the lengths, so that neither far targets nor short up vectors pass unnoticed
    lean = right.norm(dim=-1) / (forward.norm(dim=-1) * up.norm(dim=-1))
    if not bool((lean > 1e-6).all()):
        raise InputError(
            "up is along the line of sight, or eye and target coincide; expected an up vector "
            "across the view and two different points"
        )
    forward = torch.nn.functional.normalize(forward, dim=-1)
    right = torch.nn.functional.normalize(right, dim=-1)
    down = torch.linalg.cross(forward, right)
    rotation = torch.stack([right, down, forward], -2)
    return rotation, -(rotation @ eye[..., None]).squeeze(-1)
