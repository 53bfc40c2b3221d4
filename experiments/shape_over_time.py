"""One shape for a clip, or the median of frames (Huang et al. 2017, Table II): rest-pose vertices.

Random bodies of the shipped model turn in front of two or three cameras. Joints have noise, and a
constant error that is another one for each person (as `DETECTOR_OFFSETS` has it); silhouettes are
exact. A body is fitted to joints alone and to silhouettes too, with one unknown shape over all
frames, and as the paper does it, each frame on its own and the median of these. People are of the
model that is fitted: what clothes, faces and a wrong model add is not in these numbers.
"""

from __future__ import annotations

import math
import time
from dataclasses import astuple, dataclass

import numpy as np
import report
import torch
from body_fit import NAMES, ring
from report import Report, Table
from torch import Tensor

from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import measure
from perfcap.actor.motion import BODY, Motion
from perfcap.actor.shaped_points import OFFSETS, ShapedPoints
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.body_model import load_body_model
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem, neutral_angles
from perfcap.pipeline.prepare import prepare
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging import BodyFit, PersonMasks, ViewFitSettings, fit_body
from perfcap.rigging.view_fit import DETECTOR_OFFSETS


@dataclass(frozen=True)
class Experiment:
    """What to fit.

    Attributes:
        people: how many.
        frames: of each.
        views: numbers of cameras.
        noise: deviation of joints in the images, px.
        seed: of people and noise.
    """

    people: int = 8
    frames: int = 6
    views: tuple[int, ...] = (2, 3)
    noise: float = 3.0
    seed: int = 29


@dataclass(frozen=True, eq=False)
class Filmed:
    """Somebody in front of cameras."""

    shape: Tensor
    cameras: Camera
    detections: Detections
    masks: Tensor


def run(config: Experiment) -> Report:
    """A row for each number of views, evidence and consensus."""
    torch.set_num_threads(1)
    model = load_body_model()
    rows, honest = [], []
    for views in config.views:
        people = [film(model, config, views, number) for number in range(config.people)]
        for shown in (False, True):
            for consensus in ("median", "shared"):
                found = [_scores(model, one, shown, consensus) for one in people]
                label = views, "joints and silhouettes" if shown else "joints", consensus
                rows.append((*label, *np.mean([each[0] for each in found], 0).tolist()))
                root = np.sqrt(np.mean([np.square(each[1]) for each in found], 0))
                honest.append((*label, *root.tolist()))
    about = ("views", "fitted to", "shape")
    measures = ("vertices, mm", "height, cm", "girths, cm", "CPU s a frame")
    over = "root mean square error over the stated deviation"
    return Report(
        (
            Table("errors, means over people", (*about, *measures), tuple(rows), 2),
            Table(over, (*about, *NAMES), tuple(honest), 2),
        )
    )


def film(model: BodyModel, config: Experiment, views: int, number: int) -> Filmed:
    """Somebody whose arms and legs move a little while turning around."""
    random = torch.Generator().manual_seed(1000 * config.seed + number)

    def normal(*size: int) -> Tensor:
        return torch.randn(*size, generator=random, dtype=torch.float64)

    actor, frames = model.actor(torch.zeros(0)), config.frames
    shape = normal(model.components).clamp(-2.5, 2.5)
    lower, upper = actor.skeleton.lower, actor.skeleton.upper
    angles = neutral_angles(actor) + 0.2 * normal(frames, len(lower))
    turn = torch.zeros(frames, 3, dtype=torch.float64)
    turn[:, 1] = 2 * math.pi * torch.arange(frames) / frames
    marks = ShapedPoints.of_landmarks(model, actor, DETECTOR_OFFSETS)
    assert marks.offsets is not None
    shared = {BODY: shape, OFFSETS: normal(len(marks.offsets))}
    place = torch.zeros(frames, 3, dtype=torch.float64)
    motion = Motion(place, turn, angles.clamp(lower, upper), shared)
    cameras = ring(views)
    exact = cameras.project(marks(motion)[:, :16])
    pixels = exact + config.noise * normal(*exact.shape)
    detections = Detections.from_joints(pixels, torch.ones_like(pixels[..., 0]))
    faces, bodies = torch.from_numpy(model.rig.faces), ShapedPoints.of_surface(model, actor)(motion)
    masks = [
        torch.stack([_mask(cameras.select([view]), body, faces) for view in range(views)])
        for body in bodies
    ]
    return Filmed(shape, cameras, detections, torch.stack(masks))


def _mask(camera: Camera, vertices: Tensor, faces: Tensor) -> Tensor:
    mask: Tensor = ProjectedMesh.seen_by(camera, vertices, faces).rasterize().mask
    return mask


def _scores(
    model: BodyModel, one: Filmed, shown: bool, consensus: str
) -> tuple[tuple[float, ...], list[float]]:
    """Errors and CPU seconds a frame, and errors over what is said of them."""
    start = time.process_time()
    fit = _fitted(model, one, shown, consensus)
    spent = (time.process_time() - start) / one.detections.frame_count
    true = measure(model.template(one.shape))
    rest, real = (model.vertices(each) for each in (fit.shape, one.shape))
    apart = (rest - rest.mean(0) - real + real.mean(0)).norm(dim=-1)
    missed = np.abs(np.subtract(astuple(fit.measurements), astuple(true)))
    values = 1000 * float(apart.mean()), 100 * missed[0], 100 * missed[1:4].mean(), spent
    return values, (missed / astuple(fit.deviations)).tolist()


def _fitted(model: BodyModel, one: Filmed, shown: bool, consensus: str) -> BodyFit:
    actor = model.actor(torch.zeros(0))
    unit = 0.01 * one.detections.box_heights()
    frames = FrameProblem(actor, one.cameras, one.detections, PoseConfig(), unit)
    initial, _ = initialize(prepare(frames))
    masks = PersonMasks(one.cameras, one.masks) if shown else None
    settings = ViewFitSettings(consensus=consensus)  # type: ignore[arg-type]
    return fit_body(model, one.cameras, one.detections, initial, masks, settings=settings)


if __name__ == "__main__":
    report.main(run, Experiment, "shape_over_time")
