"""Whether clips of a batch are the frames of a motion, and what single images show together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.finding import counted
from perfcap.pipeline.bone_doubts import bone_doubts
from perfcap.pipeline.clip_problem import alike_cameras
from perfcap.pipeline.estimate_doubts import relative_poses
from perfcap.pipeline.input_doubts import images_doubts
from perfcap.pipeline.pose_estimate import ClipEstimate

_FEWEST, _MOST = 6, 64  # clips
_SHORT = 10  # frames: checks of poses want as many
_NEARER = 0.4  # of the way to other clips, and to the next frame of a clip, from clip to clip


def batch_doubts(clips: Sequence[ClipEstimate]) -> Iterator[str]:
    """Whether each clip goes on where the one before it is, as one frame of a motion after another.

    Windows of a clip are farther apart than their frames, copies of one with errors of their own
    are all equally far apart.
    """
    frames = clips[0].frames
    if len(clips) < _FEWEST or any(
        each.frames != frames or each.detections.views != clips[0].detections.views
        for each in clips
    ):
        return
    joints = torch.stack([_joints(each) for each in clips[:_MOST]])  # B F C 16 D
    near, far = _apart(joints, 1), _apart(joints, len(joints) // 2)
    along = _apart(joints.transpose(0, 1), 1) if frames > 1 else far
    if not near < _NEARER * min(far, along):
        return
    remedy = (
        "give such frames as one clip, (F, C, J, 2), or images in no order"
        if frames == 1
        else "expected (B, F, C, J, 2): clips first, then their frames"
    )
    yield (
        f"the {len(clips)} clips of {counted(frames)} follow one another as the "
        f"frames of a motion do; {remedy}"
    )


def together_doubts(
    actor: Actor, clips: Sequence[ClipEstimate], missing: Collection[str], remedy: str
) -> Iterator[str]:
    """What clips that are too short to show it alone show together, as images of a shuffled batch.

    Args:
        actor: of all of them.
        clips: most of which say nothing each by itself.
        missing: landmarks that the estimator does not have.
        remedy: where the actor's bones have other lengths than views show, and that is no mistake.
    """
    clips = clips[:_MOST]
    kinds = {(each.detections.views, each.cameras.size) for each in clips}
    if len(clips) < 2 or len(kinds) > 1 or max(each.frames for each in clips) >= _SHORT:
        return
    parts = [each.detections.map(lambda part: part.detach().cpu()) for each in clips]
    seen = Detections.cat([replace(e, joints3d=relative_poses(e, missing)) for e in parts])
    every = [each.cameras.every_frame(each.frames) for each in clips]
    cameras = Camera.cat(
        [each.map(lambda part: part.detach().cpu()) for each in alike_cameras(every)]
    )
    lines = images_doubts(cameras, seen) or tuple(bone_doubts(actor, cameras, seen, remedy))
    for line in lines:
        yield f"the {len(clips)} clips together: {line}"


def clip_sentences(told: Sequence[Sequence[str]], together: Sequence[str]) -> Iterator[str]:
    """What clips show together, then what is said of each, of more than half of them once."""
    most, rest = once_of_most(told) if together else ([], told)
    yield from together
    yield from (f"most clips alone: {line}" for line in most)
    for index, lines in enumerate(rest):
        which = "" if len(told) == 1 else f"clip {index}: "
        yield from (f"{which}{line}" for line in lines)


def once_of_most(told: Sequence[Sequence[str]]) -> tuple[list[str], list[list[str]]]:
    """What is said of more than half of the clips, each once, and the rest, of each clip."""
    count = Counter(line for lines in told for line in dict.fromkeys(lines))
    most = [line for line, clips in count.items() if 2 * clips > len(told)]
    return most, [[line for line in lines if line not in most] for lines in told]


def _joints(clip: ClipEstimate) -> Tensor:
    """Joints (F, C, 16, D) in images, or else 3D ones, NaN where unknown."""
    seen = clip.detections
    if clip.has_pixels or seen.joints3d is None:
        joints, known = seen.joints2d, seen.confidence2d > 0
    else:
        joints, known = seen.joints3d, clip.certain > 0
    return torch.where(known[..., None], joints, torch.nan).detach()


def _apart(joints: Tensor, steps: int) -> float:
    """Median way of a joint to another so many places on along the first axis."""
    return float((joints[steps:] - joints[:-steps]).norm(dim=-1).nanmedian())
