"""What is done with a capture: evaluate, render, export, retarget, report, view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

Format = Literal[
    "glb", "bvh", "usd", "usdz", "obj", "ply", "trc", "c3d", "npz", "csv", "osim", "qpos"
]


@dataclass(frozen=True)
class Evaluate:
    """Errors of a result against its truth, as a table and metrics.json."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture."""
    truth: Path
    """An npz with joints3d [F,16,3] in metres, a folder that holds truth.npz or gt.npz, or the
    folder of a data set."""
    dataset: str | None = None
    """Which data set that is: monoperfcap, human36m, mpi_inf_3dhp, humaneva, 3dpw, emdb, panoptic,
    rendered or pose2sim."""
    sequence: str | None = None
    """Which of its sequences."""
    out: Path | None = None
    """Where the numbers go, as JSON; metrics.json in the folder if not given."""
    every: int = 1
    """Compare surfaces and silhouettes of one in so many frames."""


@dataclass(frozen=True)
class Render:
    """Draw a finished capture from any camera, as a video."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture; nothing else is needed."""
    out: Path
    """The video, .mp4."""
    orbit: float | None = None
    """Degrees that the camera goes around the person; 360 if no camera is given."""
    camera: Path | None = None
    """See it from the camera of a calibration file, fixed or moving, instead."""
    view: str | None = None
    """Which view of that file; the first if not given."""
    size: tuple[int, int] | None = None
    """Width and height in pixels; 720 720, or the camera's."""
    frames: str | None = None
    """Part of the capture, A:B (B exclusive), counted as in its video."""
    freeze: int | None = None
    """Show this frame only, while the camera moves."""
    seconds: float | None = None
    """How long a frozen frame is shown; 4."""
    up: Literal["auto", "floor", "x", "y", "z", "-x", "-y", "-z"] = "auto"
    """Which axis of the world points up; auto: the one along which people stand; floor: square to
    the floor that was found."""


@dataclass(frozen=True)
class Export:
    """Write a finished capture as files of other programs; docs/formats.md says which for which."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture."""
    to: tuple[Format, ...]
    """One or several formats; usd, usdz and c3d need an extra of perfcap."""
    out: Path | None = None
    """Folder for the files; FOLDER/export if not given."""
    name: str | None = None
    """What to call the files; the name of the folder if not given."""
    frames: str | None = None
    """Part of the capture, A:B (B exclusive), counted as in its video."""
    up: Literal["y", "z"] | None = None
    """Which axis points up in the files; z in c3d, else y, if not given. glb is always y up."""
    unit: Literal["m", "cm", "mm"] | None = None
    """Of length; cm in bvh, mm in trc and c3d, else m, if not given. glb is always in metres."""
    world_up: Literal["auto", "floor", "x", "y", "z", "-x", "-y", "-z"] = "auto"
    """Which axis of the capture's world points up; auto: the one along which people stand; floor:
    square to the floor that was found."""
    surface: bool = True
    """Write the captured surface into glb and usd, where there is one, beside the skinned mesh."""
    markers: Literal["landmarks", "bones"] = "landmarks"
    """Markers of trc and c3d: the 16 landmarks, or the origins of the actor's bones."""
    order: Literal["auto", "ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX"] = "auto"
    """Of the axes in bvh; auto: for each joint the one whose angles move the least."""


@dataclass(frozen=True)
class Retarget:
    """Put the motion of a capture, a BVH file or an animated character on another character."""

    source: tyro.conf.Positional[Path]
    """Folder of a capture, a .bvh, or a .glb, .gltf or .vrm with an animation."""
    actor: tuple[str, ...]
    """Who shall move so: a shipped actor, a skinned .glb/.gltf/.vrm with any bones, a folder with
    actor.glb, or a humanoid robot as .urdf or .xml (MJCF). Of several people one for all, or one
    each."""
    out: Path
    """Folder for the result, which all commands take that take a capture."""
    frames: str | None = None
    """Part of the source, A:B (B exclusive)."""
    mapping: Path | None = None
    """Bones of the actor, where perfcap cannot tell (docs/actors.md)."""
    source_mapping: Path | None = None
    """Likewise of the source; metres_per_unit in it is the unit of a BVH file."""
    floor: Literal["auto", "none"] = "auto"
    """Keep standing feet still and above the floor; none: for stairs, beams and climbing."""
    overwrite: bool = False
    """Replace the result that lies in the folder."""


@dataclass(frozen=True)
class Report:
    """Write report.html: the result as one page that plays in a browser, without a network."""

    folder: tyro.conf.Positional[Path]
    """Folder of a capture."""
    videos: tuple[Path, ...] = ()
    """The input videos, where they are no longer where the capture found them."""
    cameras: Path | None = None
    """The calibration, likewise."""
    truth: Path | None = None
    """True joints, for curves of errors: an npz with joints3d, or a folder that holds one; of
    several people the folder with person1, person2, ..."""
    frames: str | None = None
    """Part of the capture, A:B (B exclusive), counted as in its video."""


@dataclass(frozen=True)
class View:
    """Open the report of a result in a browser; written first where it is missing or old. Two
    results are shown side by side, by a page in the working directory.
    """

    folder: tyro.conf.Positional[tuple[Path, ...]]
    """Folder of a capture, or of two of the same frames."""
