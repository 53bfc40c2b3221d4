"""Shape of people from calibrated views (Rhodin et al. 2016, Table 1: girths to 2.3 cm).

Random adults of the `anny` package turn in front of cameras. Joints are projected with noise,
silhouettes are drawn exactly; a body is fitted to a few frames. Girths are measured on the fitted
and on the true body by the same rules. Expect chest, waist and hip within 4 cm from one camera,
2.3 cm from two, 1.5 cm from four.
"""

from __future__ import annotations

import math
import time
from dataclasses import astuple, dataclass

import numpy as np
import report
import torch
from anny_people import People, Person
from report import Report, Table
from torch import Tensor

from perfcap.actor.bare_mesh import BareMesh
from perfcap.actor.measurements import Measurements, measure
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera, look_at
from perfcap.io.body_model import load_body_model
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging import BodyFit, PersonMasks, fit_body, rig_with_joints

SIZE, FOCAL, DISTANCE = (640, 640), 900.0, 3.2  # px, px, metres
NAMES = ("height", "chest", "waist", "hip", "inseam")


@dataclass(frozen=True)
class Experiment:
    """What to fit.

    Attributes:
        people: how many.
        frames: of each.
        views: numbers of cameras.
        noise: deviation of joints in the images, px.
        tell_height: whether the person's height is given.
        silhouettes: whether they are used.
        seed: of people and noise.
    """

    people: int = 8
    frames: int = 6
    views: tuple[int, ...] = (1, 2, 4)
    noise: float = 3.0
    tell_height: bool = True
    silhouettes: bool = True
    seed: int = 17


@dataclass(frozen=True, eq=False)
class Take:
    """Somebody seen by cameras."""

    cameras: Camera
    detections: Detections
    masks: Tensor  # (F, C, H, W)


def run(config: Experiment) -> Report:
    """All people from each number of cameras."""
    people = People(config.seed)
    who = [people.shape() for _ in range(config.people)]
    poses = [[people.pose(one, (-35.0, 10.0)) for _ in range(config.frames)] for one in who]
    truth = [true_measurements(frames[0]) for frames in poses]
    rows, honest = [], []
    for views in config.views:
        errors, shares, start = [], [], time.perf_counter()
        for frames, true in zip(poses, truth, strict=True):
            found = fitted(frames, views, true.height, config)
            missed = np.abs(np.subtract(astuple(found.measurements), astuple(true)))
            errors.append(100 * missed)
            shares.append(missed / astuple(found.deviations))
        mean = np.mean(errors, axis=0)
        said = np.sqrt(np.mean(np.square(shares), axis=0))
        honest.append((views, *(float(value) for value in said)))
        girths = float(mean[1:4].mean())
        seconds = (time.perf_counter() - start) / config.people
        rows.append((views, *(float(value) for value in mean), girths, seconds))
    columns = ("cameras", *NAMES, "girths", "seconds")
    spread = Table("Root mean square error over the stated one", columns[:-2], tuple(honest), 2)
    return Report((Table("Mean absolute error, cm", columns, tuple(rows), digits=2), spread))


def true_measurements(person: Person) -> Measurements:
    """Of the body at rest, whose joints are known; crown and toes only end its bones."""
    vertices = person.rest
    crown = vertices[vertices[:, 1].argmax()]
    joints = {**person.rest_joints, "head_top": crown}
    template, _ = rig_with_joints(BareMesh(vertices, person.faces), joints)
    return measure(template)


def fitted(frames: list[Person], views: int, height: float, config: Experiment) -> BodyFit:
    """A fit to some views."""
    take = film(frames, views, config)
    model = load_body_model()
    actor = model.actor(torch.zeros(0))
    unit = 0.01 * take.detections.box_heights()
    problem = FrameProblem(actor, take.cameras, take.detections, PoseConfig(), unit)
    initial, _ = initialize(prepare(problem))
    return fit_body(
        model,
        take.cameras,
        take.detections,
        initial,
        PersonMasks(take.cameras, take.masks) if config.silhouettes else None,
        height if config.tell_height else None,
    )


def film(frames: list[Person], views: int, config: Experiment) -> Take:
    """The person turns a little from frame to frame; cameras stand around."""
    cameras = ring(views)
    random = torch.Generator().manual_seed(config.seed)
    masks, joints = [], []
    for number, person in enumerate(frames):
        turn = rotation_about_y(2 * math.pi * number / len(frames))
        middle = 0.5 * (person.joints["l_hip"] + person.joints["r_hip"])
        vertices = torch.from_numpy((person.vertices - middle) @ turn.T)
        crown = person.vertices[person.vertices[:, 1].argmax()]
        known = {**person.joints, "head_top": crown}
        places = torch.from_numpy((np.stack([known[n] for n in LANDMARKS]) - middle) @ turn.T)
        joints.append(cameras.project(places[None])[0])
        faces = torch.from_numpy(person.faces)
        seen = [
            ProjectedMesh.seen_by(cameras.select([view]), vertices, faces).rasterize().mask
            for view in range(views)
        ]
        masks.append(torch.stack(seen))
    exact = torch.stack(joints)
    noisy = exact + config.noise * torch.randn(exact.shape, generator=random, dtype=exact.dtype)
    detections = Detections.from_joints(noisy, torch.ones(noisy.shape[:-1]).to(noisy))
    return Take(cameras, detections, torch.stack(masks))


def ring(views: int) -> Camera:
    """Cameras at chest height; two look square to each other."""
    step = math.pi / 2 if views == 2 else 2 * math.pi / views
    turn = step * torch.arange(views, dtype=torch.float64)
    eye = torch.stack((DISTANCE * turn.sin(), 0.2 + 0 * turn, DISTANCE * turn.cos()), -1)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    rotation, translation = look_at(eye, torch.zeros(3, dtype=torch.float64), up)
    middle = (SIZE[0] - 1) / 2
    intrinsics = torch.tensor([[FOCAL, 0, middle], [0, FOCAL, middle], [0, 0, 1]]).double()
    return Camera(intrinsics.repeat(views, 1, 1), rotation, translation, size=(SIZE,) * views)


def rotation_about_y(angle: float) -> np.ndarray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])


if __name__ == "__main__":
    report.main(run, Experiment, "body_fit")
