"""What commands that read views of a person have in common."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

DEFAULT_DETECTORS = ("thunder", "blazepose_heavy", "rendered")  # the first one follows the person
FINDER = "multipose"  # before them, where several people are wanted; else it watches for others
DEFAULT_LIFTER = "cmu"
NO_LIFTER = "none"


@dataclass(frozen=True, kw_only=True)
class Views:
    """Views of a person, and how their joints come about."""

    videos: tyro.conf.Positional[tuple[Path, ...]]
    """A video or a folder of images; one for each view. Or the folder of a Pose2Sim project or a
    FreeMoCap recording, which has videos, cameras and joints."""
    cameras: Path | None = None
    """Calibration: camera.json, Calib*.toml, EasyMocap intri/extri.yml, or a COLMAP text folder.
    One view needs none: its lens is read from the video, or assumed."""
    fov: float | None = None
    """Degrees that a camera without calibration sees across the longer side of the image."""
    detections: tuple[Path, ...] = ()
    """Joints: detections.npz, OpenPose folders, keypoint JSON or .npy; one for each view. Found in
    the videos if not given."""
    detector: tuple[str, ...] = ()
    """Networks that find the joints, shipped ones by name or folders with manifest.toml. The first
    one follows the person, the others add to it; one that finds people in whole images, as
    multipose, goes before them, and tells others from the person. perfcap models lists them."""
    box: tuple[float, ...] = ()
    """Where the person is in the first frame: LEFT TOP RIGHT BOTTOM for each view, pixels; searched
    for if not given."""
    person: int | None = None
    """Which person of the first frame, where several are seen: 1 is the surest, 2 the next."""
    lifter: str | None = None
    """Give 3D poses to views without: a folder with manifest.toml, a shipped network's name, or
    none; cmu for one or two videos, unless files or the first network have 3D poses already."""
    frames: str | None = None
    """Part of the clip, A:B (B exclusive)."""
    video_map: Path | None = None
    """JSON of affine maps from video to calibration pixels, where the two differ."""
    detections_in: Literal["calibration", "video"] = "calibration"
    """Which pixels detections are in, where the two differ."""

    @property
    def everybody(self) -> bool:
        """Whether everybody is read, whoever they are; else one person, who is followed."""
        return False

    @property
    def head_count(self) -> int | None:
        """How many people are found; None for as many as there are."""
        return 1

    @property
    def detectors(self) -> tuple[str, ...]:
        """The networks that find the joints; none where files hold them."""
        if self.detections:
            return ()
        before = (FINDER,) if self.everybody else ()
        return self.detector or (*before, *DEFAULT_DETECTORS)

    @property
    def watcher(self) -> str | None:
        """The network that tells others from the one person who is followed, if any does."""
        return None if self.everybody or self.detections or self.detector else FINDER

    @property
    def lifters(self) -> tuple[str, ...]:
        """The network that lifts them, or none; the default where 3D poses are lacking."""
        if self.lifter is not None:
            return () if self.lifter == NO_LIFTER else (self.lifter,)
        found = len(self.videos) <= 2 and not self.everybody
        return (DEFAULT_LIFTER,) if found else ()
