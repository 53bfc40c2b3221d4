"""A captured motion as columns of numbers, one row a frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS

if TYPE_CHECKING:
    from perfcap.pipeline.performance import Performance

Column = tuple[str, str, str]
LEVELS = ("quantity", "name", "axis")
"""What the three words of a column say."""

_AXES = "xyz"


def frame_table(performance: Performance) -> dict[Column, NDArray[np.float64]]:
    """Columns of F numbers by quantity, name and axis or unit.

    Time in seconds from the first frame; joints, metres in the world; the root's place and rotation
    vector; angles, degrees; the feet's probability of standing; trust, and the expected error in
    millimetres, where the capture knows them.
    """
    motion = performance.motion
    columns: dict[Column, Tensor | NDArray[np.float64]] = {
        ("time", "", "s"): np.arange(performance.frames) / performance.rate
    }
    points = performance.joints()
    for joint, name in enumerate(LANDMARKS):
        columns |= {("joint", name, axis): points[:, joint, k] for k, axis in enumerate(_AXES)}
    for name, values in (("translation", motion.translation), ("rotation", motion.rotation)):
        columns |= {("root", name, axis): values[:, k] for k, axis in enumerate(_AXES)}
    for k, name in enumerate(performance.actor.skeleton.angle_names):
        columns["angle", name, "deg"] = motion.angles[:, k].rad2deg()
    if performance.contact is not None:
        columns |= {("stands", side, ""): performance.contact[:, k] for k, side in enumerate("lr")}
    if performance.trust is not None:
        columns["trust", "", ""] = performance.trust.value
        columns["expected_error", "", "mm"] = performance.trust.error
    return {name: _numbers(values) for name, values in columns.items()}


def state(performance: Performance) -> Mapping[str, Tensor]:
    """Tensors under plain names, as ``torch.save`` and safetensors take them."""
    motion, found = performance.motion, {}
    for name in ("translation", "rotation", "angles"):
        found[f"motion.{name}"] = getattr(motion, name)
    found |= {f"motion.shared.{name}": block for name, block in motion.shared.items()}
    found["joints"] = performance.joints()
    found["rate"] = motion.angles.new_tensor(performance.rate)
    if performance.bone_scales is not None:
        found["bone_scales"] = performance.bone_scales
    if performance.contact is not None:
        found["contact"] = performance.contact
    if performance.trust is not None:
        found |= {"trust": performance.trust.value, "expected_error": performance.trust.error}
    return {name: values.detach().contiguous() for name, values in found.items()}


def _numbers(values: Tensor | NDArray[np.float64]) -> NDArray[np.float64]:
    array = values.numpy(force=True) if isinstance(values, Tensor) else values
    return np.ascontiguousarray(array, dtype=np.float64)
