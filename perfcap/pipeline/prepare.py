"""Detections as the energies want them: the actor's bone lengths, untrusted 3D poses gated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import bone_vectors, retarget
from perfcap.forks import note_threads
from perfcap.geometry.camera import Camera
from perfcap.geometry.triangulation import translation_from_plane

_HEAD = LANDMARKS.index("head_top")
_STRETCH = 500  # frames


@dataclass(frozen=True)
class Prepared:
    """Detections ready for the solver.

    Attributes:
        detections: 3D joints retargeted to the actor; ``trusted3d`` is Eq. 6's w_f.
        lifted: 3D joints of each view moved to where they project onto the 2D joints, in the
            world, (F, C, 16, 3) m; None without 3D joints.
        error3d: the PCK error of each frame and view, (F, C); None without 3D joints.
    """

    detections: Detections
    lifted: Tensor | None
    error3d: Tensor | None

    def frames(self, index: slice) -> Self:
        """The same for some frames."""
        return replace(
            self,
            detections=self.detections.frames(index),
            lifted=None if self.lifted is None else self.lifted[index],
            error3d=None if self.error3d is None else self.error3d[index],
        )


def prepare(actor: Actor, cameras: Camera, detections: Detections, gate: float = 0.4) -> Prepared:
    """Retarget 3D detections to the actor and gate them by agreement with the 2D detections.

    The PCK error of a frame and view (Xu et al. 2018, Eq. 6, left undefined there) is: retarget
    the 3D pose to the actor, translate it to fit the 2D joints, and take the confidence-weighted
    mean distance between its projection and the 2D joints, in head lengths of the actor at the
    depth of the pose. A frame is trusted below ``gate``. Head lengths make it PCKh's unit, and
    the actor's own head makes it immune to a wrong head detection.
    """
    note_threads()
    if detections.joints3d is None:
        return Prepared(detections, None, None)
    parts = [
        _prepare_part(actor, cameras.frames(part), detections.frames(part), gate)
        for part in _stretches(detections.frame_count)
    ]
    local, trusted, lifted, error = (torch.cat(values) for values in zip(*parts, strict=True))
    return Prepared(replace(detections, joints3d=local, trusted3d=trusted), lifted, error)


def _stretches(frames: int) -> list[slice]:
    """Stretches of a clip that bound the memory of intermediate values."""
    return [slice(start, start + _STRETCH) for start in range(0, frames, _STRETCH)]


def _prepare_part(
    actor: Actor, cameras: Camera, detections: Detections, gate: float
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Retargeted 3D joints, their trust, the lifted joints and the PCK error of some frames."""
    assert detections.joints3d is not None
    rest = actor.skeleton.rest_landmarks
    lengths = bone_vectors(rest).norm(dim=-1)
    local = retarget(detections.joints3d, lengths)
    plane = cameras.to_plane(detections.joints2d)
    shift, error = translation_from_plane(local, plane, detections.confidence2d)
    error = error * shift[..., 2] / lengths[_HEAD]
    finite = torch.isfinite(shift).all(-1) & (shift[..., 2] > 0)
    trusted = detections.trusted3d & finite & (error < gate)
    placed = local + shift.unsqueeze(-2)  # camera coordinates
    lifted = (placed - cameras.translation.unsqueeze(-2)) @ cameras.rotation
    return local, trusted, lifted, error
