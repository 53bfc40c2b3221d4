"""Compare an animated GLB, as Blender evaluates it, with expected vertices.

Runs in an environment of its own that has `bpy` (GPL, not a dependency of perfcap)::

    python tools/check_blender.py capture.glb expected.npz --fps 30 [--render frame.png --frame 5]

``expected.npz`` holds ``vertices`` (F, V, 3), metres, y up, in the vertex order of the file.
Prints the largest distance in millimetres; exit code 1 above ``--tolerance``.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import bpy  # type: ignore[import-not-found]
import mathutils  # type: ignore[import-not-found]
import numpy as np


def import_glb(path: Path, fps: float) -> bpy.types.Object:
    """Import into an empty scene; the frame rate must be set first, keys are placed by time."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(fps)
    bpy.context.scene.render.fps_base = round(fps) / fps
    bpy.ops.import_scene.gltf(filepath=str(path))
    skinned = [item for item in bpy.data.objects if item.find_armature()]
    if len(skinned) != 1:
        raise SystemExit(f"{path}: {len(skinned)} skinned meshes in Blender, expected 1")
    return skinned[0]


def posed_vertices(body: bpy.types.Object, frame: int) -> np.ndarray:
    """Evaluated vertices at a frame, turned from Blender's z up to y up, (V, 3) m."""
    bpy.context.scene.frame_set(frame)
    evaluated = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    local = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", local)
    matrix = np.array(evaluated.matrix_world)
    evaluated.to_mesh_clear()
    world = local.reshape(-1, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return world[:, [0, 2, 1]] * (1, 1, -1)


def render(body: bpy.types.Object, frame: int, path: Path) -> None:
    """A small Cycles picture from the front left, to look at."""
    points = posed_vertices(body, frame)
    middle = mathutils.Vector((points.mean(0) * (1, 1, -1))[[0, 2, 1]])
    scene = bpy.context.scene
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = middle + mathutils.Vector((1.5, -4.0, 0.6))
    camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (math.radians(50), 0, math.radians(20))
    for item in (camera, sun):
        scene.collection.objects.link(item)
    scene.camera, scene.world = camera, bpy.data.worlds.new("world")
    scene.render.engine, scene.cycles.samples = "CYCLES", 8
    scene.render.resolution_x, scene.render.resolution_y = 480, 640
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("glb", type=Path)
    parser.add_argument("expected", type=Path)
    parser.add_argument("--fps", type=float, required=True)
    parser.add_argument("--tolerance", type=float, default=0.1, help="mm")
    parser.add_argument("--render", type=Path)
    parser.add_argument("--frame", type=int, default=0)
    options = parser.parse_args()
    expected = np.load(options.expected, allow_pickle=False)["vertices"]
    body = import_glb(options.glb, options.fps)
    worst = 0.0
    for frame in np.unique(np.linspace(0, len(expected) - 1, 8).round().astype(int)).tolist():
        apart = np.linalg.norm(posed_vertices(body, frame) - expected[frame], axis=1)
        worst = max(worst, float(apart.max()))
    print(f"{options.glb}: largest distance {1000 * worst:.4f} mm")
    if options.render:
        render(body, options.frame, options.render.resolve())
    raise SystemExit(int(1000 * worst > options.tolerance))


if __name__ == "__main__":
    main()
