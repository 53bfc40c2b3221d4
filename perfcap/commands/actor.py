"""``perfcap actor``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from perfcap.commands.views import Views


@dataclass(frozen=True)
class ActorInspect:
    """Print what an actor is and what is wrong with it; draw a contact sheet."""

    actor: tyro.conf.Positional[str]
    """Name of a shipped actor, a skinned .glb/.gltf, or a folder with actor.glb."""
    mapping: Path | None = None
    """TOML that names the bones of joints, for rigs that are not recognised."""
    out: Path | None = None
    """Folder for contact_sheet.jpg."""


@dataclass(frozen=True)
class ActorBuild:
    """Make an actor folder of a rigged character, a bare mesh, or a person's measures."""

    out: Path
    """Folder for actor.glb, manifest.toml and contact_sheet.jpg."""
    source: tyro.conf.Positional[Path | None] = None
    """A skinned .glb, .gltf or .vrm with any bones, or a mesh of a person in a T- or A-pose without
    any (.obj, .ply, .stl, .glb), in any units, with any axis up."""
    mapping: Path | None = None
    """TOML that names the bones of joints, for rigs that are not recognised."""
    name: str | None = None
    """What to call the actor; the name of the file."""
    licence: str | None = None
    """Under which licence it may be used; what the file says."""
    overrides: Path | None = None
    """TOML of regions of a bare mesh that only some bones may move, such as a skirt."""
    detector: str | None = None
    """Find joints of a bare mesh in pictures of it from all sides as well: a folder with
    manifest.toml and an ONNX network."""
    body: bool = False
    """Make a body of the measures below instead of a file."""
    body_model: str = "ada"
    """Name or file of the body model."""
    height: float | None = None
    """Of the person, metres; for a bare mesh, with shoes and hair."""
    weight: float | None = None
    """Kilograms, for --body."""
    chest: float | None = None
    """Girth, metres, for --body, like the two below."""
    waist: float | None = None
    """Girth, metres."""
    hip: float | None = None
    """Girth, metres."""
    inseam: float | None = None
    """From the crotch to the floor, metres, for --body."""
    gender: Literal["female", "male"] | None = None
    """For --body."""
    age: float | None = None
    """Years, for --body."""


@dataclass(frozen=True, kw_only=True)
class ActorFit(Views):
    """Make an actor with the body of a person seen by one or several calibrated cameras."""

    out: Path
    """Folder for actor.glb, manifest.toml, measurements.json, contact_sheet.jpg and fit.jpg."""
    masks: tuple[Path, ...] = ()
    """Silhouettes of the person: a folder of images for each view, one image a frame of the video,
    0 is background; segmented if not given."""
    evidence: Annotated[
        Literal["silhouettes", "contours", "joints"], tyro.conf.arg(name="from")
    ] = "silhouettes"
    """What to look at beside joints: silhouettes; edges of the images, where the background moves
    or changes (several views); or joints alone, for loose clothes."""
    height: float | None = None
    """Of the person, metres; one camera needs it."""
    count: int = 12
    """Frames to fit to, spread over the clip."""
    name: str | None = None
    """What to call the actor; the name of the folder."""
    body_model: str = "ada"
    """Name or file of the body model."""


@dataclass(frozen=True)
class ActorFrames:
    """Pick sharp, evenly spread stills with masks from a video that goes around a person."""

    video: tyro.conf.Positional[Path]
    """A video, or a folder of images."""
    out: Path
    """New folder for images/, masks/ and preview.jpg."""
    count: int = 60
    """Stills to pick."""
    frames: str | None = None
    """Part of the video, A:B (B exclusive)."""
    masks: Literal["colmap", "plain", "none"] = "colmap"
    """How masks are called: 000123.jpg.png (COLMAP), 000123.png (Meshroom, Metashape); or none."""
    box: tuple[float, ...] = ()
    """Where the person stays in the picture: LEFT TOP RIGHT BOTTOM, pixels; its middle if not
    given."""


ActorCommand = (
    Annotated[ActorBuild, tyro.conf.subcommand("build")]
    | Annotated[ActorFit, tyro.conf.subcommand("fit")]
    | Annotated[ActorFrames, tyro.conf.subcommand("frames")]
    | Annotated[ActorInspect, tyro.conf.subcommand("inspect")]
)


@dataclass(frozen=True)
class ActorTools:
    """Make or examine an actor."""

    command: tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[ActorCommand]]
