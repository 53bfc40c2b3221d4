"""What every reader of a data set gives, whatever its layout."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.calibration import CameraRig
from perfcap.metrics import Alignment

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]

_SAME = 0.9  # share of the triangles of a mesh that tell it from another


@dataclass(frozen=True)
class Protocol:
    """How the authors of a data set, and those who compare on it, score results.

    Attributes:
        joints: landmarks that are scored.
        alignments: of the errors that are reported.
        splits: names of subjects or sequences, by the name of the part.
        step: every how many frames are scored.
        source: where it is defined.
    """

    joints: tuple[str, ...]
    alignments: tuple[Alignment, ...]
    splits: Mapping[str, tuple[str, ...]]
    source: str
    step: int = 1


@dataclass(frozen=True, eq=False)
class SurfaceTruth:
    """What a person really looked like, on the vertices of one template.

    Attributes:
        vertices: (F, V, 3), metres, world.
        faces: (T, 3).
        places: which of them each vertex of the actor's file shows, which splits them where
            textures have seams, (S,).
        loose: which of them are loose cloth, (V,).
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    places: NDArray[np.int64]
    loose: NDArray[np.bool_]

    @property
    def order(self) -> NDArray[np.int64]:
        """A vertex of the actor's file that shows each of them, (V,)."""
        order = np.zeros(self.vertices.shape[1], np.int64)
        order[self.places] = np.arange(len(self.places))
        return order

    def has_faces(self, faces: NDArray[np.int64]) -> bool:
        """Whether triangles (T', 3) of the actor's file are those of the template, most of them."""
        own = {tuple(sorted(face)) for face in self.faces.tolist()}
        shown = np.sort(self.places[faces], axis=1).tolist()
        return sum(tuple(face) in own for face in shown) >= _SAME * len(shown)


@dataclass(frozen=True, eq=False)
class DatasetSequence:
    """One person in one recording: cameras, and the truth, which is for scoring only.

    Attributes:
        dataset: name of the data set.
        name: of the sequence in it.
        folder: where its files are.
        frames: numbers of the frames with truth, as the video counts them from 0, (F,).
        rate: frames a second.
        rate_known: whether the data set has this one; False where it is guessed.
        joints3d: landmarks in the world, (F, 16, 3), metres, NaN where unknown; or None.
        rig: C calibrated views, of the same F frames where they move.
        pixels: landmarks annotated in the images, (F, C, 16, 2), NaN where unknown; or None.
        scored: frames that the protocol counts, (F,); None for all.
        action: what the person does, where the data set tells.
        videos: what a capture would be given, one a view, as far as the files are there.
        masks: files of true silhouettes in the first view, one a frame; or none.
        meshes: files of true surfaces, one a frame, each with a topology of its own; or none.
        read_mesh: reads such a file: vertices (V, 3), metres, world, and triangles (T, 3).
        surface: reads the true surface on the actor's template, where there is one.
        others: landmarks of the other people of the recording, by what each is called, (F, 16, 3).
        warnings: what a user should know.
    """

    dataset: str
    name: str
    folder: Path
    frames: Tensor
    rate: float
    joints3d: Tensor | None = None
    rig: CameraRig | None = None
    pixels: Tensor | None = None
    scored: Tensor | None = None
    action: str = ""
    videos: tuple[Path, ...] = ()
    masks: tuple[Path, ...] = ()
    meshes: tuple[Path, ...] = ()
    read_mesh: Callable[[Path], Mesh] | None = field(default=None, repr=False)
    surface: Callable[[], SurfaceTruth] | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()
    rate_known: bool = True
    others: Mapping[str, Tensor] = field(default_factory=dict)

    def joints2d(self) -> Tensor | None:
        """True landmarks in the images, (F, C, 16, 2): the annotated ones, or else projected."""
        if self.pixels is not None or self.joints3d is None or self.rig is None:
            return self.pixels
        known = self.joints3d.isfinite().all(-1)
        projected = self.rig.cameras.project(self.joints3d.nan_to_num())
        return torch.where(known[:, None, :, None], projected, torch.nan)

    def mesh(self, row: int) -> Mesh:
        """The true surface of a row, of a topology of its own.

        Raises:
            InputError: there is none, or its file is none.
        """
        if self.read_mesh is None or not self.meshes:
            raise InputError(f"{self.folder}: {self.name} has no surfaces of their own topology")
        return self.read_mesh(self.meshes[row])

    def counted(self, protocol: Protocol) -> Tensor:
        """Which frames a protocol scores, (F,)."""
        scored = torch.ones(len(self.frames), dtype=torch.bool)
        scored = scored if self.scored is None else self.scored.clone()
        return scored & (self.frames % protocol.step == 0)


@dataclass(frozen=True)
class Dataset:
    """A data set: what it is called, how it is scored, and how its files are read.

    Attributes:
        name: what the command line calls it.
        title: what people call it.
        layout: the files it is read from, in a line.
        protocol: how results are scored.
        list_names: names of the sequences in a folder.
        read_sequence: one of them, by name.
        list_people: names of everybody in one of them, where several people may be in it; or none.
    """

    name: str
    title: str
    layout: str
    protocol: Protocol
    list_names: Callable[[Path], tuple[str, ...]] = field(repr=False)
    read_sequence: Callable[[Path, str], DatasetSequence] = field(repr=False)
    list_people: Callable[[Path, str], tuple[str, ...]] | None = field(default=None, repr=False)

    def sequences(self, folder: str | Path) -> tuple[str, ...]:
        """Names of the sequences in a folder.

        Raises:
            InputError: it is not in the layout.
        """
        return self.list_names(Path(folder))

    def people(self, folder: str | Path, name: str) -> tuple[str, ...]:
        """Names of everybody in a sequence, each for ``read``; its own where it is of one person.

        Raises:
            InputError: there is none of that name, or its files cannot be used.
        """
        self._check(folder, name)
        return (name,) if self.list_people is None else self.list_people(Path(folder), name)

    def read(self, folder: str | Path, name: str) -> DatasetSequence:
        """One sequence.

        Raises:
            InputError: there is none of that name, or its files cannot be used.
        """
        self._check(folder, name)
        return self.read_sequence(Path(folder), name)

    def _check(self, folder: str | Path, name: str) -> None:
        """Refuse what leads out of the folder."""
        if not name or any(part in ("", ".", "..") for part in name.split("/")):
            raise InputError(f"{folder}: {name!r:.60} is no name of a sequence of {self.title}")
