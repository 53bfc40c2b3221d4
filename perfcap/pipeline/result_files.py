"""The files of a finished capture."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from torch import Tensor

from perfcap.geometry.rotation import turn_to_y
from perfcap.io.atomic import writing
from perfcap.io.bvh_read import bvh_motion
from perfcap.io.bvh_write import save_bvh
from perfcap.io.gltf_write import save_animation
from perfcap.io.mask_files import save_masks
from perfcap.io.result_folder import MASKS, MOTION, REPORT, SURFACE, VOLUME
from perfcap.io.surface_file import save_surface
from perfcap.io.volume_file import save_volume
from perfcap.pipeline.surface import surface_blocks

if TYPE_CHECKING:
    from perfcap.pipeline.performance import Performance


def write_result(
    performance: Performance,
    folder: Path,
    first_frame: int = 0,
    run: Mapping[str, Any] | None = None,
    view_names: Sequence[str] | None = None,
    up: Tensor | None = None,
    view_frames: Sequence[Sequence[int]] | None = None,
) -> None:
    """Write motion.npz, motion.bvh, capture.glb, config.yaml and, last, run.json into a folder.

    With a captured surface also surface.npz, masks/ and the surface in capture.glb; with a volume
    volume.npz. Files that are read back carry the same identity. What other programs open,
    motion.bvh and capture.glb, is turned to a world with y up.

    Args:
        performance: what was captured.
        folder: exists, and holds no older result.
        first_frame: number of the motion's first frame in the video.
        run: what the caller knows about the run, added to run.json.
        view_names: of the views, for folders of masks where there are several.
        up: of the world, (3,); the performance's own if None.
        view_frames: numbers of the frames in the video of each view, C of F, for masks, where a
            view is late; below 0 where it has none.

    Raises:
        InputError: the folder cannot be written.
    """
    settings = yaml.safe_dump(plain(asdict(performance.config)), sort_keys=False).encode()
    known = identity(performance, first_frame, settings)
    _write_motion(performance, folder / MOTION, first_frame, known)
    transforms, template = performance.bone_transforms(), performance.actor.template
    up = performance.upward if up is None else up
    turn = _array(turn_to_y(up.detach().cpu().double()))
    level = np.block([[turn, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]) @ transforms
    save_bvh(folder / "motion.bvh", bvh_motion(template, level, performance.rate), examined=True)
    surface = performance.surface
    if surface is not None:
        numbers = np.arange(first_frame, first_frame + performance.frames)
        rate = performance.rate
        blocks = surface_blocks(surface)
        save_surface(folder / SURFACE, blocks, template.faces, numbers, rate, known, examined=True)
    if performance.contours is not None:
        joints = performance.actor.skeleton.rig.joints
        save_volume(folder / VOLUME, performance.contours.volume, joints)
    _write_masks(performance, folder / MASKS, first_frame, view_names, view_frames)
    moving = None if surface is None else surface_blocks(surface)
    path = folder / "capture.glb"
    rate = performance.rate
    whole = save_animation(path, template, transforms, rate, moving, known, turn, examined=True)
    with writing(folder / "config.yaml") as file:
        file.write(settings)
    report = {**(run or {}), **performance.report(first_frame), "capture": known}
    if surface is not None:
        report["surface"] = {"vertices": len(template.vertices), "in_glb": whole}
    with writing(folder / REPORT) as file:
        file.write(json.dumps(plain(report), indent=1).encode())


def identity(performance: Performance, first_frame: int, settings: bytes) -> str:
    """Name of a capture that follows from what was captured: equal captures have equal ones."""
    digest = hashlib.sha256(settings)
    motion = performance.motion
    for values in (motion.translation, motion.rotation, motion.angles):
        digest.update(np.ascontiguousarray(_array(values)).tobytes())
    refinement = performance.refinement
    found = None if refinement is None else refinement.report(first_frame)
    about = [first_frame, performance.rate, plain(found)]
    digest.update(json.dumps(about, sort_keys=True).encode())
    return digest.hexdigest()[:32]


def _write_masks(
    performance: Performance,
    folder: Path,
    first_frame: int,
    names: Sequence[str] | None,
    numbers: Sequence[Sequence[int]] | None,
) -> None:
    if performance.refinement is None:
        return
    silhouettes = performance.refinement.evidence.silhouettes
    names = names or [f"view_{view}" for view in range(silhouettes.views)]
    masks = {name: silhouettes.png(view) for view, name in enumerate(names)}
    save_masks(folder, masks, first_frame, numbers)


def _write_motion(performance: Performance, path: Path, first_frame: int, known: str) -> None:
    skeleton, motion = performance.actor.skeleton, performance.motion
    with writing(path) as file:
        np.savez_compressed(
            file,
            joints3d=_array(performance.joints()),
            joint_names=np.array(skeleton.rig.landmarks),
            root_translation=_array(motion.translation),
            root_rotation=_array(motion.rotation),
            angles=_array(motion.angles),
            angle_names=np.array(skeleton.angle_names),
            angle_lower=_array(skeleton.lower),
            angle_upper=_array(skeleton.upper),
            frames=np.arange(first_frame, first_frame + performance.frames),
            **_standing(performance),
            **_trust(performance),
            fps=np.array(performance.rate),
            capture=np.array(known),
        )


def _standing(performance: Performance) -> dict[str, Any]:
    """Contact of the feet (F, 2) and the floor: its normal, and its height along it, (4,)."""
    if performance.floor is None or performance.contact is None:
        return {"contact": np.zeros((performance.frames, 2))}
    floor = performance.floor
    plane = np.append(_array(floor.normal), float(floor.height))
    return {"contact": _array(performance.contact), "floor": plane}


def _trust(performance: Performance) -> dict[str, Any]:
    """Trust in each frame, (F,), 0 to 1."""
    if performance.trust is None:
        return {}
    return {"trust": _array(performance.trust.value)}


def _array(values: Tensor) -> np.ndarray:
    numbers: np.ndarray = values.detach().cpu().double().numpy()
    return numbers


def plain(value: Any) -> Any:
    """Nested dicts, lists and plain numbers, as YAML and JSON know them."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value if isinstance(value, str | int | float | bool) or value is None else str(value)
