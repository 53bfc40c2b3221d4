"""Read the motion back out of a file that ``save_animation`` wrote."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.actor.template import Template
from perfcap.io.gltf_document import Document

Floats = NDArray[np.float64]

_TRACKS = {"translation": "VEC3", "rotation": "VEC4"}
_FOREIGN = "expected a capture.glb as perfcap writes it"


def read_bone_transforms(document: Document, template: Template, frames: int) -> Floats:
    """Rest-to-posed transforms of a template's bones in the world, (F, B, 4, 4) m.

    Args:
        document: a file with a key for every frame; other files are refused, not resampled.
        template: the one in the file.
        frames: F.

    Raises:
        InputError: another number of keys, or a file that something else wrote.
    """
    bones = len(template.bone_names)
    skins = document.items("skins")
    if len(skins) != 1 or skins[0].get("joints") != list(range(bones)):
        raise document.error(f"its bones are not its first {bones} nodes; {_FOREIGN}")
    local = np.tile(_rest_to_parent(template), (frames, 1, 1, 1))
    scale = np.cbrt(np.linalg.det(local[0, :, :3, :3]))
    for bone, path, values in _tracks(document, bones, frames):
        if path == "translation":
            local[:, bone, :3, 3] = values
        else:
            local[:, bone, :3, :3] = scale[bone] * Rotation.from_quat(values).as_matrix()
    posed = np.empty_like(local)
    frame = np.eye(4) if template.space is None else template.space.frame
    for bone, parent in enumerate(template.bone_parents):
        posed[:, bone] = (frame if parent < 0 else posed[:, parent]) @ local[:, bone]
    transforms: Floats = posed @ np.linalg.inv(template.bone_frames())
    return transforms


def _rest_to_parent(template: Template) -> Floats:
    """Bone-to-parent rest transforms in the file's units, (B, 4, 4)."""
    rest = template.bone_frames()
    frame = np.eye(4) if template.space is None else template.space.frame
    is_root = (template.bone_parents < 0)[:, None, None]
    local: Floats = np.linalg.inv(np.where(is_root, frame, rest[template.bone_parents])) @ rest
    return local


def _tracks(document: Document, bones: int, frames: int) -> Iterator[tuple[int, str, Floats]]:
    """Bone, what moves of it, and its values at the frames."""
    animations = document.items("animations")
    if len(animations) > 1:
        raise document.error(f"holds {len(animations)} animations; {_FOREIGN}")
    for animation in animations:
        samplers = _list(document, animation.get("samplers"))
        for channel in _list(document, animation.get("channels")):
            target = channel.get("target")
            path = target.get("path") if isinstance(target, dict) else None
            if not isinstance(target, dict) or not isinstance(path, str) or path not in _TRACKS:
                continue  # weights of morph targets: the surface has a file of its own
            bone = document.integer(target.get("node"), "target.node", 0, bones - 1)
            number = document.integer(channel.get("sampler"), "sampler", 0, len(samplers) - 1)
            values = document.accessor(samplers[number].get("output"), _TRACKS[path])
            if len(values) != frames:
                raise document.error(
                    f"moves for {len(values)} frames, expected {frames}; it belongs to another "
                    "capture, or was not finished: capture again"
                )
            good = np.isfinite(values).all() and (path != "rotation" or values.any(1).all())
            if not good:
                raise document.error("holds a motion that is not finite; capture again")
            yield bone, path, values.astype(np.float64)


def _list(document: Document, value: Any) -> list[dict[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise document.error("damaged file, an animation has no channels or samplers")
    return value
