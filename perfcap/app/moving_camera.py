"""Whether the camera of one video is held in a hand, and how it moved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.app.console import progress_bars
from perfcap.app.gravity import find_up, upright_start
from perfcap.app.inputs import Inputs
from perfcap.io.body_model import DEFAULT_BODY, load_body_model
from perfcap.io.doctor.rest import CONFIDENT, about_joints, background_shift
from perfcap.matchmove import CornerTracks, find_bars, find_ground, find_way, find_zoom
from perfcap.pipeline.camera_motion import CameraMotion, in_metres

Array = NDArray[np.float64]

_EDGES, _BODIES = math.radians(1), math.radians(6)  # deviations of up, as edges and poses show it
_LONG = 0.5 / math.tan(math.radians(10))  # sizes of the image: a focal length that is no phone's
_LONGEST = 1800  # frames; more take gigabytes
_BLOCK = 8  # frames that are read at once
_NAMED = 6  # cuts
_SAMPLES = 8  # frames in which bars beside the picture are looked for


def camera_moves(inputs: Inputs) -> bool:
    """Whether what is behind the person moves in one view."""
    shift = background_shift(inputs.clip, 0, inputs.clip.fps, *_joints(inputs))
    return shift is not None


def _joints(inputs: Inputs) -> tuple[Array, Array]:
    """Of one view, pixels of the video (F, 16, 2), and their confidence (F, 16)."""
    pixels = inputs.pixel_map.to_video(inputs.detections.joints2d)[:, 0]
    return pixels.numpy(), inputs.detections.confidence2d[:, 0].numpy()


def find_motion(inputs: Inputs) -> tuple[CameraMotion | None, tuple[str, ...]]:
    """How the camera of one video moved, and what a user should know of it.

    Args:
        inputs: one view with an assumed camera.

    Returns:
        No motion where the background does not show it, and sentences about why.
    """
    clip, count = inputs.clip, inputs.detections.frame_count
    joints, confidence = _joints(inputs)
    if count > _LONGEST:
        return None, (
            f"the camera moves, and its way is found in {_LONGEST} frames at most, of {count}; "
            "give --frames",
        )
    tracks = CornerTracks()
    hidden = None
    some = np.linspace(0, count - 1, min(_SAMPLES, count)).round().astype(int).tolist()
    bars = find_bars([clip.read_view(0, each, each + 1)[0] for each in some])
    with progress_bars() as tell:
        for start in range(0, count, _BLOCK):
            stop = min(start + _BLOCK, count)
            for frame, image in enumerate(clip.read_view(0, start, stop), start):
                seen = confidence[frame] > CONFIDENT
                if hidden is None or seen.any():  # else where the person was last
                    hidden = about_joints(joints[frame, seen], image.shape[:2])
                tracks.add(image, hidden | bars)
            tell("camera motion", stop, count)
    lens = inputs.pixel_map.cameras(inputs.rig.cameras, clip.sizes).intrinsics[0]
    focal, middle = float(lens[0, 0]), lens[:2, 2].tolist()
    guessed = inputs.rig.guessed
    seen = tracks.sightings()
    way = find_way(seen, count, (focal, *middle), clip.fps, guessed=guessed)
    zoom = None
    if way is None or way.moves:
        zoom = find_zoom(seen, count, (focal * (way.factor if way else 1), *middle), clip.fps)
    if zoom is not None:
        return None, (
            f"the lens zooms: what is behind the person grows by {zoom - 1:.0%}, far and near "
            "alike, and one lens is assumed for all frames, so that the person comes nearer as it "
            "does; capture a part without (--frames), or give K of every frame in camera.json",
        )
    if way is None:
        return None, tuple(_shots(tracks.cuts(), clip.start, count))
    longer = focal * way.factor / max(clip.sizes[0])
    if guessed and longer > _LONG:
        angle = 2 * math.degrees(math.atan(0.5 / longer))
        return None, (
            f"what is behind the person moves as a lens of {angle:.0f} degrees shows it, which no "
            "phone has: is the picture cropped, or steadied, in a program? --fov says the true one",
        )
    like = torch.zeros((), dtype=torch.float64)
    cameras, detections = inputs.rig.cameras.to(like), inputs.detections.to(like)
    actor = load_body_model(DEFAULT_BODY).actor(torch.zeros(0))
    turned = replace(way, translation=0 * way.translation, moves=False)
    motion = in_metres(actor, cameras, detections, clip.fps, turned)
    turning = replace(inputs, rig=replace(inputs.rig, cameras=motion.of_camera(cameras)))
    up, ground = find_up(turning), None
    about = upright_start(turning) if up is None else up
    if about is not None:
        ground = find_ground(way.points, about.numpy(), _BODIES if up is None else _EDGES)
    found = in_metres(actor, cameras, detections, clip.fps, way, ground)
    found = found if up is None else replace(found, up=up)
    return found, (found.sentence(inputs.rig.cameras),)


def _shots(cuts: Sequence[int], first: int, count: int) -> Iterator[str]:
    """That a video is cut, and its longest shot, which can be captured on its own."""
    if not cuts:
        return
    start, stop = max(pairwise((0, *cuts, count)), key=lambda shot: shot[1] - shot[0])
    where = ", ".join(str(first + cut) for cut in cuts[:_NAMED])
    more = ", ..." if len(cuts) > _NAMED else ""
    yield (
        f"the video cuts, or the camera swings, before frame {where}{more}: one shot can be "
        f"captured at a time; the longest is --frames {first + start}:{first + stop}"
    )
