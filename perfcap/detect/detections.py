"""What a detector says about a clip: the only thing energies know about images of joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor

from perfcap.detect.extent import end_to_end
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.geometry.record import Record

_SEEN = 0.2  # share of the largest confidence from which a joint counts
_ENOUGH_JOINTS = 6  # that show how tall a person is
_FLAGS = ("trusted3d", "doubted")


@dataclass(frozen=True)
class Detections(Record):
    """Joints of one person in the frames and views of a clip.

    ``J`` is always the 16 landmarks, in their order. An unseen joint has confidence 0 and any
    finite coordinates.

    Attributes:
        joints2d: (*b, F, C, J, 2), pixels, pixel centres at integer coordinates.
        confidence2d: (*b, F, C, J), 0 to 1.
        joints3d: (*b, F, C, J, 3), metres in the axes of the view's camera, relative to the
            middle of the hips; None when the detector has none.
        trusted3d: (*b, F, C), bool: whether a view's 3D pose may be used in a frame.
        deviation3d: (*b, F, C), metres: how far the joints of a 3D pose are expected to be off,
            root mean square, by what gave it; NaN where it does not say, None where nothing does.
        doubted: (*b, F, C), bool: whether something else than the detector says that a view's
            joints are wrong in a frame, None where nothing does. Solves use them, and a motion is
            trusted as far as the others bear it out.
    """

    joints2d: Tensor
    confidence2d: Tensor
    joints3d: Tensor | None
    trusted3d: Tensor
    deviation3d: Tensor | None = None
    doubted: Tensor | None = None

    def __post_init__(self) -> None:
        _require_tensors(self.joints2d, self.confidence2d, self.joints3d, self.trusted3d)
        batch = self.joints2d.shape[:-2]
        joints = len(LANDMARKS)
        if len(batch) < 2:
            raise ValueError(
                f"joints2d has shape {tuple(self.joints2d.shape)}, expected (*b, F, C, {joints}, 2)"
            )
        _require("joints2d", self.joints2d, (*batch, joints, 2))
        _require("confidence2d", self.confidence2d, (*batch, joints))
        if self.joints3d is not None:
            _require("joints3d", self.joints3d, (*batch, joints, 3))
        _require("trusted3d", self.trusted3d, tuple(batch))
        if self.deviation3d is not None:
            _require("deviation3d", self.deviation3d, tuple(batch))
        if self.doubted is not None:
            _require("doubted", self.doubted, tuple(batch))
        for name in _FLAGS:
            flags = getattr(self, name)
            if flags is not None and flags.dtype != torch.bool:
                raise ValueError(f"{name} is {flags.dtype}, expected torch.bool")

    @classmethod
    def from_joints(
        cls, joints2d: Tensor, confidence2d: Tensor, joints3d: Tensor | None = None
    ) -> Self:
        """Detections whose 3D poses are trusted wherever there are any."""
        _require_tensors(joints2d, confidence2d, joints3d)
        trusted = torch.full(
            joints2d.shape[:-2], joints3d is not None, dtype=torch.bool, device=joints2d.device
        )
        return cls(joints2d, confidence2d, joints3d, trusted)

    @property
    def frame_count(self) -> int:
        """F."""
        return self.joints2d.shape[-4]

    @property
    def views(self) -> int:
        """C."""
        return self.joints2d.shape[-3]

    def person_height(self) -> Tensor:
        """Median size of the person in the images of a clip, (C,), pixels; 1 where undetected.

        From end to end, their height if they stand. Joints count from a share of a view's largest
        confidence, since detectors differ in what they call confident, and frames with at least
        six of them, or with as many as the view ever shows.
        """
        peak = self.confidence2d.amax((0, 2))[:, None]  # C 1
        seen = self.confidence2d > _SEEN * peak
        count = seen.sum(-1)
        enough = count >= count.amax(0).clamp(min=1, max=_ENOUGH_JOINTS)
        height = end_to_end(self.joints2d, seen).where(enough, torch.nan)
        return height.nanmedian(0).values.nan_to_num(1.0).clamp(min=1.0)

    def box_heights(self) -> Tensor:
        """Median height of the boxes around all joints that are seen, (C,), pixels; 100 of none."""
        seen, rows = self.confidence2d > 0, self.joints2d[..., 1]
        low = rows.masked_fill(~seen, torch.inf).amin(-1)
        high = rows.masked_fill(~seen, -torch.inf).amax(-1)
        tall = torch.where((high - low).isfinite(), high - low, torch.nan)
        return tall.nanmedian(0).values.nan_to_num(100.0).clamp(min=10.0)

    def views_with_person(self) -> Tensor:
        """Views of a clip in which anything is detected in any frame, (C,), bool."""
        return (self.confidence2d > 0).any(-1).any(0)

    def frames(self, index: slice | Tensor) -> Self:
        """The detections of some frames."""
        return replace(
            self,
            joints2d=self.joints2d[..., index, :, :, :],
            confidence2d=self.confidence2d[..., index, :, :],
            joints3d=None if self.joints3d is None else self.joints3d[..., index, :, :, :],
            trusted3d=self.trusted3d[..., index, :],
            deviation3d=None if self.deviation3d is None else self.deviation3d[..., index, :],
            doubted=None if self.doubted is None else self.doubted[..., index, :],
        )

    def finite(self) -> Self:
        """The same with joints that are not finite as unseen ones, and such poses not trusted.

        Nor are poses with a joint that was ``not_found``.
        """
        known = self.joints2d.isfinite().all(-1) & self.confidence2d.isfinite()
        poses, trusted = self.joints3d, self.trusted3d
        if poses is not None:
            missing = not_found(poses, self.confidence2d)
            trusted = trusted & (poses.isfinite().all(-1) & ~missing).all(-1)
            poses = torch.where(trusted[..., None, None], poses, poses.nan_to_num(0.0, 0.0, 0.0))
        return replace(
            self,
            joints2d=torch.where(known[..., None], self.joints2d, 0),
            confidence2d=torch.where(known, self.confidence2d, 0),
            joints3d=poses,
            trusted3d=trusted,
        )

    def without_poses(self) -> Self:
        """The 2D joints alone."""
        nothing = torch.zeros_like(self.trusted3d)
        return replace(self, joints3d=None, trusted3d=nothing, deviation3d=None)

    def undoubted(self) -> Self:
        """Without the joints and poses that are doubted."""
        if self.doubted is None:
            return self
        return replace(
            self,
            confidence2d=torch.where(self.doubted[..., None], 0, self.confidence2d),
            trusted3d=self.trusted3d & ~self.doubted,
            doubted=None,
        )

    def select(self, views: list[int]) -> Self:
        """The detections of some views, in the order given."""
        return replace(
            self,
            joints2d=self.joints2d[..., views, :, :],
            confidence2d=self.confidence2d[..., views, :],
            joints3d=None if self.joints3d is None else self.joints3d[..., views, :, :],
            trusted3d=self.trusted3d[..., views],
            deviation3d=None if self.deviation3d is None else self.deviation3d[..., views],
            doubted=None if self.doubted is None else self.doubted[..., views],
        )

    def to(self, like: Tensor) -> Self:
        """The same detections with the type and device of a tensor; flags stay bool."""
        if not isinstance(like, Tensor):
            raise InputError(
                f"to: got {like!r:.80}, expected a tensor of the type and device, as torch.zeros(1)"
            )
        return self.map(lambda each: each.to(like if each.is_floating_point() else like.device))


def not_found(poses: Tensor, confidence: Tensor) -> Tensor:
    """Joints (..., J, 3) at exactly 0, 0, 0 whose 2D confidence (..., J) is 0 too, as (..., J).

    Many programs write zeros for joints that they did not find.
    """
    missing: Tensor = (poses == 0).all(-1) & ~(confidence > 0)
    return missing


def _require_tensors(*given: object) -> None:
    for each in given:
        if isinstance(each, np.ndarray | list):
            raise InputError(
                f"detections: got a {type(each).__name__}, expected tensors; "
                "torch.from_numpy makes them of arrays"
            )


def _require(name: str, tensor: Tensor, expected: tuple[int, ...]) -> None:
    if tuple(tensor.shape) != expected:
        raise ValueError(f"{name} has shape {tuple(tensor.shape)}, expected {expected}")
    if name not in _FLAGS and not tensor.is_floating_point():
        raise ValueError(f"{name} is {tensor.dtype}, expected a floating-point type")


# --- The unit of 3D joints, told by how large the person is in it ---------------------------------

_PERSON = (0.3, 20.0)  # m from end to end, of anybody in any pose and of rough predictions


def extents(poses: Tensor) -> Tensor:
    """Diagonals of the boxes around joints (..., J, 3), (...)."""
    spans: Tensor = (poses.amax(-2) - poses.amin(-2)).norm(dim=-1)
    return spans


def unit_of(extent: float) -> str:
    """``metres``, ``millimetres`` or ``another unit``, of what a person's joints span in it.

    Args:
        extent: diagonal of the box around the joints.
    """
    low, high = _PERSON
    if low < extent < high:
        return "metres"
    return "millimetres" if low < extent / 1000 < high else "another unit"


# --- Detections a little earlier or later than they were made -------------------------------------


def at_clock(detections: Detections, clock: Tensor) -> Detections:
    """Detections of each view so many frames later, on straight lines between frames.

    Args:
        detections: (F, C, 16).
        clock: frames, (C,).

    Returns:
        Detections (F, C, 16); unseen beyond the ends of the clip, and between frames of which one
        does not see a joint. 3D joints are those of the nearest frame.
    """
    frames, views = detections.frame_count, torch.arange(detections.views, device=clock.device)
    place = torch.arange(frames).to(clock)[:, None] + clock  # F C
    inside = (place >= 0) & (place <= frames - 1)
    first = place.floor().clamp(0, max(frames - 2, 0)).long()
    second = (first + 1).clamp(max=frames - 1)
    share = (place - first).to(detections.joints2d)[..., None]
    low, high = (detections.joints2d[index, views] for index in (first, second))
    sure, after = (detections.confidence2d[index, views] for index in (first, second))
    both = torch.minimum(sure, after)
    confidence = torch.where(share == 0, sure, torch.where(share == 1, after, both))
    nearest = place.round().clamp(0, frames - 1).long()
    joints3d, deviation = detections.joints3d, detections.deviation3d
    return replace(
        detections,
        joints2d=low + share[..., None] * (high - low),
        confidence2d=confidence * inside[..., None],
        joints3d=None if joints3d is None else joints3d[nearest, views],
        trusted3d=detections.trusted3d[nearest, views] & inside,
        deviation3d=None if deviation is None else deviation[nearest, views],
    )
