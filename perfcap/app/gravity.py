"""Which way is up in a video, by straight edges behind the person."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.app.inputs import Inputs
from perfcap.app.looked_at import gravity_frames
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.rest import CONFIDENT, about_joints
from perfcap.matchmove import Sight, find_vertical
from perfcap.pipeline.floor import weight_axis

_ALIKE = 0.97  # length of the mean of the bodies' axes: they stand and walk
_FEWEST = 5  # 3D poses that say about which way is up
_SOLES = [LANDMARKS.index(f"{side}_{end}") for side in "lr" for end in ("ankle", "toe")]


def find_up(inputs: Inputs) -> Tensor | None:
    """Against gravity in the world of one view's camera, a unit vector (3,).

    3D poses say about where: people have their weight above their feet. None where there are no
    such poses, or no straight edges that agree.

    Args:
        inputs: one view.
    """
    seen, cameras = inputs.detections, inputs.rig.cameras
    start, count = upright_start(inputs), seen.frame_count
    if start is None:
        return None
    turns = cameras.every_frame(count).rotation[:, 0].double()
    joints = inputs.pixel_map.to_video(seen.joints2d)[:, 0].numpy()
    confident = seen.confidence2d[:, 0].numpy() > CONFIDENT
    mapped = inputs.pixel_map.cameras(cameras, inputs.clip.sizes).every_frame(count)
    sights = []
    for frame in gravity_frames(count):
        image = inputs.clip.read_view(0, frame, frame + 1)[0]
        hidden = about_joints(joints[frame, confident[frame]], image.shape[:2])
        lens = mapped.intrinsics[frame, 0]
        middle = lens[:2, 2].tolist()
        pinhole = (float(lens[0, 0]), middle[0], middle[1])
        sights.append(Sight(image, hidden, pinhole, turns[frame].numpy()))
    up = find_vertical(sights, start.numpy())
    return None if up is None else torch.from_numpy(up)


def upright_start(inputs: Inputs) -> Tensor | None:
    """About up in the world of one view's camera, as 3D poses show it, (3,).

    None without any, or of who bends, climbs or lies: their axis is another in every frame.
    """
    seen = inputs.detections
    if seen.joints3d is None:
        return None
    trusted = torch.nonzero(seen.trusted3d[:, 0]).flatten()
    if len(trusted) < _FEWEST:
        return None
    turns = inputs.rig.cameras.every_frame(seen.frame_count).rotation[:, 0].double()
    placed = seen.joints3d[trusted, 0].double() @ turns[trusted]
    up, alike = weight_axis(placed, placed[:, _SOLES])
    return up if alike > _ALIKE else None
