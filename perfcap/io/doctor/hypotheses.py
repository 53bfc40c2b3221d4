"""Mistakes that people make with cameras and detections, as changes that would undo them."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.doctor.detections import CONFIDENT
from perfcap.io.doctor.evidence import Scene

SCALES = (0.25, 0.5, 2 / 3, 1.5, 2.0, 4.0)
DELAYS = (-20, -14, -10, -7, -5, -3, -2, 2, 3, 5, 7, 10, 14, 20)  # frames, of two views
SHORT = 30  # frames; in fewer, another moment may fit better by chance
_SIDES = {"l": "r", "r": "l"}
_MIRROR = [
    LANDMARKS.index(_SIDES[name[0]] + name[1:]) if name[1] == "_" else i
    for i, name in enumerate(LANDMARKS)
]
_FLIP = (1.0, -1.0, -1.0)  # between OpenCV's and OpenGL's camera axes
_TURN = (-1.0, -1.0, 1.0)  # between OpenCV's and PyTorch3D's


@dataclass(frozen=True)
class Hypothesis:
    """A mistake: whose, what it looks like, what to do, and the change that undoes it.

    One that ``settles`` is believed only if views agree without it: people who are mixed up fit a
    little better in many another image.
    """

    subject: str
    what: str
    remedy: str
    undo: Callable[[Scene], Scene]
    settles: bool = False
    views: tuple[int, ...] = ()  # that are wrong, where it is said of some
    delay: int = 0  # frames that a view is late, where that is the mistake
    scale: float = 1.0  # of all joints, and of what views disagree by, once it is undone


def hypotheses(names: Sequence[str], views: Sequence[int], frames: int) -> Iterator[Hypothesis]:
    """All mistakes looked for, of all cameras, of pairs and of single views.

    Late views are of two alone, by half of a short clip of so many ``frames`` at most.
    """
    yield from _conventions()
    yield Hypothesis(
        "detections",
        "look as if x and y were exchanged",
        "give columns (x) before rows (y)",
        partial(_redrawn, views=views, change=_rows_first),
        settles=True,
    )
    for scale in SCALES:
        yield Hypothesis(
            "detections",
            f"look as if made in images {1 / scale:.3g} times the size of the calibration's",
            "detect in the calibrated size, or calibrate in the detected one",
            partial(_scaled, views=views, scale=scale),
            scale=scale,
        )
    yield from view_hypotheses(names, views)
    for view in views if len(views) < 3 else ():
        yield from _delays(names[view], view, DELAYS[-1] if frames >= SHORT else frames // 2)


def view_hypotheses(names: Sequence[str], views: Sequence[int]) -> Iterator[Hypothesis]:
    """Mistakes of pairs of views and of single ones, but late ones."""
    for first, second in combinations(views, 2):
        yield Hypothesis(
            f"{names[first]} and {names[second]}",
            "look exchanged",
            "give detections and videos in the order of the cameras",
            partial(_exchanged, first=first, second=second),
            views=(first, second),
        )
    for view in views:
        yield from (replace(each, views=(view,)) for each in _single(names[view], view))


def _conventions() -> Iterator[Hypothesis]:
    inverse, opengl = "camera-to-world, expected world-to-camera", "OpenGL or Blender axes"
    cases: tuple[tuple[str, str, Callable[[Camera], Camera]], ...] = (
        (inverse, "invert them", _inverted),
        (f"in {opengl}, expected OpenCV", "flip y and z of the camera axes", _flipped),
        (f"camera-to-world in {opengl}", "flip, then invert", _inverted_and_flipped),
        (
            "in axes with x left and y up, expected OpenCV",
            "flip x and y, unless joints are of videos that are upside down",
            _turned,
        ),
        ("as if t were the place of the camera", "give t = -R place", _placed),
        ("as if R alone were transposed", "transpose R and leave t", _transposed),
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
    for what, change in (
        ("in a mirror image, as some front cameras make", _mirror_image),
        ("in an image that is upside down", _half_turn),
        ("with x and y exchanged", _rows_first),
    ):
        yield Hypothesis(
            name,
            f"detections look as if made {what}",
            "detect in the video that was calibrated, x before y",
            partial(_redrawn, views=(view,), change=change),
            settles=True,
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


def _delays(name: str, view: int, most: int) -> Iterator[Hypothesis]:
    """Of more views, ``late_view`` finds the very frame."""
    for delay in (each for each in DELAYS if abs(each) <= most):
        way = "late" if delay > 0 else "early"
        yield Hypothesis(
            name,
            f"looks {abs(delay)} or so frames {way}",
            "synchronise the videos",
            partial(delayed, view=view, delay=delay),
            views=(view,),
            delay=delay,
        )


def _inverted(camera: Camera) -> Camera:
    rotation = camera.rotation.mT
    return replace(
        camera,
        rotation=rotation,
        translation=-(rotation @ camera.translation.unsqueeze(-1)).squeeze(-1),
    )


def _placed(camera: Camera) -> Camera:
    move = -(camera.rotation @ camera.translation.unsqueeze(-1)).squeeze(-1)
    return replace(camera, translation=move)


def _transposed(camera: Camera) -> Camera:
    return replace(camera, rotation=camera.rotation.mT)


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


_Redraw = Callable[[Tensor, tuple[int, int]], Tensor]
"""Of a view's joints and confidences (F, 16, 3), of an image (height, width): as in another one."""


def _mirror_image(seen: Tensor, size: tuple[int, int]) -> Tensor:
    """In a mirror image detectors take left for right."""
    x, y, confidence = seen[:, _MIRROR].unbind(-1)
    return torch.stack((size[1] - 1 - x, y, confidence), -1)


def _half_turn(seen: Tensor, size: tuple[int, int]) -> Tensor:
    x, y, confidence = seen.unbind(-1)
    return torch.stack((size[1] - 1 - x, size[0] - 1 - y, confidence), -1)


def _rows_first(seen: Tensor, size: tuple[int, int]) -> Tensor:
    return seen[..., [1, 0, 2]]


def _redrawn(scene: Scene, views: Sequence[int], change: _Redraw) -> Scene:
    """Joints of another image of some views; as they are where sizes are not known."""
    sizes, found = scene.cameras.size, scene.detections
    seen = torch.cat((found.joints2d, found.confidence2d[..., None]), -1)
    for view in views if sizes else ():
        seen[:, view] = change(seen[:, view], sizes[view])
    return _with_joints(scene, seen[..., :2], seen[..., 2])


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


# --- Which view shows its frames earlier or later than the others, and by how many ----------------

SHIFTS = 30  # frames looked at, both ways
NEARER = 0.7  # a view is late if undoing that leaves at most this share of its error
_LIKE = 2.0  # times the error of other views: more has another cause
_NOTHING = 1e-6  # px
_FRAMES = 200  # of a clip
_FEWEST_FRAMES, _FEWEST_JOINTS = 10, 60
_LEAST = 2  # frames; one may be rounding of frame rates


def late_view(scene: Scene, names: Sequence[str]) -> Hypothesis | None:
    """The view that other frames fit far better, if any: of three views or more.

    Joints of a view are compared with where the others see them, at every shift. Good recordings
    are best at none, or at one frame with nearly the same error.
    """
    count, views = scene.detections.frame_count, range(scene.detections.views)
    if len(views) < 3:
        return None
    first = max(0, (count - _FRAMES) // 2)
    part = torch.arange(first, min(count, first + _FRAMES))
    scene = scene.frames(part).sure()
    fits = [_best_fit(scene, view) for view in views]
    view = min(views, key=lambda view: fits[view].error / fits[view].now)
    shift, fit = fits[view].shift, fits[view]
    usual = statistics.median(fits[other].now for other in views if other != view)
    if abs(shift) < _LEAST or not fit.error < min(NEARER * fit.now, _LIKE * usual):
        return None
    return Hypothesis(
        names[view],
        f"looks {abs(shift)} or so frames {'late' if shift > 0 else 'early'}",
        "synchronise the videos, and detections with them",
        partial(delayed, view=view, delay=shift),
        views=(view,),
        delay=shift,
    )


@dataclass(frozen=True)
class _Fit:
    """How many frames a view is late, and its error, pixels, without that and now."""

    shift: int
    error: float
    now: float


def _best_fit(scene: Scene, view: int) -> _Fit:
    others = [other for other in range(scene.detections.views) if other != view]
    points, _ = scene.select(others).triangulated(rounds=6)
    expected = scene.cameras.select([view]).project(points.nan_to_num())[:, 0]
    known = ~points.isnan().any(-1)
    found = scene.detections.joints2d[:, view]
    seen = scene.detections.confidence2d[:, view] > CONFIDENT
    errors = {
        shift: _error(expected, known, found, seen, shift) for shift in range(-SHIFTS, SHIFTS + 1)
    }
    best = min(errors, key=errors.__getitem__)
    return _Fit(best, errors[best], max(errors[0], _NOTHING))


def _error(expected: Tensor, known: Tensor, found: Tensor, seen: Tensor, shift: int) -> float:
    """Median distance (pixels) of joints ``shift`` frames later from what is expected, (F, 16)."""
    count = max(0, len(expected) - abs(shift))
    here, there = max(0, -shift), max(0, shift)
    both = known[here : here + count] & seen[there : there + count]
    if both.any(-1).sum() < _FEWEST_FRAMES:
        return float("inf")
    apart = (expected[here : here + count] - found[there : there + count]).norm(dim=-1)[both]
    return float(apart.median()) if len(apart) >= _FEWEST_JOINTS else float("inf")
