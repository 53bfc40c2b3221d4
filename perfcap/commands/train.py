"""``perfcap train``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from perfcap.commands.views import Views
from perfcap.train.config import TrainDetectorConfig, TrainHeadConfig, TrainLifterConfig


@dataclass(frozen=True)
class TrainLifter:
    """Train a network from 2D joint tracks to 3D poses, export it and write its card."""

    motion: Path
    """Folder of recorded motion: clips.npz and clips.csv."""
    out: Path
    """Folder for checkpoints, metrics.jsonl and the model."""
    config: Annotated[TrainLifterConfig, tyro.conf.arg(name="")] = field(
        default_factory=TrainLifterConfig
    )
    """People, steps, network, cameras, noise."""
    licence: str = "unstated"
    """Of the weights; follows from the motion's."""
    resume: bool = False
    """Go on from the last checkpoint; ends as if it had never stopped."""
    start: Path | None = None
    """Checkpoint whose weights to start from."""
    together_with: tuple[Path, ...] = ()
    """Checkpoints of other runs, whose answers are averaged with this one's in the model."""
    tracks: Path | None = None
    """Archive of tracks that networks found in videos, with the truth, to learn errors from."""


@dataclass(frozen=True)
class TrainDetector:
    """Train a network from images to 2D and 3D joints; export it and write its card."""

    motion: Path
    """Folder of recorded motion: clips.npz and clips.csv."""
    out: Path
    """Folder for rendered crops, checkpoints, metrics.jsonl and the model."""
    config: Annotated[TrainDetectorConfig, tyro.conf.arg(name="")] = field(
        default_factory=TrainDetectorConfig
    )
    """People, steps, network, pictures."""
    licence: str = "unstated"
    """Of the weights; follows from those of motion, actors and pictures."""
    resume: bool = False
    """Go on from the last checkpoint; ends as if it had never stopped."""
    crops_folder: Path | None = None
    """Folder of rendered crops, to share them between runs; OUT/crops if not given."""
    body_model: str = "ada"
    """Name or file of the body model."""
    actors: tuple[str, ...] = ("sam",)
    """People with clothes of their own: names, .glb files or folders."""
    backgrounds: Path | None = None
    """Folder of pictures without people; procedural ones if not given."""
    photographs: Path | None = None
    """Folder of photographs with annotated joints to learn from as well."""
    start: Path | None = None
    """Checkpoint whose weights to start from."""


@dataclass(frozen=True, kw_only=True)
class TrainHead(Views):
    """Adapt a network to your own footage, without labels: calibrated views of one person are
    captured together, and a head on the network's features learns to say from each view alone what
    all of them say together.
    """

    out: Path
    """Folder for checkpoints, metrics.jsonl and the model."""
    config: Annotated[TrainHeadConfig, tyro.conf.arg(name="")] = field(
        default_factory=TrainHeadConfig
    )
    """Frames, crops, losses, steps."""
    network: str | None = None
    """The network to adapt: a shipped one by name, or a folder with manifest.toml. The one with 3D
    joints among the default detectors if not given."""
    features: tuple[str, ...] = ()
    """Tensors of the network that are its features; what its last layers read if not given."""
    actor: str = "auto"
    """The person's own body, fitted to the videos, or a shipped actor's name, a file or folder."""
    height: float | None = None
    """Of the person, metres, for --actor auto."""
    through_solver: bool = True
    """Go on through the solver after the fit to the solution of all views."""
    resume: bool = False
    """Go on from the last checkpoint; ends as if it had never stopped."""


TrainCommand = (
    Annotated[TrainLifter, tyro.conf.subcommand("lifter")]
    | Annotated[TrainDetector, tyro.conf.subcommand("detector")]
    | Annotated[TrainHead, tyro.conf.subcommand("head")]
)


@dataclass(frozen=True)
class Train:
    """Train a network: a lifter or a detector, or a head that adapts a detector."""

    command: Annotated[tyro.conf.OmitSubcommandPrefixes[TrainCommand], tyro.conf.arg(name="")]
