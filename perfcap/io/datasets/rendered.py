"""The rendered sequences: a clothed actor in one view, or one or two people in several.

``NAME/`` holds ``camera.json`` and ``gt.npz`` (one view), or ``cameras.json`` and
``person1/gt.npz``, ``person2/gt.npz`` (several views; sequences are then ``NAME/1``, ``NAME/2``).
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.datasets.layout import (
    MAX_OTHERS,
    array_of,
    at_frames,
    check_name,
    matching,
    measured,
    named_below,
    present,
    wrong_layout,
)
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol, SurfaceTruth
from perfcap.io.files import read_json
from perfcap.metrics import Alignment
from perfcap.rates import FASTEST, SLOWEST

_TITLE = "the rendered sequences"
_LAYOUT = "NAME/camera.json with NAME/gt.npz, or NAME/cameras.json with NAME/person1/gt.npz"
_TRUTH = "the truth of a rendered sequence"
_TEMPLATE = "the template of a rendered sequence"
_FARTHEST = 1e6  # m
_LOOSE = ("skirt", "coat")


def list_rendered(folder: Path) -> tuple[str, ...]:
    """Names of the sequences, people as ``NAME/1``."""
    single = [path.parent.name for path in matching(folder, "*/camera.json")]
    people = [
        f"{path.parent.parent.name}/{path.parent.name.removeprefix('person')}"
        for path in matching(folder, "*/person*/gt.npz")
    ]
    if not single and not people:
        raise wrong_layout(folder, _TITLE, "NAME/camera.json or NAME/cameras.json", _LAYOUT)
    return (*single, *people)


def read_rendered(folder: Path, name: str) -> DatasetSequence:
    """One person of a sequence."""
    check_name(folder, _TITLE, name, list_rendered(folder))
    base, _, person = name.partition("/")
    if person:
        return _several_views(folder / base, folder / base / f"person{person}", name)
    return _one_view(folder / base, name)


def _people(folder: Path, name: str) -> tuple[str, ...]:
    """Everybody in a sequence, by number."""
    return named_below(name, list_rendered(folder))


def _one_view(folder: Path, name: str) -> DatasetSequence:
    rig, rate = _cameras(folder / "camera.json")
    truth = _truth(folder / "gt.npz", ("joints3d", "joints2d"))
    joints3d = array_of(f"{folder / 'gt.npz'}: joints3d", truth.get("joints3d"), (None, 16, 3))
    frames = len(joints3d)
    where = f"{folder / 'gt.npz'}: joints2d"
    pixels = array_of(where, truth.get("joints2d"), (frames, 16, 2)) + rig.pixel_offset
    masks = matching(folder, "masks/*.png")
    if masks and len(masks) != frames:
        raise InputError(f"{folder / 'masks'}: has {len(masks)} masks for {frames} frames")
    return DatasetSequence(
        dataset="rendered",
        name=name,
        folder=folder,
        frames=torch.arange(frames),
        rate=rate,
        joints3d=measured(joints3d),
        rig=rig,
        pixels=measured(pixels)[:, None],
        videos=present([folder / "video.mp4"]),
        masks=tuple(masks),
        surface=partial(_read_surface, folder, packed=False),
    )


def _several_views(folder: Path, person: Path, name: str) -> DatasetSequence:
    rig, rate = _cameras(folder / "cameras.json")
    truth = _truth(person / "gt.npz", ("joints3d", "joints2d"))
    joints3d = array_of(f"{person / 'gt.npz'}: joints3d", truth.get("joints3d"), (None, 16, 3))
    shape = (len(joints3d), len(rig.names), 16, 2)
    where = f"{person / 'gt.npz'}: joints2d"
    pixels = array_of(where, truth.get("joints2d"), shape) + rig.pixel_offset
    return DatasetSequence(
        dataset="rendered",
        name=name,
        folder=person,
        frames=torch.arange(len(joints3d)),
        rate=rate,
        joints3d=measured(joints3d),
        rig=rig,
        pixels=measured(pixels),
        videos=present([folder / "views" / f"{view}.mp4" for view in rig.names]),
        surface=partial(_read_surface, person, packed=True),
        others=_others(folder, person, len(joints3d)),
    )


def _others(folder: Path, person: Path, frames: int) -> dict[str, Tensor]:
    """Landmarks (F, 16, 3) of the other people of a sequence, by name."""
    found: dict[str, Tensor] = {}
    for path in matching(folder, "person*/gt.npz"):
        if path.parent == person or len(found) == MAX_OTHERS:
            continue
        with suppress(InputError):  # a damaged file of another person is no fault of this one
            joints = _truth(path, ("joints3d",)).get("joints3d")
            points = measured(array_of(str(path), joints, (None, 16, 3)))
            name = f"{folder.name}/{path.parent.name.removeprefix('person')}"
            if len(points):
                found[name] = at_frames(points, range(len(points)), range(frames))
    return found


def _cameras(path: Path) -> tuple[CameraRig, float]:
    rig = read_cameras(path)
    rate = rig.fps
    if rate is None:
        values = read_json(path, "a camera file")
        rate = values.get("fps") if isinstance(values, dict) else None
    if not isinstance(rate, int | float) or not SLOWEST <= rate < FASTEST:
        raise InputError(f"{path}: fps is {rate!r:.20}, expected frames a second")
    return rig, float(rate)


def _truth(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[np.generic]]:
    return dict(read_archive(path, names, _TRUTH))


def _read_surface(folder: Path, packed: bool) -> SurfaceTruth:
    """The true surface; of several views it is packed as differences of whole numbers."""
    path = folder / "gt.npz"
    truth = _truth(path, ("vertices", "vertices_delta", "vertices_scale"))
    if packed:
        steps = array_of(f"{path}: vertices_delta", truth.get("vertices_delta"), (None, 3, None))
        scale = float(array_of(f"{path}: vertices_scale", truth.get("vertices_scale"), ()))
        vertices = steps.cumsum(0).transpose(0, 2, 1) * scale
    else:
        vertices = array_of(f"{path}: vertices", truth.get("vertices"), (None, None, 3))
    if not (np.abs(vertices) < _FARTHEST).all():
        raise InputError(f"{path}: vertices are not all numbers of metres; expected a true surface")
    return _on_template(folder / "template.npz", vertices)


def _on_template(path: Path, vertices: NDArray[np.float64]) -> SurfaceTruth:
    names = ("faces", "part", "part_names", "glb_vertex_map")
    template = read_archive(path, names, _TEMPLATE)
    count = vertices.shape[1]
    missing = [name for name in names if name not in template]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; expected {_TEMPLATE}")
    faces = array_of(f"{path}: faces", template["faces"], (None, 3), "iu").astype(np.int64)
    part = array_of(f"{path}: part", template["part"], (count,), "iu")
    places = array_of(f"{path}: glb_vertex_map", template["glb_vertex_map"], (None,), "iu")
    for what, indices in (("faces", faces), ("glb_vertex_map", places)):
        if not ((indices >= 0) & (indices < count)).all():
            raise InputError(f"{path}: {what} name vertices that are not among the {count}")
    if template["part_names"].ndim != 1:
        raise InputError(f"{path}: part_names has no axis, expected one name a part")
    loose = [i for i, title in enumerate(template["part_names"]) if str(title) in _LOOSE]
    return SurfaceTruth(vertices, faces, places.astype(np.int64), np.isin(part, loose))


RENDERED = Dataset(
    name="rendered",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=LANDMARKS,
        alignments=tuple(Alignment),
        splits={"development": ("dev_tight", "dev_skirt", "dev_views", "dev_duo")},
        source="made for perfcap: exact skeletons, silhouettes and cloth",
    ),
    list_names=list_rendered,
    read_sequence=read_rendered,
    list_people=_people,
)
