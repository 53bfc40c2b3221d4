"""Captures, and what comes before: demo, capture, batch, doctor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from perfcap.commands.views import Views

AUTO = "auto"  # an actor of the person's own
Until = Literal["initialize", "track_motion", "refine_pose", "refine_surface"]


@dataclass(frozen=True)
class Demo:
    """Capture the shipped clip with the shipped actor and print the errors against its truth."""

    out: Path = Path("demo")
    """Folder for the results; an earlier demo there is shown again."""
    overwrite: bool = False
    """Replace another result that lies in the folder."""


@dataclass(frozen=True, kw_only=True)
class Capture(Views):
    """Capture a person's motion and surface from a video, or from several calibrated ones; or
    the motion of several people.
    """

    actor: tuple[str, ...] = (AUTO,)
    """auto: the person's own body, fitted to the videos. Or a shipped actor's name, a skinned
    .glb/.gltf, or a folder with actor.glb. Of several people one each, in any order, or one for
    all."""
    people: int | Literal["auto"] | None = None
    """How many people, seen by several views; auto: as many as --detections list. As many as
    actors if not given."""
    height: float | None = None
    """Of the person, metres, for --actor auto; one camera does not tell it."""
    masks: tuple[Path, ...] = ()
    """Silhouettes of the person that are used as they are: a folder of images for each view, 0 is
    background; one for each frame of the video, or of some, then numbered as they are, from 0. The
    others are found in the images."""
    out: Path | None = None
    """Folder for the results; VIDEO_capture in the working directory if not given."""
    segmenter: str = "blazepose"
    """A network that finds person masks, as one cue of silhouettes: a shipped one by name, a folder
    with manifest.toml, or a manifest; none to go without."""
    edges: str = "learned"
    """How the edges that contours of --preset rhodin2016 meet are weighed: by the shipped network,
    by weights of your own (.safetensors), or plain, as they are."""
    until: Until = "refine_surface"
    """The last stage to run."""
    preset: Literal["default", "liu2013", "monoperfcap", "muvs2017", "rhodin2016"] = "default"
    """Measured defaults, or what Xu et al. 2018 (one view), Huang et al. 2017 (several views),
    Rhodin et al. 2016 (several views, raw images without silhouettes) or Liu et al. 2013 (several
    views, frame by frame from the first one's detections) published."""
    bones: Literal["auto", "solve", "template"] = "auto"
    """Solve the person's bone lengths? auto: for a generic actor seen by several views."""
    sync: Literal["auto", "none"] = "none"
    """auto: find by how many frames, and fractions, views are later than the first one."""
    refine_cameras: bool = False
    """Correct small errors of where cameras stand and look, from the person's motion and, where
    images are looked at, silhouettes."""
    camera_motion: Literal["auto", "none"] = "auto"
    """auto: find how the camera of one video without --cameras moved, by what is behind the person;
    none: it stands still."""
    floor: Literal["auto", "none"] = "auto"
    """Keep standing feet still and above the floor; none: for stairs, beams and climbing."""
    device: str = "auto"
    """Where to compute: auto, cpu, cuda, ..."""
    memory: str | None = None
    """Main memory that may be taken, such as 2G: fewer threads then look at large images at once.
    The result has the same bits."""
    overlay: bool = True
    """Write overlay.mp4 and textured.mp4."""
    report: bool = False
    """Write report.html, which plays the result in a browser, from disk."""
    overwrite: bool = False
    """Replace the result that lies in the folder; it stays until the new one is complete."""
    resume: bool = False
    """Go on with this very call where it was stopped; do nothing where its result is there."""

    @property
    def everybody(self) -> bool:
        """Whether files that list everybody are sorted by people."""
        return self.people is not None or len(self.actor) > 1

    @property
    def head_count(self) -> int | None:
        """How many people are captured; None for as many as there are."""
        if isinstance(self.people, int):
            return self.people
        return len(self.actor) if self.people is None else None

    @property
    def folder(self) -> Path:
        """Where the result goes; named after the first video if nobody says."""
        if self.out is not None:
            return self.out
        name = self.videos[0].resolve().stem if self.videos else "perfcap"
        return Path(f"{name}_capture")


@dataclass(frozen=True)
class Batch:
    """Capture all clips of a list, a line each; go on where an earlier call stopped."""

    clips: tyro.conf.Positional[Path]
    """CSV whose first line names columns: videos, and any options of perfcap capture (cameras,
    detections, actor, preset, ...), and name. Several values in a cell are apart by semicolons."""
    out: Path
    """Folder for the results, one each, and for index.html and summary.csv."""
    processes: int | None = None
    """Clips captured at once; as many as there are cores if not given."""
    cluster: str | None = None
    """Run on Ray: the address of a cluster whose machines see the same folders, or local."""
    report: bool = True
    """Write report.html of every clip."""


@dataclass(frozen=True)
class Doctor:
    """Check the installation and, before any solve, the inputs."""

    videos: tyro.conf.Positional[tuple[Path, ...]] = ()
    """The videos, to compare their size with the calibration's; or the folder of a Pose2Sim
    project or a FreeMoCap recording."""
    cameras: Path | None = None
    """Calibration to check."""
    detections: tuple[Path, ...] = ()
    """Detections to check against the cameras."""
    video_map: Path | None = None
    """JSON of affine maps from video to calibration pixels."""
    detections_in: Literal["calibration", "video"] = "calibration"
    """Which pixels detections are in, where the two differ."""
