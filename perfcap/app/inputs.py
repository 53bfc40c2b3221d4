"""Everything a capture needs, read and checked against each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from torch import Tensor

from perfcap.app.console import progress_bars
from perfcap.app.looked_at import fixed_frames
from perfcap.app.networks import (
    LIFTERS,
    Detecting,
    detect_clip,
    detect_everybody,
    find_model,
    open_networks,
    open_watcher,
    parse_boxes,
)
from perfcap.commands.views import Views
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.lifter import OnnxLifter
from perfcap.detect.onnx import OnnxDetector
from perfcap.detect.pose_fusion import fuse_poses
from perfcap.errors import InputError
from perfcap.io.calibration import (
    CameraRig,
    PixelMap,
    assumed_rig,
    match_image,
    read_cameras,
    read_pixel_map,
)
from perfcap.io.clip import END_SLACK, Clip
from perfcap.io.detections import read_candidates, read_detections
from perfcap.io.doctor.cameras import impossible_cameras
from perfcap.io.doctor.together import at_rate, camera_frames, camera_notes, of_others
from perfcap.matchmove import picture_size
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint

_LOOKS = 0.0, 1 / 3, 2 / 3, 1.0  # of the clip, where bars beside the picture are looked for


@dataclass(frozen=True)
class Inputs:
    """A clip, its cameras and its detections, frame for frame.

    Attributes:
        clip: the frames that are captured.
        rig: one camera a view, in the order of the clip's views.
        detections: in pixels of the calibration, (F, C, 16); of everybody (P, F, C, 16), see
            ``read_candidates``.
        pixel_map: from the clip's pixels to the calibration's.
        warnings: what a user should know.
        lost: frames that should follow, but a damaged video or its detections end before.
        files: what was read, and the state of each.
        lag: frames by which images were taken later than their frame, (F, C); see ``Images``.
        up: against gravity in the world of the cameras, (3,), where it is known.
        rests: whether the images have shown already that no camera moves.
    """

    clip: Clip
    rig: CameraRig
    detections: Detections
    pixel_map: PixelMap
    warnings: tuple[str, ...]
    lost: int = 0
    files: Mapping[str, str | None] = field(default_factory=dict)
    lag: Tensor | None = None
    up: Tensor | None = None
    rests: bool = False


def read_inputs(request: Views, checkpoint: Checkpoint = NO_CHECKPOINT) -> Inputs:
    """A clip with its cameras and detections, found in the videos where a detector is given.

    Args:
        request: files and options.
        checkpoint: keeps what is detected.

    Raises:
        InputError: anything that cannot be used, in one line.
    """
    _check_detections(request)
    lifter = next((OnnxLifter(find_model(name, LIFTERS)) for name in request.lifters), None)
    chosen = request.lifter is not None  # else it is for who has no 3D poses at all
    if not request.detectors:
        inputs = _read(request)
        posed = bool(inputs.detections.trusted3d.any())
        return _lifted(inputs, None if posed and not chosen else lifter)
    _check_detector(request)
    finder, detectors = open_networks(request.detectors)
    if detectors[0].sees_poses and not chosen:
        lifter = None
    boxes = parse_boxes(request.box, len(request.videos))
    with progress_bars() as tell:
        detecting = Detecting(
            *(detectors, boxes, request.person or 1, tell, checkpoint),
            poses=lifter is not None,
            finder=finder,
            watcher=open_watcher(request.watcher),
            chosen=request.person is not None,
        )
        if request.everybody:
            detecting = replace(detecting, people=request.head_count or 1)
        seen = _read(request, detecting)
        if lifter is None:
            return seen
        alone = replace(seen, detections=seen.detections.without_poses())
        return _lifted(alone, lifter, seen.detections)


def _check_detections(request: Views) -> None:
    """Joints come from files or from networks, one of the two."""
    if request.detections and request.detector:
        raise InputError(
            "--detections: and --detector are both given; expected files of joints, or networks "
            "that find them in the videos"
        )
    if request.detections and (request.box or request.person is not None):
        name = "--box" if request.box else "--person"
        raise InputError(f"{name}: is for joints found in videos; leave it out with --detections")
    if request.box and request.person is not None:
        raise InputError("--person: and --box are both given; leave one of them out")
    if request.person is not None and request.person < 1:
        raise InputError(f"--person: is {request.person}; expected 1 for the surest, 2, 3, ...")
    if request.fov is not None and request.cameras is not None:
        raise InputError("--fov: and --cameras are both given; leave one of them out")


def _check_detector(request: Views) -> None:
    """Networks follow as many people as they are told, each wherever they are found."""
    if request.everybody and request.head_count is None:
        raise InputError(
            "--people auto: counts the people that --detections list; without these say how many"
        )
    if request.everybody and (request.box or request.person is not None):
        name = "--box" if request.box else "--person"
        raise InputError(f"{name}: is for one person; leave it out where several are captured")


def _read(request: Views, detecting: Detecting | None = None) -> Inputs:
    """Everything but 3D poses of a lifter; with ``detecting``, no files of joints are read."""
    part = parse_frames(request.frames)
    videos = list(request.videos)
    clip = Clip.open(videos, frames=part)
    if request.cameras is None:
        rig = assumed_rig(clip, request.fov, _picture(clip))
    else:
        rig = read_cameras(request.cameras, clip.sizes)
    clip = at_rate(clip, videos, rig, part)
    known = rig.names
    rig = rig.match(clip.names) if len(rig.names) > 1 or clip.views > 1 else rig
    about = (*clip.warnings, *_short(request.frames, part, clip), *rig.warnings)
    about += (*camera_notes(rig, clip), *of_others(request.detections, rig.names, known))
    maps = read_pixel_map(request.video_map, rig.names, known) if request.video_map else None
    pixel_map = match_image(rig, clip.sizes, maps)
    if request.detections_in == "video" and detecting is not None:
        raise InputError(
            "--detections-in video: says which pixels files of --detections are in, and none are "
            "given; networks look at the videos themselves"
        )
    if detecting is not None:
        _require_possible(request.cameras, rig)
        chosen = _detect(clip, rig, pixel_map, detecting)
        found_by = () if detecting.finder is None else detecting.finder.session.warnings
        told = (*about, *_about_networks(detecting.detectors), *found_by)
        lost = clip.lost if part.stop is None else 0
        return Inputs(clip, camera_frames(rig, clip, len(clip)), chosen, pixel_map, told, lost)
    end = clip.start + len(clip)
    reader = read_candidates if request.everybody else read_detections
    sizes = clip.sizes if request.detections_in == "video" else rig.cameras.size
    given = list(request.detections)
    read = partial(reader, given, views=rig.names, sizes=sizes, images=clip.image_names)
    whole, used = (end, None) if part.stop is None else (clip.total, end)
    offset = rig.pixel_offset
    found, notes = read(pixel_offset=offset, frames=whole, used=used, total=clip.total)
    _require_possible(request.cameras, rig)
    chosen = _part_of(found, clip)
    if request.detections_in == "video":
        chosen = _to_calibration(chosen, pixel_map)
    rig = camera_frames(rig, clip, chosen.frame_count)
    lost = len(clip) - chosen.frame_count
    if clip.lost and part.stop is None:
        # of the frames that the file promises, those count that somebody detected joints in
        lost += min(clip.lost, max(0, read()[0].frame_count - end))
    return Inputs(clip, rig, chosen, pixel_map, (*about, *notes), lost)


def _picture(clip: Clip) -> tuple[int, int]:
    """Height and width of the first view's picture, without bars that a program put beside it."""
    some = {round(share * (len(clip) - 1)) for share in _LOOKS}
    return picture_size([clip.read_view(0, each, each + 1)[0] for each in sorted(some)])


def _about_networks(detectors: Sequence[OnnxDetector]) -> tuple[str, ...]:
    """What a user should know of networks: of one, all; of several, what none of them sees."""
    if len(detectors) == 1:
        return detectors[0].warnings
    lost = [name for name in LANDMARKS if all(name in d.joint_set.missing() for d in detectors)]
    note = f"no network sees {', '.join(lost)}"
    about = dict.fromkeys(line for d in detectors for line in d.session.warnings)
    return (*about, *((note,) if lost else ()))


def _require_possible(path: Path | None, rig: CameraRig) -> None:
    for finding in impossible_cameras(rig):
        raise InputError(f"{path}: {finding}")


def _lifted(inputs: Inputs, lifter: OnnxLifter | None, seen: Detections | None = None) -> Inputs:
    """The same with 3D poses in views that have none, where there is a lifter; others help it."""
    if lifter is None:
        return inputs
    if inputs.detections.trusted3d.all():
        told = "--lifter: is not used, since the detections hold 3D poses of all views and frames"
        return replace(inputs, warnings=(*inputs.warnings, told))
    lifted = lifter(inputs.detections, inputs.rig.cameras, inputs.clip.fps)
    more = (*inputs.warnings, *lifter.session.warnings)
    return replace(inputs, detections=fuse_poses(lifted, seen), warnings=more)


def _detect(clip: Clip, rig: CameraRig, pixel_map: PixelMap, detecting: Detecting) -> Detections:
    """Joints found in the clip, in pixels of the calibration."""
    cameras = pixel_map.cameras(camera_frames(rig, clip, len(clip)).cameras, clip.sizes)
    detect = detect_clip if detecting.people is None else detect_everybody
    clip.keep(fixed_frames(len(clip), clip.fps))  # until nobody needs them; see ``Clip.keep``
    found = detect(clip, detecting, cameras).to(cameras.intrinsics)
    return _to_calibration(found, pixel_map)


def _part_of(detections: Detections, clip: Clip) -> Detections:
    """The detections of the clip's frames; a few may be missing at the end."""
    chosen = detections.frames(slice(clip.start, clip.start + len(clip)))
    missing = len(clip) - chosen.frame_count
    if missing > END_SLACK or not chosen.frame_count:
        raise InputError(
            f"--detections: hold {detections.frame_count} frames, expected those of frames "
            f"{clip.start} to {clip.start + len(clip) - 1}; detect all of the video, or give "
            "--frames"
        )
    return chosen


def parse_frames(text: str | None) -> slice:
    """``A:B`` with either side open, as a slice.

    Raises:
        InputError: another form.
    """
    if text is None:
        return slice(0, None)
    parts = text.split(":")
    if len(parts) != 2 or not all(p.isdecimal() or not p for p in parts):
        raise InputError(f"--frames {text}: expected A:B, such as 0:100, with A before B")
    start, stop = (int(p) if p else None for p in parts)
    return slice(start or 0, stop)


def _short(text: str | None, part: slice, clip: Clip) -> Iterator[str]:
    """That a clip ends before the part of it that was asked for."""
    end = clip.start + len(clip)
    if part.stop is not None and part.stop > end:
        yield f"--frames {text}: the video ends with frame {end - 1}; is it whole?"


def _to_calibration(detections: Detections, pixel_map: PixelMap) -> Detections:
    return replace(detections, joints2d=pixel_map.to_calibration(detections.joints2d))
