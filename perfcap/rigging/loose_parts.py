"""What of a mesh besides the person may have been measured with the person."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.geometry.surface_topology import surface_topology

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_APART = 0.1  # of the height: more than shoes and hair have
_SLIT = 0.02  # of the height: between parts of one person, as a head that is a part of its own


def height_doubt(
    vertices: Floats, faces: Integers, body: Floats, stature: float, height: float
) -> str | None:
    """What speaks against a mesh having been scaled by the height of its person alone.

    A mesh is scaled by all of it. A ball below the soles is measured too, and makes the person in
    it smaller by as much as it is apart. A body may have been fitted to such a ball as well, so
    the mesh is asked before the body is.

    Args:
        vertices: of the upright mesh, (V, 3), metres, y up.
        faces: of it, (T, 3).
        body: surface of the body that was fitted into it, in its pose, (N, 3).
        stature: of that body, standing straight.
        height: what the whole mesh was scaled to.

    Returns:
        A sentence, or None where no part lies apart above or below the others, and the two heights
        differ by no more than shoes and hair have.
    """
    parts = _heights_of_parts(vertices, faces)
    low, high = _person(parts, _SLIT * height)
    size = high - low
    if size > (1 - _SLIT) * height:
        size, low, high = stature, float(body[:, 1].min()), float(body[:, 1].max())
        if abs(size / height - 1) <= _APART:
            return None
    sizes = f"the person in it is {size:.2f} m tall, but the height given is {height:.2f} m"
    beyond = np.maximum(low - parts.mean(1), parts.mean(1) - high)
    if beyond.max() <= 0:
        return (
            f"{sizes}, and no loose part is above or below it; expected a person who stands "
            "straight, without raised arms or a pedestal, and the height of just that"
        )
    first, last = np.abs(parts[beyond.argmax()] - parts.min())  # never -0.00
    side = "below" if parts[beyond.argmax()].mean() < low else "above"
    return (
        f"{sizes}: a loose part {side} it, {first:.2f} to {last:.2f} m above the lowest point, is "
        "measured too; delete it from the mesh, or correct the height"
    )


def _heights_of_parts(vertices: Floats, faces: Integers) -> Floats:
    """Lowest and highest point of each connected part, (P, 2), by falling area."""
    topology = surface_topology(vertices, faces)
    height = vertices[topology.representative, 1]
    used = topology.component >= 0  # places of no triangle belong to no part
    parts = np.tile([np.inf, -np.inf], (topology.components, 1))
    np.minimum.at(parts[:, 0], topology.component[used], height[used])
    np.maximum.at(parts[:, 1], topology.component[used], height[used])
    return parts


def _person(parts: Floats, slit: float) -> tuple[float, float]:
    """From where to where the largest part reaches, with all that go on where it ends."""
    low, high = (float(y) for y in parts[0])
    for bottom, top in parts[parts[:, 0].argsort()]:  # upwards
        if bottom <= high + slit and top >= low:
            high = max(high, float(top))
    for bottom, top in parts[(-parts[:, 1]).argsort()]:  # downwards
        if top >= low - slit and bottom <= high:
            low = min(low, float(bottom))
    return low, high
