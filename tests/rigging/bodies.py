"""A body of few shapes, somebody of it who turns, and what views see of them."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shape_space import ShapeSpace
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.body_model import load_body_model
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging.view_fit import ViewFitSettings

QUICK = ViewFitSettings(heights=(90.0,), steps=(12, 8))


def few_shapes() -> BodyModel:
    """The first components of the shipped body."""
    whole = load_body_model()
    surface, bones = (
        ShapeSpace(space.mean, space.basis[:4]) for space in (whole.surface, whole.bones)
    )
    return BodyModel(surface, bones, whole.rig)


def person(model: BodyModel) -> Motion:
    """Three frames of somebody broad who turns."""
    actor = model.actor(torch.zeros(0))
    rest = actor.skeleton.rest_motion(3)
    turn = torch.zeros(3, 3, dtype=torch.float64)
    turn[:, 1] = torch.tensor([0.0, 0.8, 1.6])
    shape = torch.tensor([-0.6, -1.2, 0.4, 1.0], dtype=torch.float64)
    return Motion(torch.zeros(3, 3).double(), turn, rest.angles, {BODY: shape})


def seen(model: BodyModel, motion: Motion, cameras: Camera) -> tuple[Detections, Tensor]:
    """Exact joints and masks."""
    actor = model.actor(torch.zeros(0))
    marks = ShapedPoints.of_landmarks(model, actor)(motion)[:, :16]
    pixels = cameras.project(marks)
    faces = torch.from_numpy(model.rig.faces)
    masks = [
        torch.stack(
            [
                ProjectedMesh.seen_by(cameras.select([view]), vertices, faces).rasterize().mask
                for view in range(cameras.views)
            ]
        )
        for vertices in ShapedPoints.of_surface(model, actor)(motion)
    ]
    confidence = torch.ones(pixels.shape[:-1]).to(pixels)
    return Detections.from_joints(pixels, confidence), torch.stack(masks)
