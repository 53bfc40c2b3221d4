"""The unit of 3D joints, told by how large the person is in it."""

from __future__ import annotations

_PERSON = (0.3, 20.0)  # m from end to end, of anybody in any pose and of rough predictions


def unit_of(extent: float) -> str:
    """``metres``, ``millimetres`` or ``another unit``, of what a person's joints span in it.

    Args:
        extent: diagonal of the box around the joints.
    """
    low, high = _PERSON
    if low < extent < high:
        return "metres"
    return "millimetres" if low < extent / 1000 < high else "another unit"
