"""Captures, and what comes before: demo, capture, doctor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro


@dataclass(frozen=True)
class Demo:
    """Capture the shipped clip with the shipped actor and print the errors against its truth."""

    out: Path = Path("demo")
    """Folder for the results; an earlier demo there is shown again."""
    overwrite: bool = False
    """Replace another result that lies in the folder."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.demo import run_demo

        return run_demo(self.out, self.overwrite)


@dataclass(frozen=True)
class Capture:
    """Capture the motion and surface of one person from one or several calibrated videos."""

    videos: tyro.conf.Positional[tuple[Path, ...]]
    """A video or a folder of images; one for each view."""
    actor: str
    """Name of a shipped actor, a skinned .glb/.gltf, or a folder with actor.glb."""
    cameras: Path
    """Calibration: camera.json, Calib*.toml, EasyMocap intri/extri.yml, or a COLMAP text folder."""
    out: Path
    """Folder for the results."""
    detections: tuple[Path, ...] = ()
    """Joints: detections.npz, OpenPose folders, or keypoint JSON; one for each view."""
    detector: str | None = None
    """Find the joints in the videos instead: a folder with manifest.toml and an ONNX network."""
    box: tuple[float, ...] = ()
    """Where --detector finds the person in the first frame: LEFT TOP RIGHT BOTTOM for each view,
    pixels; searched for if not given."""
    lifter: str | None = None
    """Give 3D poses to views without: a folder with manifest.toml, or a shipped network's name."""
    until: Literal["initialize", "track_motion", "refine_pose", "refine_surface"] = "refine_surface"
    """The last stage to run."""
    frames: str | None = None
    """Part of the clip, A:B (B exclusive)."""
    preset: Literal["default", "monoperfcap"] = "default"
    """Measured defaults, or the constants published by Xu et al. 2018."""
    bones: Literal["auto", "solve", "template"] = "auto"
    """Solve the person's bone lengths? auto: for a generic actor seen by several views."""
    video_map: Path | None = None
    """JSON of affine maps from video to calibration pixels, where the two differ."""
    detections_in: Literal["calibration", "video"] = "calibration"
    """Which pixels detections are in, where the two differ."""
    device: str = "auto"
    """Where to compute: auto, cpu, cuda, ..."""
    overlay: bool = True
    """Write overlay.mp4 and textured.mp4."""
    report: bool = False
    """Write report.html, which plays the result in a browser, from disk."""
    overwrite: bool = False
    """Replace the result that lies in the folder; it stays until the new one is complete."""
    resume: bool = False
    """Go on with this very call where it was stopped; do nothing where its result is there."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.capture import CaptureRequest, run_capture

        return run_capture(CaptureRequest(**vars(self)))


@dataclass(frozen=True)
class Doctor:
    """Check the installation and, before any solve, the inputs."""

    videos: tyro.conf.Positional[tuple[Path, ...]] = ()
    """The videos, to compare their size with the calibration's."""
    cameras: Path | None = None
    """Calibration to check."""
    detections: tuple[Path, ...] = ()
    """Detections to check against the cameras."""
    video_map: Path | None = None
    """JSON of affine maps from video to calibration pixels."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from perfcap.app.doctor import run_doctor

        return run_doctor(self.cameras, self.detections, self.videos, self.video_map)
