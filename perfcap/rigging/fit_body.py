"""Shape of a person from calibrated views: joints and silhouettes of several frames."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements, measure
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shaped_points import OFFSETS, ShapedPoints
from perfcap.actor.shaped_volume import ShapedGaussians
from perfcap.actor.template import Template
from perfcap.actor.volume_fit import fit_volume
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.energy.density_contour import DensityContour
from perfcap.energy.prior import PosePrior, SharedPrior
from perfcap.energy.reprojection import Reprojection
from perfcap.energy.silhouette_overlap import SilhouetteOverlap
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.render.soft_silhouette import SoftSilhouette
from perfcap.rigging.build_body import LENGTHS, Scales
from perfcap.rigging.fit_checks import require_fit, require_masks, warn_of_inputs, warn_of_result
from perfcap.rigging.fit_surface import shape_bounds
from perfcap.rigging.person_masks import PersonMasks
from perfcap.rigging.view_fit import ViewFitSettings
from perfcap.solve import (
    Adjoint,
    Bounds,
    Coupling,
    Energy,
    LevenbergMarquardt,
    Objective,
    Residual,
    Step,
    solve,
)
from perfcap.solve.covariance import shared_covariance
from perfcap.solve.kernels import GemanMcClure

# --- How well measurements are known --------------------------------------------------------------

# by how much a body's measurements change when its surface moves out by one
_GROWTH = {"height": 2.0, "inseam": 1.0, **dict.fromkeys(("chest", "waist", "hip"), 2 * math.pi)}


def deviations(
    model: BodyModel, shape: Tensor, covariance: Tensor, edge: float = 0.0
) -> Measurements:
    """Standard deviations of a body's measurements, metres.

    Args:
        model: the body.
        shape: its coefficients, (S,).
        covariance: of them, (S, S).
        edge: deviation of where silhouettes end from where the skin does, everywhere alike: a
            girth changes by 2 pi times as much, the height at both ends, the inseam at one.
    """
    slopes = Scales(model).linearized(shape.double().numpy(force=True))[1]
    known = covariance.double().numpy(force=True)
    variance = np.einsum("ns,st,nt->n", slopes, known, slopes)
    grown = np.array([_GROWTH[name] for name in LENGTHS]) * edge
    return Measurements(*np.sqrt(variance + grown**2).tolist())


# --- Shape of a person from calibrated views: joints and silhouettes of several frames ------------


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A person's body.

    Attributes:
        shape: coefficients, (S,).
        motion: pose in each frame, with the shape.
        template: the rigged body in its rest pose.
        measurements: of the template.
        deviations: standard deviations of the measurements, from noise and from what detectors and
            silhouettes are constantly off by; clothes and a wrong calibration come on top.
        covariance: of the coefficients, (S, S), from noise and from detectors likewise.
        support: share of the body's contours on edges, mean of all frames, -1 to 1; None where no
            edges were looked at.
    """

    shape: Tensor
    motion: Motion
    template: Template
    measurements: Measurements
    deviations: Measurements
    covariance: Tensor
    support: float | None = None


def fit_body(
    model: BodyModel,
    cameras: Camera,
    detections: Detections,
    initial: Motion,
    masks: PersonMasks | None = None,
    height: float | None = None,
    settings: ViewFitSettings | None = None,
    contours: Contours | None = None,
    adjoint: Adjoint | None = None,
) -> BodyFit:
    """Fit shape and poses of a body model to joints, silhouettes or edges, and a known height.

    Args:
        model: the body.
        cameras: C calibrated views in pixels of the detections, (C,) or (F, C).
        detections: joints of F frames, (F, C).
        initial: poses to start from, (F,), such as of ``initialize`` with the mean body.
        masks: of the person, or None. Bodies are taken to fill them: tight clothes.
        height: metres, or None. With one view, size and distance are told apart by it alone.
        settings: how.
        contours: edges of the images, in place of masks; with ``consensus="shared"`` alone.
        adjoint: how shape and poses carry gradients to detections, cameras and masks, such as
            ``Implicit()``; they carry none without. Not with contours.

    Raises:
        InputError: arguments are of other kinds, units, frames or sizes, nobody is seen, or masks
            and contours are both given.
    """
    settings = settings or ViewFitSettings()
    if contours is not None and (masks is not None or settings.consensus != "shared"):
        raise InputError(
            "contours: are fitted in place of masks, to one shape of all frames; leave out masks, "
            'and take consensus="shared"'
        )
    require_fit(model, cameras, detections, initial, height)
    detections = detections.finite()
    if masks is not None:
        require_masks(masks, detections.frame_count, settings)
    warn_of_inputs(cameras, detections, masks)
    problem = _Problem(model, cameras, detections, height, settings, adjoint)
    if settings.consensus == "median":
        initial = problem.shape_fixed(initial, masks)
    if contours is not None:
        motion, contour = problem.outlined(problem.fitted(initial, None)[0], contours)
        found = problem.result(motion, {"contours": contour})
        support = contour.support(contour.points(motion))
        found = replace(found, support=float(support.mean()))
    else:
        found = problem.result(*problem.fitted(initial, masks))
    warn_of_result(model, found, cameras, detections, height, masks, problem.of_joints)
    return found


class Contours(Protocol):
    """Edges of images about a person; ``perfcap.pipeline.body_contours.BodyContours`` is one."""

    def energy(
        self, body: ShapedGaussians, motion: Motion, pixels: float, weight: float
    ) -> DensityContour:
        """Contours of a body of Gaussians against them, in images of a person so tall (px)."""


class _Problem:
    """What all solves of a fit share."""

    def __init__(
        self,
        model: BodyModel,
        cameras: Camera,
        detections: Detections,
        height: float | None,
        settings: ViewFitSettings,
        adjoint: Adjoint | None = None,
    ) -> None:
        self.adjoint = adjoint
        self.model, self.cameras, self.detections = model, cameras, detections
        self.height, self.settings = height, settings
        self.actor = model.actor(torch.zeros(0)).to(detections.joints2d)
        self.surface = ShapedPoints.of_surface(model, self.actor)
        self.unit = 0.01 * detections.box_heights()
        self.fixed: Tensor | None = None  # a shape that is known
        self.of_joints: Motion | None = None  # with a shape that masks have no part in
        self.energies = self._energies(None)

    def _energies(self, offsets: tuple[float, ...] | None) -> dict[str, Energy[Any]]:
        """All but silhouettes, with what a detector may be off by among the unknowns."""
        model, settings, frames = self.model, self.settings, self.detections.frame_count
        landmarks = ShapedPoints.of_landmarks(model, self.actor, offsets)
        found: dict[str, Energy[Any]] = {
            "joints": Reprojection(
                landmarks.at(torch.arange(len(LANDMARKS)).numpy()),
                self.cameras,
                self.detections,
                settings.joints,
                GemanMcClure(settings.joint_scale),
                self.unit,
            ),
            "shape": SharedPrior(model.components, frames, weight=settings.shape),
            "pose": PosePrior(self.actor.skeleton.lower.new_zeros(27), settings.pose, 1.0),
        }
        if landmarks.offsets is not None:
            free = len(landmarks.offsets)
            found["offsets"] = SharedPrior(free, frames, weight=settings.shape, block=OFFSETS)
        if self.height is not None:
            found["height"] = Stature(model, self.height, settings.height, frames)
        return found

    def fitted(
        self, initial: Motion, masks: PersonMasks | None
    ) -> tuple[Motion, dict[str, Energy[Any]]]:
        """Joints first, silhouettes second: the motion with its shape, and the last silhouettes."""
        settings, free = self.settings, torch.zeros(self.model.components).to(initial.angles)
        shape = free if self.fixed is None else self.fixed
        motion = self.solved(replace(initial, shared={BODY: shape}), {}, settings.steps[0])
        if self.fixed is None:
            self.of_joints = motion.map(torch.Tensor.detach)
        energies: dict[str, Energy[Any]] = {}
        if masks is not None:
            for pixels, steps in zip(settings.heights, settings.steps[1:], strict=False):
                energies = {"silhouettes": self.silhouettes(masks, pixels)}
                motion = self.solved(motion, energies, steps)
        return motion, energies

    def shape_fixed(self, initial: Motion, masks: PersonMasks | None) -> Motion:
        """Fix the shape to the median of what each frame says: the poses that go with those."""
        found, of_joints = [], []
        for frame in range(initial.frames):
            one = slice(frame, frame + 1)
            seen = self.cameras.frames(one), self.detections.frames(one)
            alone = _Problem(self.model, *seen, self.height, self.settings)
            found.append(
                alone.fitted(initial[one], None if masks is None else masks.frames(one))[0]
            )
            assert alone.of_joints is not None
            of_joints.append(alone.of_joints)
        both = _with_median_shape(found)
        self.fixed, self.of_joints = both.shared[BODY], _with_median_shape(of_joints)
        return replace(both, shared={})

    def outlined(self, motion: Motion, contours: Contours) -> tuple[Motion, DensityContour]:
        """Edges, after the joints: the motion with its shape, and the last contours."""
        settings = self.settings
        body = ShapedGaussians.of(self.model, self.actor, fit_volume(self.actor))
        for pixels, steps in zip(settings.edge_heights, settings.edge_steps, strict=True):
            contour = contours.energy(body, motion, pixels, settings.contours)
            motion = self.solved(motion, {"contours": contour}, steps)
        return motion, contour

    def solved(self, motion: Motion, more: dict[str, Energy[Any]], steps: int) -> Motion:
        """Minimise."""
        objective = Objective({**self.energies, **more})
        bounds = shape_bounds(self.actor, self.model.components)
        if self.fixed is not None:
            sides = bounds.lower.frame, bounds.upper.frame
            bounds = Bounds(*(Step(side, self.fixed) for side in sides))
        method = LevenbergMarquardt(max_steps=steps)
        state: Motion = solve(objective, motion, method, bounds, self.adjoint).state
        return state

    def silhouettes(self, masks: PersonMasks, pixels: float) -> SilhouetteOverlap:
        """Overlap in images in which the person is about so many pixels tall."""
        factor = max(1, int(100 * float(self.unit.median()) / pixels))
        small = masks.shrunk(factor)
        size = (small.inside.shape[-2], small.inside.shape[-1])
        faces = torch.from_numpy(self.model.rig.faces)
        silhouette = SoftSilhouette(faces, size, self.settings.band).to(self.unit.device)
        weight = self.settings.silhouettes
        return SilhouetteOverlap(
            self.surface,
            silhouette,
            small.cameras,
            small.inside,
            small.known,
            weight,
            points=self.surface.chosen,
        )

    def result(self, motion: Motion, more: dict[str, Energy[Any]]) -> BodyFit:
        """What was found, and how well it is known."""
        shape, count = motion.shared[BODY], self.model.components
        energies = self._energies(self.settings.offsets)
        prior = energies["offsets"]
        assert isinstance(prior, SharedPrior)
        both = {BODY: shape, OFFSETS: shape.new_zeros(prior.components)}
        free = replace(motion, shared=both)
        covariance = shared_covariance(Objective({**energies, **more}), free)
        template = self.model.template(shape)
        edge = self.settings.edge if more else 0.0
        own = covariance[:count, :count]
        known = deviations(self.model, shape, own, edge)
        return BodyFit(shape, motion, template, measure(template), known, own)


def _with_median_shape(motions: list[Motion]) -> Motion:
    """Frames as one motion, whose shape is the median of theirs."""
    shape = torch.stack([motion.shared[BODY] for motion in motions]).median(0).values
    joined = Motion.cat([replace(motion, shared={}) for motion in motions])
    return replace(joined, shared={BODY: shape})


class Stature(Energy[Motion]):
    """A known height: (height of the rest pose - height) / deviation, however many the frames.

    The crown and the sole are those of the mean body; at small changes of shape they stay.
    """

    coupling = Coupling.FRAME
    sees = (BODY,)

    def __init__(self, model: BodyModel, height: float, deviation: float, frames: int) -> None:
        super().__init__(1.0)
        mean, basis = model.surface.mean[:, 1], model.surface.basis[..., 1]
        top, low = int(mean.argmax()), int(mean.argmin())
        scale = 1 / (deviation * frames**0.5)
        slope = scale * (basis[:, top] - basis[:, low])
        self.register_buffer("slope", slope)
        self.register_buffer("offset", scale * (mean[top] - mean[low] - height))

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, 1, 1)."""
        if BODY not in motion.shared:
            raise ValueError("Stature needs a motion that shares body; it does not")
        value = motion.shared[BODY] @ self.get_buffer("slope") + self.get_buffer("offset")
        return Residual(value[..., None, None, None].expand(*motion.angles.shape[:-1], 1, 1))
