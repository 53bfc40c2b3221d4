"""Pose refinement as a layer: what any estimator says in, motion within anatomical limits out."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS16, JointSet
from perfcap.eager import eager
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import is_readable
from perfcap.pipeline.adapt import adapted
from perfcap.pipeline.batch_doubts import batch_doubts, clip_sentences, together_doubts
from perfcap.pipeline.bone_doubts import bone_doubts
from perfcap.pipeline.clip_problem import TERMS, ClipProblem, Term
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.estimate_doubts import (
    empty_poses,
    estimate_doubts,
    lost_gradients,
    place_doubts,
    size_doubts,
    unsolved,
)
from perfcap.pipeline.input_checks import require_flags, require_kinds
from perfcap.pipeline.own_energies import own_terms
from perfcap.pipeline.placed_doubts import placed_doubts
from perfcap.pipeline.pose_estimate import ClipEstimate, Clips, Raw, read_estimates, start_clip
from perfcap.pipeline.refiner_joints import known_joints, without_missing
from perfcap.pipeline.result_doubts import fit_doubts
from perfcap.pipeline.track_motion import MotionBlender, select, solve_windows
from perfcap.pipeline.track_twice import loose, twice
from perfcap.precision import own_precision
from perfcap.rates import frame_rate, rate_doubts
from perfcap.solve import Adjoint, Detached, Implicit, Status
from perfcap.temporal.window import Window, partition

_EXAMINED, _LEARNT = 16, 100  # clips of a batch; and batches, after which a network sees a joint
_ACTOR = "and give the actor of this person: actor.resized makes one of other bone lengths"


@dataclass(frozen=True)
class RefinedPose:
    """Motion of the clips of a batch, padded to the longest; of one clip without ``B``.

    Attributes:
        motion: (B, F); padded frames repeat the clip's last one.
        joints: the 16 landmarks in the world, (B, F, 16, 3), metres.
        valid: frames that are no padding, (B, F), bool.
        status: the worst ``Status`` of each clip's windows, (B,) integers. Windows that failed
            are where they started, and carry no gradient.
    """

    motion: Motion
    joints: Tensor
    valid: Tensor
    status: Tensor

    def clips(self) -> Iterator[tuple[Motion, Tensor]]:
        """Motion (F,) and joints (F, 16, 3) of each clip of a batch, without padding."""
        for index, frames in enumerate(self.valid.sum(-1).tolist()):
            yield select(self.motion, index)[:frames], self.joints[index, :frames]


class PoseRefiner(nn.Module):
    """Makes the joints of any pose estimator a motion of a person (Xu et al. 2018, Eq. 2 and 3).

    Windows of the clips are solved within the limits of the angles, and blended. In ``train`` mode
    gradients go through the solves to whatever made the joints, to cameras and to the actor's
    bones; in ``eval`` mode, and under ``torch.no_grad``, nothing is recorded. What is measured on
    the joints before a solve, the person's height in the image, the jitter, and which 3D poses are
    trusted, is a constant of it, and so is what a first solve tells the second: the sizes of errors
    and the stiffness of the trajectory prior. It computes in the type and on the device of the
    actor, whatever autocast, ``torch.set_float32_matmul_precision`` or the type of joints say.

    Args:
        actor: the rigged person; part of the module, so ``.to()`` moves it.
        joint_set: names of the estimator's joints, or the name of a known set. Landmarks that the
            set lacks count for nothing and are inferred from the rest.
        rate: frames a second.
        config: weights, units and windows.
        adjoint: how solves are differentiated in ``train`` mode.
        learn_weights: make the weights of the energies parameters.
        energies: your own energies by name, see ``Term``; they act in windows, beside the others.

    Of the first batch that it sees, 16 clips at most, it says in warnings what ``perfcap doctor``
    would: exchanged axes and sides, units, views that disagree, frames that do not follow one
    another; and where the solved person is far from the joints, as in the order of another joint
    set, or has other bones than several views show. It looks again at the 10th, 100th, ... batch,
    as the first one may be of a network that has learned nothing yet; and counts batches of each
    mode and of each kind of input on their own, as those to test with are often read otherwise.

    Attributes:
        names: of the energies whose weights can be learned.
        log_weights: logarithms of a factor on the weight of each of them.

    Raises:
        InputError: the joint set is not known, or lacks the hips or all of the trunk above them.
    """

    log_weights: nn.Parameter

    def __init__(
        self,
        actor: Actor,
        joint_set: JointSet | str = LANDMARKS16,
        rate: float = 30.0,
        config: PoseConfig | None = None,
        adjoint: Adjoint | None = None,
        *,
        learn_weights: bool = False,
        energies: Mapping[str, Term] | None = None,
    ) -> None:
        super().__init__()
        require_kinds(actor=actor)
        if config is not None and not isinstance(config, PoseConfig):
            raise InputError(
                f"config is a {type(config).__name__}, expected a PoseConfig such as "
                "CaptureConfig().pose"
            )
        self.actor = actor
        self.joint_set = known_joints(joint_set)
        self.rate = frame_rate(rate)
        self.config = without_missing(config or PoseConfig(), self.joint_set)
        self.adjoint = adjoint or Implicit()
        self.energies = own_terms(energies)
        self._batches: dict[tuple[object, ...], int] = {}  # by mode and kind
        self.names = TERMS
        like = actor.skeleton.lower
        self.log_weights = nn.Parameter(
            like.new_zeros(len(self.names)), requires_grad=learn_weights
        )

    @eager
    def forward(
        self,
        cameras: Camera | Sequence[Camera],
        joints2d: Clips | None = None,
        confidence2d: Clips | None = None,
        joints3d: Clips | None = None,
        *,
        placed: bool = False,
        lengths: Tensor | Sequence[int] | None = None,
        rate: float | None = None,
    ) -> RefinedPose:
        """Refine a clip (F, ...), a padded batch (B, F, ...), or a list of clips.

        Args:
            cameras: C views for all clips, or one such ``Camera`` a clip; each fixed, (C,), or
                moving, (F, C).
            joints2d: (F, C, J, 2), pixels.
            confidence2d: (F, C, J), 1 if not given; of 3D joints where there are no 2D ones.
                Joints that are not finite count for nothing.
            joints3d: (F, C, J, 3), metres, in the axes of each view's camera. With 2D joints, only
                the pose they show counts, not where and how large; a pose in which a joint is not
                finite is left out.
            placed: 3D joints also say where in front of the camera the person is. Always so
                without 2D joints: joints relative to a root are then refined in place.
            lengths: frames of each clip of a padded batch, (B,).
            rate: frames a second, of all these clips; the module's if not given.

        Raises:
            InputError: shapes that do not fit, a clip without anybody in it, 3D joints that are
                not in metres, or a rate that is none.
        """
        require_flags(placed=placed)
        rate = self.rate if rate is None else frame_rate(rate)
        _warn(rate_doubts(rate))
        like = self.actor.skeleton.lower
        if like.dtype not in (torch.float32, torch.float64):
            raise InputError(
                f"PoseRefiner is {like.dtype}, in which nothing can be solved; keep it float32 or "
                "float64: it takes inputs of any type, and autocast does not reach it"
            )
        raw = Raw(joints2d, confidence2d, joints3d, placed, lengths)
        with own_precision(like.device.type):
            estimates, batched = read_estimates(raw, cameras, self.joint_set, self.actor)
            told = [] if self.training else [*lost_gradients([e.detections for e in estimates])]
            started = [start_clip(self.actor, each, self.config, rate) for each in estimates]
            odd = self._examine(estimates) if self._due(estimates) else []
            factors = dict(zip(self.names, self.log_weights.exp().unbind(), strict=True))
            clips = [replace(clip, factors=factors, terms=self.energies) for clip, _ in started]
            motions, status = self._solve_twice(clips, [motion for _, motion in started])
            _warn((*told, *unsolved(status)))
            refined = self._pad(motions, status)
            self._examine_fit(estimates[: len(odd)], refined, odd)
        return refined if batched else _single(refined)

    def _due(self, clips: Sequence[ClipEstimate]) -> bool:
        """Whether to examine this batch: a training loop has no time for all of them."""
        first = clips[0]
        placed, posed = first.targets is not None, first.detections.joints3d is not None
        kind = self.training, first.detections.views, first.has_pixels, posed, placed
        count = self._batches.get(kind, 0) + 1
        due: bool = count == 10 ** (len(str(count)) - 1)
        if due and not all(is_readable(each.detections.joints2d.detach().cpu()) for each in clips):
            return False
        self._batches[kind] = count
        return due

    def _examine(self, clips: Sequence[ClipEstimate]) -> list[bool]:
        """Warn of mistakes that clips show.

        Returns:
            Whether there was one, of each clip that was looked at.
        """
        told, batch = list[list[str]](), max(self._batches.values())
        _warn(batch_doubts(clips), within=1)
        missing = self.joint_set.missing()
        for clip in clips[:_EXAMINED]:
            seen = clip.detections.map(lambda part: part.detach().cpu())
            tuned = clip.detections.confidence2d.requires_grad and batch < _LEARNT
            lines = [*estimate_doubts(clip.cameras, seen, missing, tuned), *empty_poses(clip.empty)]
            if clip.targets is not None and not lines:
                lines += size_doubts(self.actor, clip.targets, clip.certain)
                lines += placed_doubts(clip)
            lines += () if lines else bone_doubts(self.actor, clip.cameras, seen, _ACTOR)
            told.append(lines)
        together = tuple(together_doubts(self.actor, clips, missing, _ACTOR))
        _warn(clip_sentences(told, together), within=1)
        return [bool(lines) for lines in told]

    def _examine_fit(
        self, clips: Sequence[ClipEstimate], refined: RefinedPose, told: Sequence[bool]
    ) -> None:
        """Warn of clips in which the solved person is far from the joints."""
        for index, (clip, (_, joints)) in enumerate(zip(clips, refined.clips(), strict=False)):
            cameras = clip.cameras.map(Tensor.detach)
            seen = clip.detections.map(Tensor.detach)
            which = "" if len(clips) == 1 else f"clip {index}: "
            lines = [*fit_doubts(cameras, seen, joints.detach())]
            if clip.targets is not None and not (clip.has_pixels or told[index]):
                lines += place_doubts(cameras, clip.targets, clip.certain, joints)
            _warn(lines, which, within=1)

    def _solve_twice(
        self, clips: list[ClipProblem], initial: list[Motion]
    ) -> tuple[list[Motion], list[int]]:
        """Motion (F,) and worst status of each clip; the first solve is a constant."""
        again = [index for index, clip in enumerate(clips) if twice(clip)]
        if again:
            with torch.no_grad():
                first, _ = _solve([loose(clips[i]) for i in again], [initial[i] for i in again])
            for index, motion in zip(again, first, strict=True):
                clips[index], initial[index] = adapted(clips[index], motion), motion.detach()
        return _solve(clips, initial, self.adjoint if self.training else Detached())

    def _pad(self, motions: list[Motion], status: list[int]) -> RefinedPose:
        longest = max(motion.frames for motion in motions)
        device = self.log_weights.device
        frame = torch.arange(longest, device=device)
        padded = [motion[frame.clamp(max=motion.frames - 1)] for motion in motions]
        motion = Motion.stack(padded)
        lengths = torch.tensor([each.frames for each in motions], device=device)
        valid = frame < lengths[:, None]
        return RefinedPose(
            motion, self.actor.joints(motion), valid, torch.tensor(status, device=device)
        )


def _solve(
    clips: list[ClipProblem], initial: list[Motion], adjoint: Adjoint | None = None
) -> tuple[list[Motion], list[int]]:
    """Motion (F,) and worst status of each clip."""
    blenders = [MotionBlender() for _ in clips]
    worst = [int(Status.CONVERGED)] * len(clips)
    for group in _groups(clips):
        solution, _ = solve_windows(clips, initial, group, adjoint)
        for i, (clip, window) in enumerate(group):
            blenders[clip].push(window, select(solution.state, i))
            worst[clip] = max(worst[clip], int(solution.status[i]))
    skeleton = clips[0].actor.skeleton
    return [blender.finish(skeleton) for blender in blenders], worst


def _groups(clips: Sequence[ClipProblem]) -> Iterator[list[tuple[int, Window]]]:
    """Windows of all clips with the index of their clip, ``config.batch`` at once.

    Those of a group have one length, and all or none of them a prior from a first solve: what
    another clip lacks must not change this one. Those of a clip come in their order.
    """
    config = clips[0].config
    alike: dict[tuple[int, bool], list[tuple[int, Window]]] = {}
    for index, clip in enumerate(clips):
        for window in partition(clip.frames, config.window, config.overlap):
            key = len(window), clip.first is None
            alike.setdefault(key, []).append((index, window))
    for windows in alike.values():
        for start in range(0, len(windows), config.batch):
            yield windows[start : start + config.batch]


def _single(refined: RefinedPose) -> RefinedPose:
    return RefinedPose(
        select(refined.motion, 0), refined.joints[0], refined.valid[0], refined.status[0]
    )


def _warn(lines: Iterable[str], which: str = "", within: int = 0) -> None:
    """Warn whoever calls the module, from so many functions within ``forward``."""
    for line in lines:
        warnings.warn(f"PoseRefiner: {which}{line}", stacklevel=6 + within)
