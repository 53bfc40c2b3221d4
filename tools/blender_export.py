"""FBX, Alembic or a .blend of an exported capture, by Blender.

No free library writes FBX or Alembic as well as Blender does. Run it in Blender (tested with 5.0)
or with a Python that has the package `bpy`::

    blender -b -P tools/blender_export.py -- dance/export/dance.glb dance.fbx
    blender -b -P tools/blender_export.py -- dance/export/dance.glb dance.abc

The input is the ``.glb`` of ``perfcap export --to glb``. FBX takes skin, bones, clip, morph targets
and texture; Alembic takes the vertices of every frame; a ``.blend`` takes all. The frame rate is
read from the file's animation.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
from pathlib import Path
from typing import Any

import bpy  # type: ignore[import-not-found]


def timing(path: Path) -> tuple[int, float]:
    """Number of frames, and frames a second, of the first animation of a GLB."""
    data = path.read_bytes()
    if data[:4] != b"glTF":
        raise SystemExit(f"{path}: is no .glb; make one with perfcap export --to glb")
    (size,) = struct.unpack_from("<I", data, 12)
    tree: dict[str, Any] = json.loads(data[20 : 20 + size])
    if not tree.get("animations"):
        return 1, 30.0
    times = tree["accessors"][tree["animations"][0]["samplers"][0]["input"]]
    frames, last = times["count"], times["max"][0]
    return frames, (frames - 1) / last if last else 30.0


def open_capture(path: Path) -> None:
    """Import into an empty scene that has the rate and length of the clip."""
    frames, rate = timing(path)
    ratio = round(rate) / rate
    # Blender places keys by time. Its rate is fps / fps_base, but the importer of some versions
    # takes the product, which shows where the last key lands.
    for base in (ratio, 1 / ratio):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = bpy.context.scene
        scene.render.fps, scene.render.fps_base = round(rate), base
        bpy.ops.import_scene.gltf(filepath=str(path.resolve()), disable_bone_shape=True)
        last = max((action.frame_range[1] for action in bpy.data.actions), default=frames - 1)
        if abs(last - (frames - 1)) < 0.01:
            break
    scene.render.fps_base = ratio
    scene.frame_start, scene.frame_end = 0, frames - 1
    scene.frame_set(0)


def save_fbx(path: Path) -> None:
    """Every frame is keyed as it is: nothing is simplified, no bones are added."""
    bpy.ops.export_scene.fbx(
        filepath=str(path),
        object_types={"ARMATURE", "MESH", "EMPTY"},
        add_leaf_bones=False,
        bake_anim_use_nla_strips=False,
        bake_anim_use_all_actions=False,
        bake_anim_simplify_factor=0.0,
        path_mode="COPY",
        embed_textures=True,
    )


def save_abc(path: Path) -> None:
    """The posed mesh of every frame, with texture coordinates and normals."""
    for item in bpy.data.objects:
        item.select_set(item.type == "MESH")
    scene = bpy.context.scene
    bpy.ops.wm.alembic_export(
        filepath=str(path),
        start=scene.frame_start,
        end=scene.frame_end,
        selected=True,
        flatten=True,
        as_background_job=False,
    )


def save_blend(path: Path) -> None:
    bpy.ops.file.pack_all()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


SAVERS = {".fbx": save_fbx, ".abc": save_abc, ".blend": save_blend}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("glb", type=Path)
    parser.add_argument("out", type=Path, help="ends in .fbx, .abc or .blend")
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else None
    options = parser.parse_args(arguments)
    save = SAVERS.get(options.out.suffix.lower())
    if save is None:
        parser.error(f"{options.out}: expected a name that ends in {', '.join(SAVERS)}")
    if not options.glb.is_file() or not options.out.resolve().parent.is_dir():
        parser.error(f"{options.glb} or the folder of {options.out} does not exist")
    open_capture(options.glb)
    save(options.out.resolve())


if __name__ == "__main__":
    main()
