"""``perfcap train``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from perfcap.train.config import TrainDetectorConfig, TrainLifterConfig


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


TrainCommand = (
    Annotated[TrainLifter, tyro.conf.subcommand("lifter")]
    | Annotated[TrainDetector, tyro.conf.subcommand("detector")]
)


@dataclass(frozen=True)
class Train:
    """Train a network: a lifter or a detector."""

    command: Annotated[tyro.conf.OmitSubcommandPrefixes[TrainCommand], tyro.conf.arg(name="")]
