"""All checks of a capture's files, none of which stops at the first thing that is wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.calibration import (
    CameraRig,
    PixelMap,
    match_image,
    read_cameras,
    read_pixel_map,
)
from perfcap.io.clip import Clip
from perfcap.io.detections import CROWDED, read_detections
from perfcap.io.doctor.agreement import examine_agreement
from perfcap.io.doctor.cameras import examine_cameras
from perfcap.io.doctor.detections import examine_detections
from perfcap.io.doctor.fields import examine_fields
from perfcap.io.doctor.finding import Finding, Severity
from perfcap.io.doctor.footage import examine_blank, examine_footage
from perfcap.io.doctor.given_way import examine_way
from perfcap.io.doctor.halts import examine_halts
from perfcap.io.doctor.looked import examine_looks
from perfcap.io.doctor.shots import examine_standing
from perfcap.io.doctor.together import at_rate, camera_frames, camera_notes, of_others

Value = TypeVar("Value")


def examine_inputs(
    cameras: str | Path,
    detections: Sequence[str | Path] = (),
    videos: Sequence[str | Path] = (),
    video_map: str | Path | None = None,
    *,
    detections_in: str = "calibration",
) -> list[Finding]:
    """Read a capture's files and check them alone and against each other.

    Args:
        cameras: as for ``read_cameras``.
        detections: as for ``read_detections``.
        videos: one a view.
        video_map: as for ``read_pixel_map``.
        detections_in: which pixels detections are in, ``calibration`` or ``video``.

    Returns:
        Findings; what cannot be read is one of severity error.
    """
    findings: list[Finding] = []
    clip = _try(findings, lambda: Clip.open(videos)) if videos else None
    sizes = None if clip is None else clip.sizes
    rig = _try(findings, lambda: read_cameras(cameras, sizes))
    known = names = () if rig is None else rig.names
    if clip is not None and rig is not None:
        clip = _try(findings, partial(at_rate, clip, videos, rig)) or clip
        rig = _try(findings, partial(rig.match, clip.names)) or rig
        names = rig.names
    maps = _try(findings, lambda: read_pixel_map(video_map, names, known)) if video_map else None
    if clip is not None:
        findings += [
            *_warnings("videos", clip.warnings),
            *examine_blank(clip, clip.names, clip.start),
            *examine_halts(clip, clip.names, clip.start),
            *examine_fields(clip, clip.names),
        ]
    if rig is None:
        return findings
    if clip is not None:
        rates = _try(findings, partial(camera_notes, rig, clip)) or ()
        doubts = (*rates, *of_others(detections, names, known))
        findings += [_said(line, Severity.WARNING) for line in doubts]
    findings += examine_cameras(rig, sizes, maps)
    pixel_map = _pixel_map(rig, clip, maps)
    if detections:
        return findings + _examine_detections(rig, detections, clip, pixel_map, detections_in)
    posed = None if clip is None else _try(findings, partial(camera_frames, rig, clip, len(clip)))
    return findings if posed is None else findings + examine_ways(posed, None, clip, pixel_map)


def examine_take(
    rig: CameraRig,
    detections: Detections,
    clip: Clip | None,
    pixel_map: PixelMap | None,
    detected: bool = False,
    rests: bool = False,
    alone: bool = True,
    everybody: Detections | None = None,
) -> list[Finding]:
    """Whether cameras, joints and video belong together, of what is read already.

    Args:
        rig: C views.
        detections: (F, C), in pixels of the calibration.
        clip: the same frames and views; None of no video.
        pixel_map: from the clip's pixels to the calibration's.
        detected: whether the joints were found in this very video.
        rests: whether it is known that no camera moves.
        alone: whether nobody else is followed.
        everybody: all people who are seen, (P, F, C), where there are more than this one.
    """
    findings = examine_agreement(rig, detections, alone=alone)
    if clip is None or pixel_map is None or not rig.cameras.views == detections.views == clip.views:
        return findings
    there = pixel_map.to_video(detections.joints2d)
    late: list[Finding] = []
    crowd = None
    if everybody is not None:
        crowd = pixel_map.to_video(everybody.joints2d), everybody.confidence2d
    if not rig.cameras.moving:
        seen = there.numpy(), detections.confidence2d.numpy()
        shown = clip, rig.names, clip.fps, *seen
        others = None if crowd is None else (crowd[0].numpy(), crowd[1].numpy())
        moved = examine_standing(*shown, first=clip.start, rests=rests, everybody=others)
        # what else pixels show supposes a camera at rest
        findings += moved
        if not moved and not detected:
            late = examine_footage(clip, clip.sizes, detections, there)
    if not detected:
        take = clip, detections.confidence2d, there, rig.names
        late = late or examine_looks(*take, alone=alone, everybody=crowd)
    return findings + late


def examine_ways(
    rig: CameraRig, detections: Detections | None, clip: Clip | None, pixel_map: PixelMap | None
) -> list[Finding]:
    """Whether videos of moving cameras show the ways that are given.

    Args:
        rig: C views, of the clip's frames.
        detections: of everybody who is known, (*P, F, C), in pixels of the calibration.
        clip: the same frames and views; None of no video.
        pixel_map: from the clip's pixels to the calibration's.
    """
    if clip is None or pixel_map is None or not rig.cameras.moving:
        return []
    if rig.cameras.views != clip.views:
        return []
    seen = None
    if detections is not None:
        if detections.views != clip.views:
            return []
        places = pixel_map.to_video(detections.joints2d)
        seen = places.double().numpy(), detections.confidence2d.double().numpy()
    cameras = pixel_map.cameras(rig.cameras, clip.sizes)
    return examine_way(clip, rig.names, cameras, clip.fps, seen, clip.start)


def _examine_detections(
    rig: CameraRig,
    paths: Sequence[str | Path],
    clip: Clip | None,
    pixel_map: PixelMap | None,
    detections_in: str,
) -> list[Finding]:
    findings: list[Finding] = []
    frames = None if clip is None else len(clip)
    sizes = None if clip is None else rig.cameras.size
    if clip is not None and detections_in == "video":
        sizes = clip.sizes

    def read() -> tuple[Detections, list[str]]:
        return read_detections(
            paths,
            views=rig.names,
            pixel_offset=rig.pixel_offset,
            frames=frames,
            total=None if clip is None else clip.total,
            sizes=sizes,
            images=() if clip is None else clip.image_names,
        )

    found = _try(findings, read)
    if found is None:
        return findings
    detections, warnings = found
    if detections_in == "video" and pixel_map is not None:
        pixels = pixel_map.to_calibration(detections.joints2d)
        detections = replace(detections, joints2d=pixels)
    if clip is not None:
        posed = _try(findings, partial(camera_frames, rig, clip, detections.frame_count))
        if posed is None:
            return [*_warnings("detections", warnings), *findings]
        rig = posed
    take = examine_take(rig, detections, clip, pixel_map)
    if CROWDED in warnings:
        take = [_perhaps_another(each) for each in take]
    return [
        *_warnings("detections", warnings),
        *examine_detections(rig, detections),
        *take,
        *examine_ways(rig, detections, clip, pixel_map),
    ]


def _perhaps_another(finding: Finding) -> Finding:
    """The same of views in which another person may be followed: no error then, but a doubt."""
    if not finding.views or finding.severity is not Severity.ERROR:
        return finding
    remedy = (
        f"{finding.remedy}; unless it is another one of the people in a view, as capture --people "
        "would see"
    )
    return replace(finding, severity=Severity.WARNING, remedy=remedy)


def _pixel_map(
    rig: CameraRig, clip: Clip | None, maps: dict[str, Tensor] | None
) -> PixelMap | None:
    """The map between pixels; None where there is none, which is a finding of the cameras."""
    if clip is None:
        return None
    try:
        return match_image(rig, clip.sizes, maps)
    except InputError:
        return None


def _try(findings: list[Finding], read: Callable[[], Value]) -> Value | None:
    """The value, or None and a finding."""
    try:
        return read()
    except InputError as error:
        findings.append(_said(str(error), Severity.ERROR))
        return None


def _said(line: str, severity: Severity) -> Finding:
    """A sentence, SUBJECT: WHAT; REMEDY, as a finding."""
    subject, _, rest = line.partition(": ")
    what, _, remedy = rest.partition("; ")
    return Finding(severity, subject, what or subject, remedy)


def _warnings(subject: str, warnings: Sequence[str]) -> list[Finding]:
    return [Finding(Severity.WARNING, subject, warning) for warning in warnings]
