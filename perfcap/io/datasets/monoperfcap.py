"""The MonoPerfCap benchmark (Xu et al. 2018): 13 sequences of people in one view.

``NAME/calib.txt`` (a Skeletool camera file), ``NAME/images/`` or ``NAME/frames/``, and where there
is truth, ``NAME/ground_truth/`` of ``*.off`` (a surface a frame) or ``*.png`` (silhouettes drawn by
hand). No joints are published. Lengths are taken to be millimetres, as in the camera files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.io.datasets.layout import check_name, matching, present, wrong_layout
from perfcap.io.datasets.off import read_off
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.io.datasets.skeletool import read_skeletool
from perfcap.metrics import Alignment

_TITLE = "the MonoPerfCap benchmark"
_LAYOUT = "NAME/calib.txt with NAME/images/ and, for some, NAME/ground_truth/*.off or *.png"
_RATE = 30.0
_SIZE = (1080, 1920)
_MILLIMETRE = 1e-3
_IMAGES = ("images", "frames")
_SEQUENCES = (
    *("Chenglei_studio", "Franzi_studio", "Helge_outdoor", "Nadia_outdoor", "Natalia_outdoor"),
    *("Oleks_outdoor", "Oleks_studio", "Pablo_outdoor", "Simeng_moving_cam", "Simeng_outdoor"),
    *("Simeng_studio", "Weipeng_outdoor", "Weipeng_studio"),
)


def list_monoperfcap(folder: Path) -> tuple[str, ...]:
    """Names of the sequences that are there."""
    found = [path.parent.name for path in matching(folder, "*/calib.txt")]
    if not found:
        raise wrong_layout(folder, _TITLE, "NAME/calib.txt", _LAYOUT)
    return tuple(found)


def read_monoperfcap(folder: Path, name: str) -> DatasetSequence:
    """One sequence; its truth is a file a frame, in the order of the names."""
    check_name(folder, _TITLE, name, list_monoperfcap(folder))
    place = folder / name
    meshes = matching(place, "ground_truth/*.off")
    masks = matching(place, "ground_truth/*.png")
    rig = read_skeletool(place / "calib.txt", _SIZE)
    frames = max(len(meshes), len(masks))
    notes = ["the truth is taken to start with the first image and to be in millimetres"]
    if not frames:
        notes = [f"{place}: has no ground_truth, so there is nothing to compare with"]
    return DatasetSequence(
        dataset="monoperfcap",
        name=name,
        folder=place,
        frames=torch.arange(frames),
        rate=_RATE,
        rig=rig.select([0]),
        videos=present([place / images for images in _IMAGES]),
        masks=tuple(masks),
        meshes=tuple(meshes),
        warnings=tuple(notes),
    )


def read_surface(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A true surface: vertices (V, 3), metres, and triangles (T, 3).

    Raises:
        InputError: it is no OFF mesh.
    """
    vertices, faces = read_off(path)
    return _MILLIMETRE * vertices, faces


MONOPERFCAP = Dataset(
    name="monoperfcap",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=(),
        alignments=(Alignment.TRANSLATION, Alignment.SIMILARITY),
        splits={"benchmark": _SEQUENCES},
        source="Xu et al. 2018, Sec. 6: surfaces after translation, silhouettes by overlap",
    ),
    list_names=list_monoperfcap,
    read_sequence=read_monoperfcap,
)
