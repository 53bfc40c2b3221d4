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


@dataclass(frozen=True)
class TryNetwork:
    """Look at the shipped clip with a network of joints: how many it finds as its manifest reads
    it, and whether it would find them better with other colours, values or columns.
    """

    model: tyro.conf.Positional[str]
    """Folder with manifest.toml and its ONNX file, or the name of a shipped network."""


ModelsCommand = (
    Annotated[ListModels, tyro.conf.subcommand("list")]
    | Annotated[WriteManifest, tyro.conf.subcommand("manifest")]
    | Annotated[TryNetwork, tyro.conf.subcommand("try")]
)


@dataclass(frozen=True)
class Models:
    """List models, write the manifest of a network, or try it."""

    command: tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[ModelsCommand]] = (
        ListModels()
    )
