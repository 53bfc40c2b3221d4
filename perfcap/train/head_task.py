"""Learning a head through the solver: views that are solved alone are to agree with each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.camera import Camera
from perfcap.train.config import HeadLoss
from perfcap.train.head import Head, pose_error
from perfcap.train.head_crops import CropAnswers, Watched

_MIRROR = list(LANDMARKS16.mirrored())
_MM = 1000.0

# joints in the world, (B, F, 16, 3), of clips (F, 1, ...) in one view each, with their cameras:
# 2D joints in pixels, their confidence, and 3D joints in metres in the axes of the camera
Refine = Callable[[list[Camera], list[Tensor], list[Tensor], list[Tensor]], Tensor]


@dataclass(frozen=True)
class Split:
    """Frames to learn from, the first ones, and frames to choose by, the last ones."""

    learned: slice
    chosen: slice


class HeadTask:
    """A head, the views it learns from, and the solver between them.

    Each view is solved alone, from what the network with its head says of it. The motion that comes
    out is brought to the solution of all views by one similarity a clip, which carries no
    gradient: how far away and how large somebody is, one view does not tell. Then its joints
    should project onto the detections of the other views.

    Args:
        head: to train.
        crops: what the network says.
        watched: the person.
        split: of the frames.
        refine: the solver.
        window: frames that are solved together, at most.
        loss: weights.
        seed: of the windows.
    """

    model: Head

    def __init__(
        self,
        head: Head,
        crops: CropAnswers,
        watched: Watched,
        split: Split,
        refine: Refine,
        window: int,
        loss: HeadLoss,
        seed: int,
    ) -> None:
        self.model, self._crops, self._watched = head, crops, watched
        self._split, self._refine, self._window = split, refine, window
        self._loss, self._seed = loss, seed
        self._start = [value.detach().clone() for value in head.parameters()]
        self._straight = torch.nonzero(~crops.mirrored).flatten().tolist()
        pixels = watched.cameras.project(watched.joints)  # F C 16 2
        extent = (pixels.amax(-2) - pixels.amin(-2)).norm(dim=-1)
        self._unit = 0.01 * extent  # F C, about a hundredth of a standing person

    def loss(self, number: int, size: int, progress: float) -> dict[str, Tensor]:
        """Disagreement of a window of ``size`` views at most, and how far the head has moved."""
        random = np.random.default_rng([self._seed, number])
        frames = self._split.learned
        count = min(self._window, frames.stop - frames.start)
        start = int(random.integers(frames.start, frames.stop - count + 1))
        views = random.permutation(self._crops.features.shape[0])[:size].tolist()
        variant = self._straight[int(random.integers(len(self._straight)))]
        joints = self._solved(self.model, views, slice(start, start + count), variant)
        apart = self._disagreement(joints, views, slice(start, start + count))
        pairs = zip(self.model.parameters(), self._start, strict=True)
        moved = torch.stack([(own - first).square().sum() for own, first in pairs]).sum()
        return {"loss": apart + self._loss.stay * moved, "disagreement": apart, "moved": moved}

    @torch.no_grad()
    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Disagreement of views, and PA-MPJPE (mm) of poses against the solution of all views."""
        assert isinstance(model, Head)
        frames, views = self._split.chosen, list(range(self._crops.features.shape[0]))
        joints = self._solved(model, views, frames, 0)
        apart = float(self._disagreement(joints, views, frames))
        known = self._watched.joints[frames].to(joints).expand_as(joints)
        error = float(pose_error(joints, known).mean())
        return {"held_out": apart, "solved_mm": _MM * error}

    def _solved(self, head: nn.Module, views: list[int], frames: slice, variant: int) -> Tensor:
        """Joints (B, F, 16, 3) of each view solved alone."""
        crops = self._crops
        part = (views, frames, variant)
        moves2d, moves3d = head(crops.features[part])  # B F 16 2, B F 16 3
        other = crops.exchanged[part][..., None, None]
        moves2d, moves3d = (
            torch.where(other, moves[..., _MIRROR, :], moves) for moves in (moves2d, moves3d)
        )
        matrix = crops.to_image[part]
        points = crops.joints2d[part] + moves2d
        pixels = points @ matrix[..., :2].mT + matrix[..., None, :, 2]
        poses = (crops.joints3d[part] + moves3d) @ crops.to_camera[part].mT
        sure = crops.confidence[part]
        return self._refine(
            [self._watched.cameras.select([view]) for view in views],
            *([each[:, None] for each in values] for values in (pixels, sure, poses)),
        )

    def _disagreement(self, joints: Tensor, views: list[int], frames: slice) -> Tensor:
        """Robust mean distance from detections of other views, units of the reach, 0 to 1."""
        watched = self._watched
        known = watched.joints[frames].to(joints).expand_as(joints)
        trust = watched.trust[frames].to(joints)
        weights = trust[:, None].expand(known.shape[1:-1]).expand(known.shape[:-1]).flatten(1)
        with torch.no_grad():
            fit = procrustes(joints.flatten(1, 2), known.flatten(1, 2), weights)
        placed = fit.apply(joints.flatten(1, 2)).reshape(known.shape)
        pixels = watched.cameras.to(joints).project(placed)  # B F C 16 2
        seen = watched.joints2d[frames].to(joints)
        far = (pixels - seen).square().sum(-1) / self._unit[frames].to(joints)[..., None].square()
        value = far / (far + self._loss.reach**2)
        weight = trust[:, None, None] * watched.confidence[frames].to(joints)
        weight = weight.expand(value.shape).clone()
        for row, view in enumerate(views):
            weight[row, :, view] = 0  # what the pose was made of says nothing about it
        total: Tensor = (weight * value).sum() / weight.sum().clamp(min=1e-9)
        return total
