"""The second solve of an estimate: what the first one tells of its errors and its motion."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.pipeline.adapt import adapted_position, fine, squared_errors
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.error_sizes import calibrated, gain
from perfcap.pipeline.pose_estimate import ClipEstimate
from perfcap.pipeline.prior_evidence import evident_stiffness
from perfcap.pipeline.start_clip import SecondSolve, StartedClip
from perfcap.pipeline.track_motion import FittedPrior
from perfcap.pipeline.window_batch import WindowBatch
from perfcap.solve.energy import Energy
from perfcap.temporal.window import partition


def tells_depth(clip: StartedClip) -> bool:
    """Whether more than one view's pixels are known; else the first prior alone tells depth."""
    seen = clip.estimate.detections
    return clip.estimate.targets is not None or seen.views > 1 or seen.joints3d is not None


def second_start(
    actor: Actor,
    clip: StartedClip,
    motion: Motion,
    config: PoseConfig,
    rate: float,
    weights: Tensor,
) -> StartedClip:
    """The clip with weights from the sizes of its errors, and the prior its windows ask for.

    Confidences keep their graph; sizes and prior are constants.

    Args:
        actor: gives the joints.
        clip: as it was solved first.
        motion: what that found, (F,).
        config: of the pose.
        rate: frames a second.
        weights: factors of the energies, see ``WindowBatch.objective``.
    """
    motion = motion.detach()
    windows = partition(clip.estimate.frames, config.window, config.overlap)
    # all energies at once, of one window as long as the clip
    whole = WindowBatch((clip,), (partition(motion.frames, motion.frames, 0)[0],))
    with torch.no_grad():
        energies = dict(whole.objective(actor, config, rate, weights).items())
    estimate = _weighed(clip.estimate, energies, motion)
    unfitted = replace(clip, estimate=estimate, motion=motion)
    position = config.position
    if "joints3d" in energies:
        trusted = clip.trusted3d[..., None].expand(*clip.trusted3d.shape, 16)
        squared = _of_clip(energies["joints3d"], motion, trusted)
        position = adapted_position(position, squared, trusted)
    width = 1.0
    if position.scale is not None and config.position.scale is not None:
        width = (position.scale / config.position.scale) ** 2
    own = replace(config, trajectory=fine(config.trajectory, config.evidence))
    found = []
    for window in windows:
        batch = WindowBatch((unfitted,), (window,))
        with torch.no_grad():
            objective = batch.objective(actor, own, rate, weights)
            found.append(evident_stiffness(objective, batch.start(), config))
    fitted = FittedPrior(tuple(window.start for window in windows), torch.cat(found))
    second = SecondSolve(fitted, position.weight / config.position.weight, width)
    return replace(unfitted, second=second)


def _weighed(
    estimate: ClipEstimate, energies: dict[str, Energy[Motion]], motion: Motion
) -> ClipEstimate:
    """The estimate with confidences from the sizes of its errors."""
    detections, certain = estimate.detections, estimate.certain
    if "joints2d" in energies:
        confidence = detections.confidence2d
        squared = _of_clip(energies["joints2d"], motion, confidence)
        detections = replace(detections, confidence2d=calibrated(confidence, squared))
    if "targets" in energies:
        squared = _of_clip(energies["targets"], motion, certain)
        certain = certain * gain(squared, certain > 0, 3)
    return replace(estimate, detections=detections, certain=certain)


@torch.no_grad()
def _of_clip(energy: Energy[Motion], motion: Motion, like: Tensor) -> Tensor:
    whole = motion.map(lambda each: each[None])
    return squared_errors(energy, whole, like[None])[0]
