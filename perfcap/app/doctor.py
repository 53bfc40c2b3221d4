"""``perfcap doctor``: what is wrong with the installation or the inputs, before any solve."""

from __future__ import annotations

from perfcap.app.console import PlainConsole
from perfcap.app.project import find_project
from perfcap.commands.capture import Doctor
from perfcap.errors import InputError
from perfcap.io.doctor import Severity, examine_inputs, examine_installation

COLORS = {Severity.ERROR: "red", Severity.WARNING: "yellow", Severity.INFO: "default"}


def run_doctor(request: Doctor) -> int:
    """Print findings; returns 2 when one of them will spoil a capture.

    Raises:
        InputError: files to check, but no cameras to check them against.
    """
    cameras, detections, videos = request.cameras, request.detections, request.videos
    found = find_project(videos, cameras, joints=not detections)
    if found is not None:
        cameras, videos = found.cameras, found.videos
        detections = detections or found.detections
    if cameras is None and (detections or videos or request.video_map):
        alone = "; one video needs none: perfcap capture assumes a lens, and checks the same"
        raise InputError(
            "--cameras: is missing; expected the calibration that detections and videos are "
            f"checked against{alone if len(videos) == 1 else ''}"
        )
    findings = list(examine_installation())
    if cameras is not None:
        files = (list(detections), list(videos), request.video_map)
        findings += examine_inputs(cameras, *files, detections_in=request.detections_in)
    console = PlainConsole()
    for finding in findings:
        console.print(str(finding), style=COLORS[finding.severity], soft_wrap=True)
    errors = sum(finding.severity is Severity.ERROR for finding in findings)
    console.print(f"{errors} errors, {len(findings) - errors} other findings")
    return 2 if errors else 0
