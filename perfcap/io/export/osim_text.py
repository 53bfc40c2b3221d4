"""A jointed model without geometry as OpenSim's XML, version 4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_MASS, _INERTIA = 5.0, 0.05  # kg, kg m^2; placeholders, as kinematics asks for none
_FREE = np.eye(3)


@dataclass(frozen=True, eq=False)
class OsimJoint:
    """A joint, the body that it carries, and how it moves.

    Attributes:
        name: of the joint.
        body: that it carries.
        parent: the body it hangs on; empty for the ground.
        offset: of its centre from the parent's, (3,) m.
        coordinates: names of its angles, from the parent on, K of at most 3.
        axes: of the angles, (K, 3).
        values: of the angles, (K, F) radians.
        places: names of its translations, three or none.
    """

    name: str
    body: str
    parent: str
    offset: Floats
    coordinates: tuple[str, ...]
    axes: Floats
    values: Floats
    places: tuple[str, ...] = ()


def osim_text(
    name: str, joints: Sequence[OsimJoint], markers: Sequence[tuple[str, str, Floats]]
) -> str:
    """The document; bodies' origins are their joints, and at zero all axes are the ground's.

    Args:
        name: of the model.
        joints: parents first.
        markers: name, body and place on it, (3,) m.
    """
    bodies = "".join(
        f'<Body name="{joint.body}"><mass>{_MASS}</mass><mass_center>0 0 0</mass_center>'
        f"<inertia>{_INERTIA} {_INERTIA} {_INERTIA} 0 0 0</inertia></Body>\n"
        for joint in joints
    )
    hung = "".join(map(_joint, joints))
    points = "".join(
        f'<Marker name="{mark}"><socket_parent_frame>/bodyset/{body}</socket_parent_frame>'
        f"<location>{_words(place)}</location></Marker>\n"
        for mark, body, place in markers
    )
    return (
        '<?xml version="1.0" encoding="UTF-8" ?>\n<OpenSimDocument Version="40000">\n'
        f'<Model name="{name}">\n<Ground name="ground"></Ground>\n<gravity>0 -9.80665 0</gravity>\n'
        "<length_units>meters</length_units>\n<force_units>N</force_units>\n"
        f'<BodySet name="bodyset"><objects>\n{bodies}</objects></BodySet>\n'
        f'<JointSet name="jointset"><objects>\n{hung}</objects></JointSet>\n'
        f'<MarkerSet name="markerset"><objects>\n{points}</objects></MarkerSet>\n'
        "</Model>\n</OpenSimDocument>\n"
    )


def _joint(joint: OsimJoint) -> str:
    parent = f"/bodyset/{joint.parent}" if joint.parent else "/ground"
    frames = (
        f"<frames>{_frame('parent', parent, joint.offset)}"
        f"{_frame('child', f'/bodyset/{joint.body}', np.zeros(3))}</frames>"
    )
    sockets = (
        "<socket_parent_frame>parent_offset</socket_parent_frame>"
        "<socket_child_frame>child_offset</socket_child_frame>"
    )
    if not joint.coordinates:
        return f'<WeldJoint name="{joint.name}">{sockets}{frames}</WeldJoint>\n'
    coordinates = "".join(
        f'<Coordinate name="{name}"><default_value>0</default_value><range>{_range(values)}</range>'
        "<clamped>false</clamped></Coordinate>"
        for name, values in zip(joint.coordinates, joint.values, strict=True)
    ) + "".join(
        f'<Coordinate name="{name}"><default_value>0</default_value><range>-1000 1000</range>'
        "<clamped>false</clamped></Coordinate>"
        for name in joint.places
    )
    axes = list(joint.axes)
    while len(axes) < 3:  # axes that do not turn, but may not lie in one plane
        axes.append(_other(axes))
    turns = "".join(
        _axis(f"rotation{n + 1}", axis, (*joint.coordinates, "", "")[n])
        for n, axis in enumerate(axes)
    )
    moves = "".join(
        _axis(f"translation{n + 1}", _FREE[n], (*joint.places, "", "", "")[n]) for n in range(3)
    )
    return (
        f'<CustomJoint name="{joint.name}">{sockets}<coordinates>{coordinates}</coordinates>'
        f"{frames}<SpatialTransform>{turns}{moves}</SpatialTransform></CustomJoint>\n"
    )


def _other(axes: Sequence[Floats]) -> Floats:
    """A unit vector across all of one or two others."""
    first = axes[0]
    second = axes[1] if len(axes) > 1 else np.eye(3)[int(np.abs(first).argmin())]
    across: Floats = np.cross(first, second)
    return across / np.linalg.norm(across)


def _frame(which: str, body: str, place: Floats) -> str:
    return (
        f'<PhysicalOffsetFrame name="{which}_offset"><socket_parent>{body}</socket_parent>'
        f"<translation>{_words(place)}</translation><orientation>0 0 0</orientation>"
        "</PhysicalOffsetFrame>"
    )


def _axis(name: str, axis: Floats, coordinate: str) -> str:
    function = (
        '<LinearFunction name="function"><coefficients>1 0</coefficients></LinearFunction>'
        if coordinate
        else '<Constant name="function"><value>0</value></Constant>'
    )
    return (
        f'<TransformAxis name="{name}"><coordinates>{coordinate}</coordinates>'
        f"<axis>{_words(axis)}</axis>{function}</TransformAxis>"
    )


def _range(values: Floats) -> str:
    """Half a turn either way, or what the motion needs."""
    found = np.unwrap(values)
    return _words(np.array([min(-np.pi, found.min()), max(np.pi, found.max())]))


def _words(values: Floats) -> str:
    return " ".join(f"{value:.12g}" for value in values)
