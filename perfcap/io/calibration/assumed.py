"""The camera of one video that nobody calibrated, and the file that says what was assumed."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.atomic import writing
from perfcap.io.calibration.rig import CameraRig
from perfcap.io.clip import Clip
from perfcap.io.video import VideoFile

ASSUMED_FOV = 60.0  # degrees across the longer side, of a phone's main lens between its video modes
_FILM = 36.0  # mm, the longer side of the frame that equivalent focal lengths refer to
_NARROWEST, _WIDEST = 5.0, 150.0


def assumed_rig(
    clip: Clip, fov: float | None = None, picture: tuple[int, int] | None = None
) -> CameraRig:
    """A camera without distortion at the origin, x right, y down, z forward, for one view.

    Its focal length is the user's, else what the video's metadata say, else that of a lens that
    sees 60 degrees across the longer side of the picture. A pose is known up to a similarity in any
    case: a wrong focal length moves the person away or nearer, and changes the pose little.

    Args:
        clip: one video.
        fov: degrees across the longer side of the image.
        picture: (height, width) without bars beside it; that of the image if not given.

    Raises:
        InputError: several views, which do need calibration, or an angle that no lens has.
    """
    if clip.views > 1:
        raise InputError(
            f"--cameras: is missing for {clip.views} views; expected their calibration. Pose2Sim "
            "(Pose2Sim.calibration, from a checkerboard) and EasyMocap write files that are read, "
            "COLMAP where the background has texture; one view needs none"
        )
    height, width = clip.sizes[0]
    longer = max(height, width)
    focal, note, guessed = _focal(clip, fov, longer, max(picture or (height, width)))
    intrinsics = torch.tensor(
        [[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]],
        dtype=torch.float64,
    )
    camera = Camera(
        intrinsics[None],
        torch.eye(3, dtype=torch.float64)[None],
        torch.zeros(1, 3, dtype=torch.float64),
        None,
        ((height, width),),
    )
    return CameraRig(clip.names, camera, warnings=(note,), guessed=guessed)


def _focal(clip: Clip, fov: float | None, longer: int, picture: int) -> tuple[float, str, bool]:
    """Pixels, where they come from in words, and whether that is nowhere."""
    if fov is not None:
        if not _NARROWEST <= fov <= _WIDEST:
            raise InputError(
                f"--fov: is {fov:g}; expected {_NARROWEST:g} to {_WIDEST:g} degrees across the "
                "longer side of the image"
            )
        note = f"no --cameras: a lens of {fov:g} degrees, as --fov says"
        focal = _pixels(fov, longer)
        without = f"{_degrees(focal, picture):.0f}"
        if without != f"{fov:.0f}":  # else a dark edge of the image
            note += f" of the image with its bars ({without} without)"
        return focal, note, False
    source = clip.sources[0]
    film = source.film_focal if isinstance(source, VideoFile) else None
    if film is not None:
        angle = math.degrees(2 * math.atan(0.5 * _FILM / film))
        note = (
            f"no --cameras: the video says its lens is equivalent to {film:g} mm, {angle:.0f} "
            "degrees across the longer side"
        )
        return longer * film / _FILM, note, False
    focal = _pixels(ASSUMED_FOV, picture)
    across = f"{ASSUMED_FOV:g} degrees across the longer side"
    with_bars = f"{_degrees(focal, longer):.0f}"  # which are no part of what a lens sees
    if with_bars != f"{ASSUMED_FOV:g}":
        across += f" of the picture between bars ({with_bars} of the image)"
    note = (
        f"no --cameras: a lens of {across} is assumed; --fov says another, and distances follow it"
    )
    return focal, note, True


def _pixels(fov: float, longer: int) -> float:
    return 0.5 * longer / math.tan(math.radians(0.5 * fov))


def _degrees(focal: float, longer: int) -> float:
    return math.degrees(2 * math.atan(0.5 * longer / focal))


def save_assumed(
    path: Path, cameras: Camera, names: Sequence[str], fps: float, start: int = 0
) -> None:
    """Write a camera as ``read_cameras`` reads it, to capture or draw with again.

    Args:
        path: of the file.
        cameras: fixed ones, or of each frame.
        names: of the views.
        fps: frames a second.
        start: of the first frame in the video, which moving cameras count by; frames before it
            have the first one's.
    """
    views = {}
    if cameras.moving:
        index = torch.arange(-start, len(cameras.rotation)).clamp(min=0)
        cameras = cameras.frames(index)
    for view, name in enumerate(names):
        height, width = cameras.size[view]
        lens = cameras.intrinsics[..., view, :, :]
        views[name] = {
            "K": np.round((lens[0] if cameras.moving else lens).numpy(), 6).tolist(),
            "R": cameras.rotation[..., view, :, :].numpy().tolist(),
            "t": cameras.translation[..., view, :].numpy().tolist(),
            "width": width,
            "height": height,
        }
    with writing(path) as file:
        file.write(json.dumps({"fps": fps, "views": views}, indent=1).encode())
