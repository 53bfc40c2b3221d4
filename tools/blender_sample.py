"""What Blender sees in a file: vertices and bones at some frames, and a picture.

Runs in an environment of its own that has `bpy` (GPL, not a dependency of perfcap), or in Blender::

    python tools/blender_sample.py dance.glb seen.npz --fps 30 --frames 0 5 9 --render seen.png
    blender -b -P tools/blender_sample.py -- dance.bvh seen.npz --fps 30 --frames 0 5 9

Reads ``.glb``, ``.bvh`` (in metres per unit of ``--unit``), ``.usdc``, ``.usdz``, ``.fbx``,
``.abc``, ``.obj`` and ``.ply``. ``--onto RIG.glb`` moves the character of another file by the bones
of this one, matched by name. ``seen.npz`` holds what there is of ``vertices`` (F, V, 3) of the
largest mesh, ``bone_names`` (B,), ``bone_places`` (F, B, 3), and ``bone_turns`` (F, B, 3, 3) from
the rest pose: metres, y up.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import bpy  # type: ignore[import-not-found]
import mathutils  # type: ignore[import-not-found]
import numpy as np

Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # from Blender's z up
Thing = Any


def open_file(path: Path, fps: float, unit: float) -> list[Thing]:
    """Import a file; returns what it brought. The frame rate must be set first."""
    render = bpy.context.scene.render
    # Blender 5.0 takes fps times fps_base for the rate when it reads glTF, elsewhere their ratio
    ratio = round(fps) / fps
    render.fps, render.fps_base = round(fps), 1 / ratio if path.suffix == ".glb" else ratio
    before = set(bpy.data.objects)
    name, kind = str(path), path.suffix.lower()
    if kind == ".glb":
        bpy.ops.import_scene.gltf(filepath=name, disable_bone_shape=True)
    elif kind == ".bvh":
        bpy.ops.import_anim.bvh(filepath=name, global_scale=unit, frame_start=1)
    elif kind in (".usdc", ".usdz", ".usda"):
        bpy.ops.wm.usd_import(filepath=name, set_frame_range=False)
    elif kind == ".fbx":
        bpy.ops.import_scene.fbx(filepath=name, anim_offset=0.0)
    elif kind == ".abc":
        bpy.ops.wm.alembic_import(filepath=name, set_frame_range=False)
    elif kind == ".obj":
        bpy.ops.wm.obj_import(filepath=name)
    elif kind == ".ply":
        bpy.ops.wm.ply_import(filepath=name, forward_axis="NEGATIVE_Z", up_axis="Y")
    else:
        raise SystemExit(f"{path}: is of no kind that is read here")
    render.fps_base = ratio
    return [item for item in bpy.data.objects if item not in before]


def largest_mesh(items: list[Thing]) -> Thing | None:
    meshes = [item for item in items if item.type == "MESH"]
    return max(meshes, key=lambda item: len(item.data.vertices), default=None)


def skeleton(items: list[Thing]) -> Thing | None:
    return next((item for item in items if item.type == "ARMATURE"), None)


def posed_vertices(body: Thing) -> np.ndarray:
    """Evaluated vertices of the current frame, (V, 3) m, z up."""
    evaluated = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    local = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", local)
    matrix = np.array(evaluated.matrix_world)
    evaluated.to_mesh_clear()
    return local.reshape(-1, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def bone_motion(armature: Thing) -> np.ndarray:
    """Rest-to-posed transforms of the bones in the world at the current frame, (B, 4, 4), z up."""
    world = np.array(armature.matrix_world)
    pose = np.stack([world @ np.array(bone.matrix) for bone in armature.pose.bones])
    rest = np.stack([world @ np.array(bone.bone.matrix_local) for bone in armature.pose.bones])
    return pose @ np.linalg.inv(rest)


def bone_places(armature: Thing) -> np.ndarray:
    """Origins of the bones at the current frame, (B, 3) m, z up."""
    world = np.array(armature.matrix_world)
    heads = np.array([bone.head for bone in armature.pose.bones])
    return heads @ world[:3, :3].T + world[:3, 3]


def drive(rig: Thing, source: Thing) -> None:
    """Give the bones of a rig the turns that bones of the same names have, and roots their places.

    That is what retargeting does with a rig of the same proportions: turns are from the rest pose
    in the axes of the world, and places of all other bones follow.
    """
    names = [plain(bone.name) for bone in source.pose.bones]
    turns = dict(zip(names, bone_motion(source)[:, :3, :3], strict=True))
    places = dict(zip(names, bone_places(source), strict=True))
    world = np.array(rig.matrix_world)
    inverse, turned = np.linalg.inv(world), world[:3, :3] / np.cbrt(np.linalg.det(world[:3, :3]))
    posed: dict[str, np.ndarray] = {}
    for bone in rig.pose.bones:  # parents come first
        rest = np.array(bone.bone.matrix_local)
        before = rest
        if bone.parent is not None:
            parent_rest = np.array(bone.parent.bone.matrix_local)
            before = posed[bone.parent.name] @ np.linalg.inv(parent_rest) @ rest
        wanted, name = before.copy(), plain(bone.name)
        if name in turns:
            wanted[:3, :3] = turned.T @ turns[name] @ turned @ rest[:3, :3]
        if name in places and bone.parent is None:
            wanted[:3, 3] = inverse[:3, :3] @ places[name] + inverse[:3, 3]
        bone.matrix_basis = mathutils.Matrix(np.linalg.inv(before) @ wanted)
        posed[bone.name] = wanted
    bpy.context.view_layer.update()


def plain(name: str) -> str:
    return "_".join(name.split())


def render(path: Path, points: np.ndarray, bones: Thing | None) -> None:
    """A small Cycles picture from the front left of (V, 3) points; bones become sticks."""
    low, high = points.min(0), points.max(0)
    middle, size = mathutils.Vector(0.5 * (low + high)), high - low
    scene = bpy.context.scene
    if bones is not None:
        _sticks(bones)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    away = float(max(1.6 * size[2], 2.1 * np.hypot(size[0], size[1])))  # what the lens takes in
    camera.location = middle + away * mathutils.Vector((0.35, -0.92, 0.18))
    camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.7, 0, 0.5)
    for item in (camera, sun):
        scene.collection.objects.link(item)
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.55, 0.6, 1.0)
    scene.camera, scene.world = camera, world
    scene.view_settings.view_transform = "Standard"
    scene.render.engine, scene.cycles.samples = "CYCLES", 16
    scene.render.resolution_x, scene.render.resolution_y = 300, 400
    scene.render.resolution_percentage = 100
    scene.render.filepath = str(path.resolve())
    bpy.ops.render.render(write_still=True)


def _sticks(armature: Thing) -> None:
    """Cones from the origin of each bone's parent to its own."""
    world = armature.matrix_world
    for bone in armature.pose.bones:
        if bone.parent is None:
            continue
        head, tail = world @ bone.parent.head, world @ bone.head
        along = tail - head
        bpy.ops.mesh.primitive_cone_add(
            radius1=0.03, radius2=0.012, depth=along.length, location=head + 0.5 * along
        )
        bpy.context.object.rotation_euler = along.to_track_quat("Z", "Y").to_euler()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--fps", type=float, required=True)
    parser.add_argument("--frames", type=int, nargs="+", default=[0])
    parser.add_argument("--unit", type=float, default=0.01, help="metres in a unit of a BVH file")
    parser.add_argument("--onto", type=Path)
    parser.add_argument("--render", type=Path, help="of the last of the frames")
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else None
    options = parser.parse_args(arguments)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    source = open_file(options.file, options.fps, options.unit)
    items = source if options.onto is None else open_file(options.onto, options.fps, 1.0)
    body, bones, driver = largest_mesh(items), skeleton(items), skeleton(source)
    if options.onto is not None:
        bones.animation_data_clear()
    seen: dict[str, list[np.ndarray]] = {"vertices": [], "bone_places": [], "bone_turns": []}
    first = 1 if options.file.suffix.lower() == ".bvh" else 0  # where Blender puts frame 0
    for frame in options.frames:
        bpy.context.scene.frame_set(first + frame)
        if options.onto is not None:
            drive(bones, driver)
        if body is not None:
            seen["vertices"].append(posed_vertices(body) @ Y_UP.T)
        if bones is not None:
            seen["bone_places"].append(bone_places(bones) @ Y_UP.T)
            seen["bone_turns"].append(Y_UP @ bone_motion(bones)[:, :3, :3] @ Y_UP.T)
    arrays = {name: np.array(values) for name, values in seen.items() if values}
    if bones is not None:
        arrays["bone_names"] = np.array([bone.name for bone in bones.pose.bones])
    np.savez(options.out, **arrays)
    if options.render:
        places = arrays.get("vertices", arrays.get("bone_places"))
        render(options.render, places[-1] @ Y_UP, bones if body is None else None)


if __name__ == "__main__":
    main()
