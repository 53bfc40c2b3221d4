"""Captured motion in viewers of others: Rerun and viser, where they are installed."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surroundings import upright_axis

_COLOR = (200, 170, 150)  # sRGB of the surface


def log_to_rerun(performance: Performance, path: str = "person") -> None:
    """Log surface and joints of all frames, metres, into the Rerun recording that is open.

    The timeline ``time`` counts seconds from the first frame.

    Args:
        performance: of a capture or a retarget.
        path: of the person among what is logged.

    Raises:
        InputError: Rerun is not installed, or it is no ``Performance``.
    """
    _require_one(performance)
    rr = _required("rerun")
    faces, joints = performance.actor.template.faces, performance.joints().cpu()
    axis, sign = _up(performance.upward)
    up = f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if sign > 0 else 'DOWN'}"
    rr.log("/", getattr(rr.ViewCoordinates, up), static=True)
    for frame in range(performance.frames):
        vertices = performance.shown[frame : frame + 1][0].cpu().numpy()
        rr.set_time("time", duration=frame / performance.rate)
        mesh = rr.Mesh3D(vertex_positions=vertices, triangle_indices=faces, albedo_factor=_COLOR)
        rr.log(f"{path}/surface", mesh)
        marks = rr.Points3D(joints[frame].numpy(), labels=LANDMARKS, show_labels=False, radii=0.02)
        rr.log(f"{path}/joints", marks)


def add_to_viser(
    server: Any, performance: Performance, name: str = "person"
) -> Callable[[int], None]:
    """Add the surface, metres, to the scene of a ``viser.ViserServer``, with a slider of frames.

    Args:
        server: whose scene and controls are added to.
        performance: of a capture or a retarget.
        name: of the person in the scene.

    Returns:
        What shows a frame by its number.

    Raises:
        InputError: viser is not installed, or it is no ``Performance``.
    """
    _require_one(performance)
    _required("viser")
    faces = performance.actor.template.faces
    axis, sign = _up(performance.upward)
    server.scene.set_up_direction(tuple(sign * float(k == axis) for k in range(3)))
    slider = server.gui.add_slider(name, 0, performance.frames - 1, 1, 0)

    def show(frame: int) -> None:
        vertices = performance.shown[frame : frame + 1][0].cpu().numpy()
        server.scene.add_mesh_simple(f"/{name}", vertices, faces, color=_COLOR)

    slider.on_update(lambda _: show(int(slider.value)))
    show(0)
    return show


def _up(direction: Tensor) -> tuple[int, float]:
    """Which axis of the world is nearest to up, and 1 where it points up or -1."""
    up = upright_axis(direction)
    axis = int(up.abs().argmax())
    return axis, float(up[axis])


def _require_one(performance: object) -> None:
    if not isinstance(performance, Performance):
        raise InputError(
            f"performance: got a {type(performance).__name__}, expected a Performance; of several "
            "people give each, under its own name"
        )


def _required(package: str) -> Any:
    try:
        return import_module(package)
    except ImportError:
        raise InputError(
            f"{package} is not installed; expected it: pip install 'perfcap[{package}]'"
        ) from None
