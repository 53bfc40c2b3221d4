"""Detections as the energies want them: 3D poses on the actor's bones, clean ones believed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import bone_vectors, retarget
from perfcap.forks import note_threads
from perfcap.geometry.triangulation import translation_from_plane
from perfcap.pipeline.objective import FrameProblem

_HEAD = LANDMARKS.index("head_top")
_STRETCH = 500  # frames

_ORDER = 3  # of the differences: smooth motion leaves little in them
_WHITE = 20**0.5  # deviation of third differences of white noise of deviation one: 1, 3, 3, 1
_NORMAL = 0.6745  # median size of a normal variable of deviation one
_CONFIDENT = 0.2
_JUMP = 15.0  # third difference, in deviations, that no motion makes: a gross error of 5


@dataclass(frozen=True)
class Prepared:
    """Frames ready for the solver.

    Attributes:
        problem: with 3D joints retargeted to the actor; their ``trusted3d`` is Eq. 6's w_f.
        lifted: 3D joints of each view moved to where they project onto the 2D joints, in the
            world, (F, C, 16, 3) m; None without 3D joints.
        error3d: the PCK error of each frame and view, (F, C); None without 3D joints.
    """

    problem: FrameProblem
    lifted: Tensor | None
    error3d: Tensor | None

    @property
    def detections(self) -> Detections:
        """Those of the problem."""
        return self.problem.detections

    def frames(self, index: slice) -> Self:
        """The same for some frames."""
        return replace(
            self,
            problem=self.problem.frames(index),
            lifted=None if self.lifted is None else self.lifted[index],
            error3d=None if self.error3d is None else self.error3d[index],
        )


def prepare(problem: FrameProblem) -> Prepared:
    """Retarget 3D detections to the actor and gate them by agreement with the 2D detections.

    The PCK error of a frame and view (Xu et al. 2018, Eq. 6, left undefined there) is: retarget
    the 3D pose to the actor, translate it to fit the 2D joints, and take the confidence-weighted
    mean distance between its projection and the 2D joints, in head lengths of the actor at the
    depth of the pose. A frame is trusted below ``config.position.gate``. Head lengths make it
    PCKh's unit, and the actor's own head makes it immune to a wrong head detection.
    """
    note_threads()
    detections = problem.detections
    if detections.joints3d is None:
        return Prepared(problem, None, None)
    parts = [_prepare_part(problem.frames(part)) for part in _stretches(detections.frame_count)]
    local, trusted, lifted, error = (torch.cat(values) for values in zip(*parts, strict=True))
    seen = replace(detections, joints3d=local, trusted3d=trusted)
    return Prepared(replace(problem, detections=seen), lifted, error)


def _stretches(frames: int) -> list[slice]:
    """Stretches of a clip that bound the memory of intermediate values."""
    return [slice(start, start + _STRETCH) for start in range(0, frames, _STRETCH)]


def _prepare_part(problem: FrameProblem) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Retargeted 3D joints, their trust, the lifted joints and the PCK error of some frames."""
    cameras, detections = problem.cameras, problem.detections
    assert detections.joints3d is not None
    rest = problem.actor.skeleton.rest_landmarks
    lengths = bone_vectors(rest).norm(dim=-1)
    local = retarget(detections.joints3d, lengths)
    plane = cameras.to_plane(detections.joints2d)
    shift, error = translation_from_plane(local, plane, detections.confidence2d)
    error = error * shift[..., 2] / lengths[_HEAD]
    finite = torch.isfinite(shift).all(-1) & (shift[..., 2] > 0)
    trusted = detections.trusted3d & finite & (error < problem.config.position.gate)
    placed = local + shift.unsqueeze(-2)  # camera coordinates
    lifted = (placed - cameras.translation.unsqueeze(-2)) @ cameras.rotation
    return local, trusted, lifted, error


# --- How much detections jitter, and what to believe when they do not -----------------------------


def relaxed(problem: FrameProblem) -> FrameProblem:
    """A problem with less preference for smooth and neutral where its data need none.

    The weights are stated for detections as networks make them. Cleaner ones (markers, several
    detectors fused, exact projections) would be smoothed away by them: below a jitter of
    ``config.clean`` both weights shrink with its square, as the data's own weight would grow.

    Data with a gross error are not clean: it takes the full weights to bridge. One view without
    3D joints keeps them, because there they alone tell depth.
    """
    config, detections = problem.config, problem.detections
    if detections.views == 1 and detections.joints3d is None:
        return problem
    share = jitter(problem) / max(config.clean, 1e-12)
    if not share < 1:  # NaN too: a clip too short to tell
        return problem
    keep = max(config.cleanest, share**2)
    calmer = replace(
        config,
        trajectory=replace(config.trajectory, weight=keep * config.trajectory.weight),
        prior=replace(config.prior, weight=keep * config.prior.weight),
    )
    return replace(problem, config=calmer)


def jitter(problem: FrameProblem) -> float:
    """Deviation of the noise that is new in every frame, relative to the expected deviation.

    Third differences over time, robustly; the larger one of 2D and 3D joints. Infinite where a
    joint jumps. NaN where no joint is seen in four frames in a row.
    """
    config, detections = problem.config, problem.detections
    seen = _together(detections.confidence2d > _CONFIDENT * detections.confidence2d.amax())
    unit = config.reprojection.deviation * problem.pixel_unit
    found = _deviation(detections.joints2d / unit[:, None, None], seen)
    if detections.joints3d is not None:
        deviation = detections.joints3d.new_tensor(config.position.deviation)[:, None]
        judged = deviation[:, 0].isfinite()  # of a landmark that a joint set lacks it is infinite
        trusted = _together(detections.trusted3d)[..., None].expand(seen.shape) & judged
        found = torch.fmax(found, _deviation(detections.joints3d / deviation, trusted))
    return float(found.detach())


def _deviation(values: Tensor, seen: Tensor) -> Tensor:
    """Robust deviation of white noise in values (F, C, J, n), from the runs seen (F - 3, C, J)."""
    if len(values) <= _ORDER:
        return values.new_tensor(torch.nan)
    change = values.diff(n=_ORDER, dim=0)[seen].abs()
    if bool((change > _JUMP).any()):
        return values.new_tensor(torch.inf)
    return change.median() / (_WHITE * _NORMAL)


def _together(seen: Tensor) -> Tensor:
    """Whether a frame and the three after it are all seen, (F - 3, ...)."""
    count = max(len(seen) - _ORDER, 0)
    return torch.stack([seen[k : k + count] for k in range(_ORDER + 1)]).all(0)
