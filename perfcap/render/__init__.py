"""Meshes to pixels."""

from perfcap.render.label_map import Cull, LabelMap, rasterize
from perfcap.render.viewpoint import look_at

__all__ = ["Cull", "LabelMap", "look_at", "rasterize"]
