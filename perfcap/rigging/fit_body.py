"""Shape of a person from calibrated views: joints and silhouettes of several frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor, nn

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements, measure
from perfcap.actor.motion import Motion
from perfcap.actor.template import Template
from perfcap.detect.detections import Detections
from perfcap.energy.prior import PosePrior
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.rigging.fit_surface import shape_bounds
from perfcap.rigging.shaped_points import ShapedPoints
from perfcap.rigging.surface_match import ShapePrior
from perfcap.rigging.view_energies import LandmarkReprojection, ShapedSilhouette
from perfcap.solve import Coupling, Energy, LevenbergMarquardt, Objective, Residual, solve
from perfcap.solve.kernels import GemanMcClure

_JOINTS = 16


@dataclass(frozen=True)
class ViewFitSettings:
    """How a body is fitted to views.

    Attributes:
        joints: weight of a joint's squared reprojection error.
        joint_scale: of the robust kernel, in pixel units.
        silhouettes: weight of a view's squared silhouette error, shares of its area.
        heights: of the person in the images the silhouettes are compared in, px, in turn.
        band: about the outline, px of those images.
        shape: weight of the squared coefficients of shape.
        pose: deviation of angles from the neutral pose, radians.
        height: deviation of a given height, metres.
        steps: of the solver, of joints alone and then in each image size.
    """

    joints: float = 0.5
    joint_scale: float = 4.0
    silhouettes: float = 1500.0
    heights: tuple[float, ...] = (80.0, 160.0)
    band: float = 4.0
    shape: float = 0.5
    pose: float = 1.0
    height: float = 0.005
    steps: tuple[int, ...] = (25, 12, 10)


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A person's body.

    Attributes:
        shape: coefficients, (S,).
        motion: pose in each frame, with the shape.
        template: the rigged body in its rest pose.
        measurements: of the template.
    """

    shape: Tensor
    motion: Motion
    template: Template
    measurements: Measurements


def fit_body(
    model: BodyModel,
    cameras: Camera,
    detections: Detections,
    initial: Motion,
    masks: Tensor | None = None,
    height: float | None = None,
    settings: ViewFitSettings | None = None,
) -> BodyFit:
    """Fit shape and poses of a body model to joints, silhouettes and a known height.

    Args:
        model: the body.
        cameras: C calibrated views, (C,) or (F, C), with their sizes where there are masks.
        detections: joints of F frames, (F, C).
        initial: poses to start from, (F,), such as of ``initialize`` with the mean body.
        masks: of the person, (F, C, H, W), or None. Bodies are taken to fill them: tight clothes.
        height: metres, or None. With one view, size and distance are told apart by it alone.
        settings: how.

    Raises:
        InputError: frames of the arguments do not agree.
    """
    settings = settings or ViewFitSettings()
    if initial.frames != detections.frame_count:
        raise InputError(
            f"initial has {initial.frames} frames but detections have {detections.frame_count}; "
            "give a pose for each"
        )
    problem = _Problem(model, cameras, detections, height, settings)
    shape = torch.zeros(model.components).to(initial.angles)
    motion = problem.solved(replace(initial, shape=shape), {}, settings.steps[0])
    sizes = settings.heights if masks is not None else ()
    for pixels, steps in zip(sizes, settings.steps[1:], strict=False):
        assert masks is not None
        energies: dict[str, Energy[Any]] = {
            "silhouettes": problem.silhouettes(motion, masks, pixels)
        }
        motion = problem.solved(motion, energies, steps)
    assert motion.shape is not None
    template = model.template(motion.shape)
    return BodyFit(motion.shape, motion, template, measure(template))


class _Problem:
    """What all solves of a fit share."""

    def __init__(
        self,
        model: BodyModel,
        cameras: Camera,
        detections: Detections,
        height: float | None,
        settings: ViewFitSettings,
    ) -> None:
        self.model, self.cameras, self.settings = model, cameras, settings
        self.actor = model.actor(torch.zeros(0)).to(detections.joints2d)
        self.surface = ShapedPoints.of_surface(model, self.actor)
        self.frames = detections.frame_count
        self.unit = 0.01 * extents(detections)
        marks = ShapedPoints.of_landmarks(model, self.actor).at(torch.arange(_JOINTS).numpy())
        self.energies: dict[str, Energy[Any]] = {
            "joints": LandmarkReprojection(
                marks,
                cameras,
                detections,
                settings.joints,
                GemanMcClure(settings.joint_scale),
                self.unit,
            ),
            "shape": ShapePrior(model.components, self.frames, weight=settings.shape),
            "pose": PosePrior(self.actor.skeleton.lower.new_zeros(27), settings.pose, 1.0),
        }
        if height is not None:
            self.energies["height"] = Stature(model, height, settings.height, self.frames)

    def solved(self, motion: Motion, more: dict[str, Energy[Any]], steps: int) -> Motion:
        """Minimise."""
        objective = Objective({**self.energies, **more})
        bounds = shape_bounds(self.actor, self.model.components)
        state: Motion = solve(objective, motion, LevenbergMarquardt(max_steps=steps), bounds).state
        return state

    def silhouettes(self, motion: Motion, masks: Tensor, pixels: float) -> ShapedSilhouette:
        """Overlap in images in which the person is about so many pixels tall."""
        factor = max(1, int(100 * float(self.unit.median()) / pixels))
        small, cameras = shrunk(masks, self.cameras, factor)
        size = (small.shape[-2], small.shape[-1])
        faces = torch.from_numpy(self.model.rig.faces)
        silhouette = SoftSilhouette(faces, size, self.settings.band)
        weight = self.settings.silhouettes
        return ShapedSilhouette(self.surface, silhouette, cameras, small, weight)


class Stature(Energy[Motion]):
    """A known height: (height of the rest pose - height) / deviation, however many the frames.

    The crown and the sole are those of the mean body; at small changes of shape they stay.
    """

    coupling = Coupling.FRAME
    sees_shared = True

    def __init__(self, model: BodyModel, height: float, deviation: float, frames: int) -> None:
        super().__init__(1.0)
        mean, basis = model.surface.mean[:, 1], model.surface.basis[..., 1]
        top, low = int(mean.argmax()), int(mean.argmin())
        scale = 1 / (deviation * frames**0.5)
        self.register_buffer("slope", scale * (basis[:, top] - basis[:, low]))
        self.register_buffer("offset", scale * (mean[top] - mean[low] - height))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, 1, 1)."""
        if motion.shape is None:
            raise ValueError("Stature needs a motion with shape coefficients; it has none")
        value = motion.shape @ self.get_buffer("slope") + self.get_buffer("offset")
        return Residual(value[..., None, None, None].expand(*motion.angles.shape[:-1], 1, 1))


def extents(detections: Detections) -> Tensor:
    """Median height of the box of the joints in each view, (C,) px."""
    seen = detections.confidence2d > 0
    rows = detections.joints2d[..., 1]
    low = rows.masked_fill(~seen, torch.inf).amin(-1)
    high = rows.masked_fill(~seen, -torch.inf).amax(-1)
    tall = torch.where((high - low).isfinite(), high - low, torch.nan)
    found: Tensor = tall.nanmedian(0).values
    return found.nan_to_num(100.0).clamp(min=10.0)


def shrunk(masks: Tensor, cameras: Camera, factor: int) -> tuple[Tensor, Camera]:
    """Masks averaged over blocks of ``factor`` pixels, and the cameras of the small images."""
    height, width = (size // factor * factor for size in masks.shape[-2:])
    cut = masks[..., :height, :width].double()
    lead = cut.shape[:-2]
    small = nn.functional.avg_pool2d(cut.reshape(-1, 1, height, width), factor)
    small = small.reshape(*lead, *small.shape[-2:])
    intrinsics = cameras.intrinsics.clone()
    # pixel centres are integers: the image corner is half a pixel before the first of them
    intrinsics[..., :2, 2] += 0.5
    intrinsics[..., :2, :] /= factor
    intrinsics[..., :2, 2] -= 0.5
    sizes = ((small.shape[-2], small.shape[-1]),) * cameras.views
    return small, replace(cameras, intrinsics=intrinsics, size=sizes)
