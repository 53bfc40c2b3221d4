"""Skeleton motion as BVH."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from perfcap.io.bvh_read import bvh_motion
from perfcap.io.bvh_write import save_bvh
from perfcap.io.export.options import Options, unique_names, word
from perfcap.io.export.recording import Recording


def write_bvh(folder: Path, recording: Recording, options: Options) -> None:
    """The actor's own bones in motion; rest offsets are those of its rest pose."""
    motion = bvh_motion(recording.template, recording.bone_transforms, recording.rate)
    motion = replace(motion, names=unique_names(motion.names, word))
    save_bvh(folder / f"{recording.name}.bvh", motion, 1 / options.per_metre, options.order)
