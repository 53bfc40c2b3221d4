"""Whether cameras, videos and files of joints are of one recording: rates, numbers and names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig
from perfcap.io.clip import END_SLACK, RATE_SLACK, Clip
from perfcap.io.detections import named_views
from perfcap.io.view_names import find_view, match_views


def at_rate(
    clip: Clip, videos: Sequence[str | Path], rig: CameraRig, part: slice = slice(None)
) -> Clip:
    """The clip at the rate of its cameras where it has none: images do not say theirs."""
    if rig.fps is None or any(source.fps is not None for source in clip.sources):
        return clip
    return Clip.open(videos, fps=rig.fps, frames=part)  # images: cheap to open again


def of_others(
    paths: Sequence[str | Path], names: Sequence[str], known: Sequence[str]
) -> Iterator[str]:
    """Files of joints whose names are those of cameras that are not looked through.

    A file that lists several views, those of the videos among them, may be called anything.
    """
    for path in paths:
        listed = named_views(Path(path))
        if len(listed) > 1 and match_views(names, listed) is not None:
            continue
        view = find_view(Path(path).stem.removesuffix("_json"), known)
        if view is not None and known[view] not in names:
            yield (
                f"--detections {path}: is named after the view {known[view]}, the videos are of "
                f"{', '.join(names)}; is it of another camera?"
            )


def camera_notes(rig: CameraRig, clip: Clip) -> tuple[str, ...]:
    """Notes on cameras of another frame rate, and on poses of moving ones that end early.

    Raises:
        InputError: they move, at another rate.
    """
    return (*_rate(rig, clip), *_number(rig, clip))


def _number(rig: CameraRig, clip: Clip) -> Iterator[str]:
    """Poses of a part of the video may be those of another part than its beginning."""
    count = rig.cameras.intrinsics.shape[0]
    if rig.cameras.moving and clip.total is not None and count < clip.total - END_SLACK:
        yield (
            f"--cameras: has {count} poses, the video {clip.total} frames; they are taken for its "
            f"first {count} frames"
        )


def _rate(rig: CameraRig, clip: Clip) -> tuple[str, ...]:
    if rig.fps is None or abs(rig.fps / clip.fps - 1) <= RATE_SLACK:
        return ()
    rates = f"--cameras: run at {rig.fps:.4g} frames a second, the video at {clip.fps:.4g}"
    if rig.cameras.moving:
        raise InputError(
            f"{rates}; expected a pose for every frame of the video, and its rate or none"
        )
    return (rates,)


def camera_frames(rig: CameraRig, clip: Clip, frames: int) -> CameraRig:
    """The cameras of the clip's part; fixed ones are the same for every frame.

    Raises:
        InputError: moving ones are fewer than the frames, or more than the video's, or lack some
            in between.
    """
    if not rig.cameras.moving:
        return rig
    count = rig.cameras.intrinsics.shape[0]
    if count < clip.start + frames:
        raise InputError(
            f"--cameras: has {count} frames, the clip needs {clip.start + frames}; give a camera "
            "for every frame"
        )
    if clip.total is not None and count > clip.total + END_SLACK:
        raise InputError(
            f"--cameras: has {count} frames, the video {clip.total}; expected a camera for every "
            "frame, counted from the first of the video"
        )
    if rig.left_out and (clip.total is None or count < clip.total):
        raise InputError(
            f"--cameras: has {count} poses, but none of images before {rig.left_out}, and the "
            "video has more frames; expected a pose for every frame, from the first: register the "
            "images that are missing, or capture a folder of those that have poses"
        )
    return replace(rig, cameras=rig.cameras.frames(slice(clip.start, clip.start + frames)))
