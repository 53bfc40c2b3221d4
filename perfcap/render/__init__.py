"""Meshes to pixels."""

from perfcap.geometry.camera import look_at
from perfcap.render.density import Splats, background
from perfcap.render.label_map import Cull, LabelMap, rasterize
from perfcap.render.lighting import DAYLIGHT, FLAT, Lighting
from perfcap.render.occluding_contour import MeshEdges, ModelContour
from perfcap.render.overlay import OverlayStyle, draw_caption, draw_overlay
from perfcap.render.projected_mesh import ProjectedMesh, vertex_normals
from perfcap.render.shading import Rendering, render, shade
from perfcap.render.shadow import Visibility, shade_ground, visibility
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.render.texture import Texture

__all__ = [
    "DAYLIGHT",
    "FLAT",
    "Cull",
    "LabelMap",
    "Lighting",
    "MeshEdges",
    "ModelContour",
    "OverlayStyle",
    "ProjectedMesh",
    "Rendering",
    "SoftSilhouette",
    "Splats",
    "Texture",
    "Visibility",
    "background",
    "draw_caption",
    "draw_overlay",
    "look_at",
    "rasterize",
    "render",
    "shade",
    "shade_ground",
    "vertex_normals",
    "visibility",
]
