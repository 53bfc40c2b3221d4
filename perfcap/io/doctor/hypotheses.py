"""Mistakes that people make with cameras and detections, as changes that would undo them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import torch

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.evidence import Scene

SCALES = (0.25, 0.5, 2 / 3, 1.5, 2.0, 4.0)
DELAYS = (-20, -14, -10, -7, -5, -3, -2, 2, 3, 5, 7, 10, 14, 20)  # frames, of two views
_SIDES = {"l": "r", "r": "l"}
_MIRROR = [
    LANDMARKS.index(_SIDES[name[0]] + name[1:]) if name[1] == "_" else i
    for i, name in enumerate(LANDMARKS)
]
_FLIP = (1.0, -1.0, -1.0)  # between OpenCV's and OpenGL's camera axes
_TURN = (-1.0, -1.0, 1.0)  # between OpenCV's and PyTorch3D's


@dataclass(frozen=True)
class Hypothesis:
    """A mistake: whose, what it looks like, what to do, and the change that undoes it."""

    subject: str
    what: str
    remedy: str
    undo: Callable[[Scene], Scene]


def hypotheses(names: Sequence[str], views: Sequence[int]) -> Iterator[Hypothesis]:
    """All mistakes looked for, of all cameras, of pairs and of single views, but late views."""
    yield from _conventions()
    for scale in SCALES:
        yield Hypothesis(
            "detections",
            f"look as if made in images {1 / scale:.3g} times the size of the calibration's",
            "detect in the calibrated size, or calibrate in the detected one",
            partial(_scaled, views=views, scale=scale),
        )
    for first, second in combinations(views, 2):
        yield Hypothesis(
            f"{names[first]} and {names[second]}",
            "look exchanged",
            "give detections and videos in the order of the cameras",
            partial(_exchanged, first=first, second=second),
        )
    for view in views:
        yield from _single(names[view], view)
        if len(views) < 3:
            yield from _delays(names[view], view)


def _conventions() -> Iterator[Hypothesis]:
    inverse, opengl = "camera-to-world, expected world-to-camera", "OpenGL or Blender axes"
    cases: tuple[tuple[str, str, Callable[[Camera], Camera]], ...] = (
        (inverse, "invert them", _inverted),
        (f"in {opengl}, expected OpenCV", "flip y and z of the camera axes", _flipped),
        (f"camera-to-world in {opengl}", "flip, then invert", _inverted_and_flipped),
        ("in axes with x left and y up, expected OpenCV", "flip x and y", _turned),
    )
    for what, remedy, change in cases:
        yield Hypothesis(
            "cameras",
            f"R and t look {what}",
            f"{remedy}: x_camera = R x_world + t, x right, y down, z forward",
            partial(_recast, change=change),
        )


def _single(name: str, view: int) -> Iterator[Hypothesis]:
    yield Hypothesis(
        name,
        "left and right joints look swapped in this view",
        "check for a mirrored video (front camera) or swapped joint names",
        partial(_mirrored, view=view),
    )
    for scale in SCALES:
        yield Hypothesis(
            name,
            f"detections look as if made in an image {1 / scale:.3g} times the calibration's size",
            "detect in the calibrated size",
            partial(_scaled, views=(view,), scale=scale),
        )
    for factor, unit in ((1e-3, "millimetres"), (1e-2, "centimetres")):
        yield Hypothesis(
            name,
            f"translation looks like {unit} while others are metres",
            "convert it to metres",
            partial(_farther, view=view, factor=factor),
        )


def _delays(name: str, view: int) -> Iterator[Hypothesis]:
    """Of more views, ``late_view`` finds the very frame."""
    for delay in DELAYS:
        way = "late" if delay > 0 else "early"
        yield Hypothesis(
            name,
            f"looks {abs(delay)} or so frames {way}",
            "synchronise the videos",
            partial(delayed, view=view, delay=delay),
        )


def _inverted(camera: Camera) -> Camera:
    rotation = camera.rotation.mT
    return replace(
        camera,
        rotation=rotation,
        translation=-(rotation @ camera.translation.unsqueeze(-1)).squeeze(-1),
    )


def _flipped(camera: Camera) -> Camera:
    flip = camera.translation.new_tensor(_FLIP)
    return replace(
        camera, rotation=flip[:, None] * camera.rotation, translation=flip * camera.translation
    )


def _turned(camera: Camera) -> Camera:
    turn = camera.translation.new_tensor(_TURN)
    return replace(
        camera, rotation=turn[:, None] * camera.rotation, translation=turn * camera.translation
    )


def _inverted_and_flipped(camera: Camera) -> Camera:
    return _flipped(_inverted(camera))


def _recast(scene: Scene, change: Callable[[Camera], Camera]) -> Scene:
    return replace(scene, cameras=change(scene.cameras))


def _farther(scene: Scene, view: int, factor: float) -> Scene:
    share = torch.ones_like(scene.cameras.translation)
    share[..., view, :] = factor
    return replace(
        scene, cameras=replace(scene.cameras, translation=share * scene.cameras.translation)
    )


def _with_joints(scene: Scene, joints2d: torch.Tensor, confidence2d: torch.Tensor) -> Scene:
    old = scene.detections
    return replace(scene, detections=Detections(joints2d, confidence2d, None, old.trusted3d))


def _scaled(scene: Scene, views: Sequence[int], scale: float) -> Scene:
    joints = scene.detections.joints2d.clone()
    joints[:, list(views)] *= scale
    return _with_joints(scene, joints, scene.detections.confidence2d)


def _mirrored(scene: Scene, view: int) -> Scene:
    joints, confidence = scene.detections.joints2d.clone(), scene.detections.confidence2d.clone()
    joints[:, view] = joints[:, view][:, _MIRROR]
    confidence[:, view] = confidence[:, view][:, _MIRROR]
    return _with_joints(scene, joints, confidence)


def _exchanged(scene: Scene, first: int, second: int) -> Scene:
    order = list(range(scene.detections.views))
    order[first], order[second] = second, first
    return replace(scene, detections=scene.detections.select(order))


def delayed(scene: Scene, view: int, delay: int) -> Scene:
    """What a view shows ``delay`` frames later, moved to where it belongs."""
    joints, confidence = scene.detections.joints2d.clone(), scene.detections.confidence2d.clone()
    joints[:, view] = joints[:, view].roll(-delay, 0)
    confidence[:, view] = confidence[:, view].roll(-delay, 0)
    wrapped = slice(-delay, None) if delay > 0 else slice(None, -delay)
    confidence[wrapped, view] = 0
    return _with_joints(scene, joints, confidence)
