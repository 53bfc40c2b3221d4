"""All checks of a capture's files, none of which stops at the first thing that is wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig, read_cameras, read_pixel_map
from perfcap.io.clip import Clip
from perfcap.io.detections import read_detections
from perfcap.io.doctor.agreement import examine_agreement
from perfcap.io.doctor.cameras import examine_cameras
from perfcap.io.doctor.detections import examine_detections
from perfcap.io.doctor.finding import Finding, Severity

Value = TypeVar("Value")


def examine_inputs(
    cameras: str | Path,
    detections: Sequence[str | Path] = (),
    videos: Sequence[str | Path] = (),
    video_map: str | Path | None = None,
) -> list[Finding]:
    """Read a capture's files and check them alone and against each other.

    Args:
        cameras: as for ``read_cameras``.
        detections: as for ``read_detections``.
        videos: one a view.
        video_map: as for ``read_pixel_map``.

    Returns:
        Findings; what cannot be read is one of severity error.
    """
    findings: list[Finding] = []
    clip = _try(findings, lambda: Clip.open(videos)) if videos else None
    sizes = None if clip is None else clip.sizes
    rig = _try(findings, lambda: read_cameras(cameras, sizes))
    maps = _try(findings, lambda: read_pixel_map(video_map)) if video_map else None
    if clip is not None:
        findings += _warnings("videos", clip.warnings)
    if rig is None:
        return findings
    if clip is not None:
        rig = _try(findings, partial(rig.match, clip.names)) or rig
    findings += examine_cameras(rig, sizes, maps)
    if detections:
        frames = None if clip is None else len(clip)
        findings += _examine_detections(rig, detections, frames)
    return findings


def _examine_detections(
    rig: CameraRig, paths: Sequence[str | Path], frames: int | None
) -> list[Finding]:
    findings: list[Finding] = []

    def read() -> tuple[Detections, list[str]]:
        return read_detections(paths, views=rig.names, pixel_offset=rig.pixel_offset, frames=frames)

    found = _try(findings, read)
    if found is None:
        return findings
    detections, warnings = found
    return [
        *_warnings("detections", warnings),
        *examine_detections(rig, detections),
        *examine_agreement(rig, detections),
    ]


def _try(findings: list[Finding], read: Callable[[], Value]) -> Value | None:
    """The value, or None and a finding."""
    try:
        return read()
    except InputError as error:
        subject, _, rest = str(error).partition(": ")
        what, _, remedy = rest.partition("; ")
        findings.append(Finding(Severity.ERROR, subject, what or subject, remedy))
        return None


def _warnings(subject: str, warnings: Sequence[str]) -> list[Finding]:
    return [Finding(Severity.WARNING, subject, warning) for warning in warnings]
