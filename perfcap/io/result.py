"""A finished capture, read back from its folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.files import is_file, named_path, read_json
from perfcap.io.gltf_animation import read_bone_transforms
from perfcap.io.gltf_document import Document, open_document
from perfcap.io.gltf_read import read_template
from perfcap.io.result_folder import MOTION, PEOPLE, REPORT, SURFACE, is_between, own_file
from perfcap.io.surface_file import BLOCK, SurfaceFile, open_surface, read_identity
from perfcap.rates import FASTEST, SLOWEST

_AGAIN = "run perfcap capture again"
_MOST = 1e6  # mm of an expected error
_LANDMARKS = 16


@dataclass(frozen=True, eq=False)
class Result:
    """What a capture found, independent of the video and the cameras it came from.

    Attributes:
        folder: where it lies.
        template: the textured mesh on its skeleton, with the bone lengths that were captured.
        joints: the 16 landmarks in the world, (F, 16, 3) m.
        bone_transforms: rest-to-posed transforms of the template's bones, (F, B, 4, 4) m.
        frame_numbers: of the frames in the video, (F,).
        rate: frames a second.
        report: the content of ``run.json``.
        surface: the captured surface, when there is one beside the skeleton motion.
    """

    folder: Path
    template: Template
    joints: NDArray[np.float64]
    bone_transforms: NDArray[np.float64]
    frame_numbers: NDArray[np.int64]
    rate: float
    report: Mapping[str, Any]
    surface: SurfaceFile | None = None

    @property
    def frames(self) -> int:
        """F."""
        return len(self.frame_numbers)

    @property
    def level(self) -> bool:
        """Whether y is up in the world by agreement, as of a retargeted motion, lying or not."""
        return "retargeted_from" in self.report

    def vertices(self, span: slice) -> NDArray[np.float32]:
        """Vertices of a span of frames in the world, (f, V, 3) m: captured, or else skinned.

        Raises:
            InputError: the captured ones are damaged, or bones put them nowhere.
        """
        if self.surface is not None:
            return self.surface.read(span)
        matrices = torch.tensor(self.bone_transforms[span])
        posed = dual_quaternion_blend(
            torch.tensor(self.template.vertices),
            self._skin,
            matrices[..., :3, :3],
            matrices[..., :3, 3],
        )
        vertices: NDArray[np.float32] = posed.float().numpy()
        if not np.isfinite(vertices).all():
            raise InputError(f"{self.folder}: its bones put vertices nowhere; {_AGAIN}")
        return vertices

    @property
    def shown(self) -> ResultFrames:
        """The vertices as tensors, for drawing."""
        return ResultFrames(self)

    def blocks(self, size: int = BLOCK) -> Iterator[NDArray[np.float32]]:
        """Vertices of all frames in order, ``size`` frames at a time."""
        for start in range(0, self.frames, size):
            yield self.vertices(slice(start, start + size))

    @cached_property
    def _skin(self) -> SkinWeights:
        template = self.template
        return SkinWeights(torch.tensor(template.weights), torch.tensor(template.weight_bones))


@dataclass(frozen=True, eq=False)
class ResultFrames:
    """``frames[span]`` are the vertices of a span of frames, (f, V, 3) float32 m."""

    result: Result

    @property
    def frames(self) -> int:
        """F."""
        return self.result.frames

    def __getitem__(self, span: slice) -> Tensor:
        return torch.from_numpy(self.result.vertices(span))


def read_result(folder: str | Path) -> Result:
    """Read the folder of a capture; vertices stay in their file until they are asked for.

    Raises:
        InputError: it is no such folder, the capture was not finished, or files are missing,
            damaged, or do not belong together.
    """
    folder = named_path(folder, "folder", "the folder of a capture")
    if own_file(folder, PEOPLE) is not None:
        raise InputError(
            f"{folder}: holds several people; expected the folder of one, {folder / 'person1'}"
        )
    report = _read_report(folder)
    motion = _read_motion(_present(folder, MOTION))
    frames = len(motion["frames"])
    if report.get("frames", frames) != frames:
        raise InputError(
            f"{folder / 'motion.npz'}: has {frames} frames, run.json says {report['frames']!r:.20}"
            f"; {_AGAIN}"
        )
    document = open_document(_present(folder, "capture.glb"))
    surface = _open_surface(folder, report)
    _require_one_capture(
        folder,
        {
            REPORT: report.get("capture"),
            MOTION: read_identity(motion.get("capture")),
            "capture.glb": _capture_of(document),
            **({} if surface is None else {SURFACE: surface.capture}),
        },
    )
    template = read_template(document)
    return Result(
        folder=folder,
        template=template,
        joints=motion["joints3d"].astype(np.float64),
        bone_transforms=read_bone_transforms(document, template, frames),
        frame_numbers=motion["frames"].astype(np.int64),
        rate=float(motion["fps"].reshape(())),
        report=report,
        surface=surface and _fitting(surface, template, motion["frames"]),
    )


def retargeted_from(folder: Path) -> str | None:
    """The result whose motion was put on another actor here; None of a capture, or of no report."""
    if own_file(folder, REPORT) is None:
        return None
    source = _read_report(folder).get("retargeted_from")
    return None if source is None else str(source)


@dataclass(frozen=True, eq=False)
class Expectation:
    """What the report of a capture says of its own errors.

    Attributes:
        error: of joints after a similarity of each frame, (F,) mm; NaN in frames that it doubts.
        views: how many videos it was made of.
        cameras: the calibration, where it was one of a file that is still there.
    """

    error: NDArray[np.float64]
    views: int
    cameras: Path | None


def read_expectation(folder: Path) -> Expectation | None:
    """Errors that a capture expects of itself.

    None where its report says nothing of them, as of older versions, or there is none.
    """
    if own_file(folder, REPORT) is None:
        return None
    report = _read_report(folder)
    trust = read_archive(folder / MOTION, ("trust",), "the motion.npz of a capture").get("trust")
    quality, views = report.get("quality"), report.get("views")
    if not isinstance(quality, dict) or trust is None or trust.dtype.kind != "f":
        return None
    errors, threshold = quality.get("expected_error_mm"), quality.get("threshold")
    if not isinstance(errors, list) or not all(map(_is_error, errors)):
        return None
    if trust.shape != (len(errors),) or not isinstance(threshold, float):
        return None
    error = np.where(trust >= threshold, np.asarray(errors, dtype=float), np.nan)
    request = report.get("request")
    given = request.get("cameras") if isinstance(request, dict) else None
    places = [Path(given), folder / given] if isinstance(given, str) else []
    cameras = next((place for place in places if is_file(place)), None)
    return Expectation(error, len(views) if isinstance(views, list) else 1, cameras)


def _is_error(value: object) -> bool:
    """Whether something read is an error in millimetres."""
    return isinstance(value, int | float) and 0 <= value < _MOST


def identity_of(folder: Path) -> str | None:
    """Which capture the motion of a result is of; None where it says nothing."""
    motion = read_archive(folder / MOTION, ("capture",), "the motion.npz of a capture")
    return read_identity(motion.get("capture"))


def require_one_capture(folder: Path) -> None:
    """Refuse a folder whose motion, surface and report are of different captures.

    Raises:
        InputError: names them; or the folder of a capture that is just being put into place.
    """
    found: dict[str, object] = {}
    _require_in_place(folder)
    if own_file(folder, REPORT) is not None:
        found[REPORT] = _read_report(folder).get("capture")
    if own_file(folder, MOTION) is not None:
        found[MOTION] = identity_of(folder)
    if own_file(folder, SURFACE) is not None:
        found[SURFACE] = open_surface(folder / SURFACE).capture
    _require_one_capture(folder, found)


def _require_one_capture(folder: Path, found: Mapping[str, object]) -> None:
    told = {name: str(known) for name, known in found.items() if known is not None}
    if len(set(told.values())) > 1:  # files of older versions say nothing
        listing = ", ".join(f"{name} {known[:8]}" for name, known in told.items())
        raise InputError(
            f"{folder}: holds files of different captures ({listing}), expected those of one; "
            f"{_AGAIN}"
        )


def _capture_of(document: Document) -> object:
    asset = document.tree.get("asset")
    extras = asset.get("extras") if isinstance(asset, dict) else None
    return extras.get("capture") if isinstance(extras, dict) else None


def _require_in_place(folder: Path) -> None:
    if is_between(folder):
        raise InputError(
            f"{folder}: a capture was interrupted while it put its files into place; perfcap "
            "capture --resume with the options of that call finishes it"
        )


def _read_report(folder: Path) -> dict[str, Any]:
    """The report comes last when a capture is saved: without it nothing is whole."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected the --out of a capture")
    _require_in_place(folder)
    path = own_file(folder, REPORT)
    if path is None:
        raise InputError(
            f"{folder}: has no run.json, so it is not the folder of a finished capture; {_AGAIN}"
        )
    report = read_json(path, "the report of a capture")
    if not isinstance(report, dict):
        raise InputError(f"{path}: holds no report of a capture; {_AGAIN}")
    return report


def _read_motion(path: Path) -> dict[str, NDArray[Any]]:
    names = ("joints3d", "frames", "fps")
    motion = read_archive(path, (*names, "capture"), "the motion.npz of a capture")
    missing = [name for name in names if name not in motion]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; {_AGAIN}")
    joints, frames, rate = (motion[name] for name in names)
    if frames.ndim != 1 or frames.dtype.kind not in "iu" or not len(frames):
        raise InputError(f"{path}: frames is {frames.dtype} {frames.shape}; {_AGAIN}")
    if frames[0] < 0 or (np.diff(frames.astype(np.int64)) != 1).any():
        raise InputError(f"{path}: frames are not numbered one after the other; {_AGAIN}")
    shape = (len(frames), _LANDMARKS, 3)
    if joints.shape != shape or joints.dtype.kind != "f" or not np.isfinite(joints).all():
        raise InputError(
            f"{path}: joints3d is {joints.dtype} {joints.shape}, expected finite {shape}; {_AGAIN}"
        )
    plain = rate.size == 1 and rate.dtype.kind in "fiu"
    if not plain or not SLOWEST <= rate.reshape(()) < FASTEST:
        found = rate.reshape(()) if plain else f"{rate.dtype} {rate.shape}"
        raise InputError(f"{path}: fps is {found}, expected frames a second; {_AGAIN}")
    return motion


def _open_surface(folder: Path, report: Mapping[str, Any]) -> SurfaceFile | None:
    """The captured surface; None for results of the skeleton alone."""
    if not (folder / SURFACE).exists() and report.get("surface") is None:
        return None
    return open_surface(_present(folder, SURFACE))


def _fitting(surface: SurfaceFile, template: Template, frames: NDArray[Any]) -> SurfaceFile:
    shape = (len(frames), len(template.vertices), 3)
    same = surface.vertices.shape == shape and np.array_equal(surface.frames, frames)
    if not same or not np.array_equal(surface.faces, template.faces):
        raise InputError(
            f"{surface.path}: has vertices {surface.vertices.shape}, expected {shape} with the "
            f"faces of capture.glb and the frames of motion.npz; {_AGAIN}"
        )
    return surface


def _present(folder: Path, name: str) -> Path:
    """A file of the folder itself: what a link leads to is not the result's."""
    path = own_file(folder, name)
    if path is None:
        raise InputError(f"{folder}: lacks {name}; {_AGAIN}")
    return path
