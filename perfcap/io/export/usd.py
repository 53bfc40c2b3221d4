"""Universal Scene Description: the skinned character, and its surface as time samples.

Two files, because a mesh that is skinned and has points of every frame would be moved twice.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from perfcap.errors import InputError
from perfcap.io.export.meshes import write_texture
from perfcap.io.export.options import Options
from perfcap.io.export.recording import Recording
from perfcap.io.export.usd_parts import Scene, add_mesh, add_skeleton, add_surface


def write_usd(folder: Path, recording: Recording, options: Options) -> None:
    """``NAME.usdc`` and, with a surface, ``NAME_surface.usdc``, with the texture beside them."""
    texture = write_texture(folder, recording.template, f"{recording.name}_texture")
    for name, surface in _files(recording, options):
        _save(folder / f"{name}.usdc", recording, options, texture, surface)


def write_usdz(folder: Path, recording: Recording, options: Options) -> None:
    """The same as packages of one file each, the texture inside."""
    from pxr import Sdf, Tf, UsdUtils

    for name, surface in _files(recording, options):
        inside = folder / f".{name}"  # a name of its own: the package takes names from here
        inside.mkdir()
        texture = write_texture(inside, recording.template)
        layer = inside / "character.usdc"
        _save(layer, recording, options, texture, surface)
        target = folder / f"{name}.usdz"
        try:
            done = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(target))
        except Tf.ErrorException as error:
            raise _unwritable(target) from error
        if not done:
            raise _unwritable(target)
        for entry in inside.iterdir():
            entry.unlink()
        inside.rmdir()


def _files(recording: Recording, options: Options) -> list[tuple[str, bool]]:
    """Name of each file, and whether it holds the surface rather than the skinned mesh."""
    whole = options.surface and recording.result.surface is not None
    skinned = [(recording.name, False)]
    return [*skinned, (f"{recording.name}_surface", True)] if whole else skinned


def _save(
    path: Path, recording: Recording, options: Options, texture: str | None, surface: bool
) -> None:
    from pxr import Tf, Usd

    try:
        stage = Usd.Stage.CreateNew(str(path))
        scene = Scene.begin(stage, recording, options)
        mesh = add_mesh(scene, texture)
        if surface:
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
