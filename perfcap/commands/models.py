"""Networks, bodies and actors that are at hand, and manifests for one's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class ListModels:
    """List what is shipped, and the models in a folder of one's own."""

    folder: tyro.conf.Positional[Path | None] = None
    """A folder whose subfolders hold manifests."""


@dataclass(frozen=True)
class WriteManifest:
    """Write manifest.toml beside an ONNX file of joints: its digest, and what its shapes tell."""

    file: tyro.conf.Positional[Path]
    """The ONNX file."""
    joints: str | None = None
    """What it calls its joints: COCO-17, Halpe-26, COCO-WholeBody, BlazePose-33, ...; guessed from
    the number of joints if not given."""
    licence: str = "unknown"
    """Of the weights."""
    origin: str = "unknown"
    """Where the file comes from."""
    overwrite: bool = False
    """Replace the manifest that is there."""


ModelsCommand = (
    Annotated[ListModels, tyro.conf.subcommand("list")]
    | Annotated[WriteManifest, tyro.conf.subcommand("manifest")]
)


@dataclass(frozen=True)
class Models:
    """List models, or write the manifest of a network."""

    command: tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[ModelsCommand]] = (
        ListModels()
    )
