"""Characters in motion: BVH of the bones, GLB with skin, the surface of long clips in pieces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from perfcap.io.bvh_read import bvh_motion
from perfcap.io.bvh_write import save_bvh
from perfcap.io.export.options import Options, unique_names, word
from perfcap.io.export.recording import Recording
from perfcap.io.gltf_morph import MAX_TARGET_BYTES, MAX_TARGETS, fits
from perfcap.io.gltf_write import save_animation


def write_bvh(folder: Path, recording: Recording, options: Options) -> None:
    """The actor's own bones in motion; rest offsets are those of its rest pose."""
    motion = bvh_motion(recording.template, recording.bone_transforms, recording.rate)
    motion = replace(motion, names=unique_names(motion.names, word))
    save_bvh(folder / f"{recording.name}.bvh", motion, 1 / options.per_metre, options.order)


def write_glb(folder: Path, recording: Recording, options: Options) -> None:
    """Skin and clip on the actor's own bones, and the captured surface as morph targets.

    Where one file with a target for every frame would be one that viewers refuse, the whole clip
    goes into a file without, and the surface into further ones of as many frames as they take.
    """
    surface = options.surface and recording.result.surface is not None
    whole = surface and fits(recording.frames, len(recording.template.vertices))
    _save(folder / f"{recording.name}.glb", recording, whole)
    if surface and not whole:
        bytes_each = 12 * len(recording.template.vertices)
        most = min(MAX_TARGETS, MAX_TARGET_BYTES // bytes_each)
        for part in recording.pieces(most):
            _save(folder / f"{part.surface_name}.glb", part, True)


def _save(path: Path, recording: Recording, surface: bool) -> None:
    blocks = recording.blocks() if surface else None
    template, transforms = recording.template, recording.bone_transforms
    save_animation(path, template, transforms, recording.rate, blocks)
