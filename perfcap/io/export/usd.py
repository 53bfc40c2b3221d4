"""Universal Scene Description: the skinned character, and its surface as time samples.

Two files, because a mesh that is skinned and has points of every frame would be moved twice.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from perfcap.errors import InputError
from perfcap.io.export.meshes import write_texture
from perfcap.io.export.options import Options
from perfcap.io.export.recording import Recording
from perfcap.io.export.usd_parts import Scene, add_mesh, add_skeleton, add_surface

_MOST_BYTES = 256 << 20  # of points and normals in one file, which are in memory until it is saved


@dataclass(frozen=True, eq=False)
class _Content:
    """What goes into one file, and the time code that it begins with."""

    name: str
    recording: Recording
    start: int = 0
    surface: bool = False


def write_usd(folder: Path, recording: Recording, options: Options) -> None:
    """``NAME.usdc`` and, with a surface, ``NAME_surface.usdc``, with the texture beside them.

    The surface of a long clip comes in several files, which go on where the one before ends.
    """
    texture = write_texture(folder, recording.template, f"{recording.name}_texture")
    for content in _contents(recording, options):
        _save(folder / f"{content.name}.usdc", content, options, texture)


def write_usdz(folder: Path, recording: Recording, options: Options) -> None:
    """The same as packages of one file each, the texture inside."""
    from pxr import Sdf, Tf, UsdUtils

    inside = folder / ".package"
    inside.mkdir()
    texture = write_texture(inside, recording.template)
    layer = inside / "character.usdc"  # what it is called in the package
    for content in _contents(recording, options):
        _save(layer, content, options, texture)
        target = folder / f"{content.name}.usdz"
        try:
            done = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(target))
        except Tf.ErrorException as error:
            raise _unwritable(target) from error
        if not done:
            raise _unwritable(target)
        layer.unlink()
    shutil.rmtree(inside)


def _contents(recording: Recording, options: Options) -> Iterator[_Content]:
    """Of each file."""
    yield _Content(recording.name, recording)
    if not options.surface or recording.result.surface is None:
        return
    most = _MOST_BYTES // (24 * len(recording.template.vertices))
    if recording.frames <= most:
        yield _Content(f"{recording.name}_surface", recording, surface=True)
        return
    for part in recording.pieces(most):
        yield _Content(part.surface_name, part, part.first - recording.first, True)


def _save(path: Path, content: _Content, options: Options, texture: str | None) -> None:
    from pxr import Tf, Usd

    try:
        stage = Usd.Stage.CreateNew(str(path))
        scene = Scene.begin(stage, content.recording, options, content.start)
        mesh = add_mesh(scene, texture)
        if content.surface:
            add_surface(scene, mesh)
        else:
            add_skeleton(scene, mesh)
        stage.GetRootLayer().Save()
        del stage, scene, mesh  # the file is complete when nobody holds its layer
        _check(path)
    except Tf.ErrorException as error:
        raise _unwritable(path) from error


def _check(path: Path) -> None:
    """Open what was written: a full disk shows late."""
    from pxr import Usd

    found: Any = Usd.Stage.Open(str(path))
    if not found or not found.GetDefaultPrim() or not np.isfinite(found.GetEndTimeCode()):
        raise _unwritable(path)


def _unwritable(path: Path) -> InputError:
    return InputError(f"{path}: cannot be written; free space or choose another folder")
