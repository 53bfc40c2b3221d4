"""Skeletal motion as BVH: `load_bvh`, `save_bvh`, and the value between them."""

from perfcap.io.bvh_read import BvhMotion, bvh_motion, joint_positions, load_bvh
from perfcap.io.bvh_write import save_bvh

__all__ = ["BvhMotion", "bvh_motion", "joint_positions", "load_bvh", "save_bvh"]
