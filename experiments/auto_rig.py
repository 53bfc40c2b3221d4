"""Rigging of bare meshes: weights and joints against known ones, and what they cost.

The clothed templates of the rendered sequences lose their bones and weights. With the true joints,
then with joints found by fitting a body, weights are computed and driven by the true motion; the
vertices are compared with those under the given weights. Joints are also found with a detector that
looks at the mesh and knows them, exactly or with errors, and in random bodies.
Expect a mean vertex error below 12 mm (tight) and 25 mm (skirt), joints within 25 mm.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
import report
import torch
from anny_people import People
from body_fit import true_measurements
from numpy.typing import NDArray
from report import DATA, Report, Table

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bare_mesh import BareMesh
from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements
from perfcap.actor.skinning import dual_quaternion_blend
from perfcap.actor.template import Template
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.onnx import OnnxDetector
from perfcap.geometry.camera import Camera
from perfcap.io.actor import models_folder
from perfcap.io.body_model import load_body_model
from perfcap.rigging import Upright, auto_rig, rig_with_joints
from perfcap.rigging.view_landmarks import JointDetector

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Experiment:
    """What to rig.

    Attributes:
        data: folder of the recordings.
        sequences: rendered ones, with a template, its weights and its motion.
        people: random bodies.
        every: frame of the motion that is scored.
        seed: of the bodies.
        noise: of the detector that errs, px, anew in every picture.
        offset: of its joints, metres, the same in all pictures.
        wrong: share of joints that it places anywhere.
    """

    data: Path = DATA
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    people: int = 20
    every: int = 5
    seed: int = 3
    noise: float = 3.0
    offset: float = 0.015
    wrong: float = 0.1


class Knowing:
    """A detector that is told where the landmarks are, and errs as told."""

    def __init__(self, places: Floats, noise: float, offset: float, wrong: float) -> None:
        self.rng = np.random.default_rng(0)
        self.noise, self.wrong = noise, wrong
        away = self.rng.normal(size=places.shape)
        self.places = places + offset * away / np.linalg.norm(away, axis=1, keepdims=True)

    def __call__(
        self, images: torch.Tensor, boxes: object = None, cameras: Camera | None = None
    ) -> Detections:
        """Landmarks in pictures (1, C, 3, H, W)."""
        assert cameras is not None
        pixels = cameras.project(torch.from_numpy(self.places)[None])[0].numpy()
        pixels = pixels + self.noise * self.rng.normal(size=pixels.shape)
        anywhere = self.rng.uniform(0, images.shape[-1], pixels.shape)
        lost = self.rng.uniform(size=pixels.shape[:2]) < self.wrong
        seen = torch.from_numpy(np.where(lost[..., None], anywhere, pixels))[None]
        return Detections.from_joints(seen, torch.ones(seen.shape[:-1]).to(seen))


@dataclass(frozen=True, eq=False)
class Dressed:
    """A template with its truth: weights (V, 16) and joints by the skeleton's names."""

    mesh: BareMesh
    joints: dict[str, Floats]
    weights: Floats
    transforms: torch.Tensor  # (F, 16, 4, 4)


def run(config: Experiment) -> Report:
    """Weights, joints, bodies."""
    model = load_body_model()
    weights, joints, told = [], [], []
    for name in config.sequences:
        dressed = _load(config, name)
        start = time.perf_counter()
        given, _ = rig_with_joints(dressed.mesh, dressed.joints)
        middle = time.perf_counter()
        found, fit = auto_rig(dressed.mesh, model)
        end = time.perf_counter()
        count = len(dressed.mesh.vertices)
        weights.append((name, "given", count, *_motion_error(dressed, given), middle - start))
        weights.append((name, "found", count, *_motion_error(dressed, found), end - middle))
        joints.append((name, *_joint_error(found, dressed.joints, fit.upright)))
        told += [(name, *row) for row in _with_detectors(config, model, dressed, fit.upright)]
    return Report(
        (
            Table(
                "Vertices under automatic weights and the true motion, mm from the given weights",
                ("template", "joints", "vertices", "mean", "95 %", "seconds"),
                tuple(weights),
            ),
            Table(
                "Joints found, mm from the true ones",
                ("template", "mean", "worst", "which"),
                tuple(joints),
            ),
            Table(
                "The same when a detector looks at the mesh as well",
                ("template", "detector", "landmarks", "mean", "worst", "which"),
                tuple(told),
            ),
            *_bodies(config, model),
        )
    )


def _load(config: Experiment, name: str) -> Dressed:
    folder = report.data_folder(config.data, "rendered", name)
    with np.load(folder / "template.npz") as t:
        places = {str(n): p for n, p in zip(t["joint_names"], t["joint_rest"], strict=True)}
        places |= {str(n): p for n, p in zip(t["rig_names"], t["rig_rest"], strict=True)}
        order = [[str(n) for n in t["rig_names"]].index(joint) for joint in JOINTS]
        mesh = BareMesh(t["vertices"].astype(float), t["faces"].astype(np.int64), name=name)
        weights = t["weights"][:, order].astype(float)
    with np.load(folder / "gt.npz") as truth:
        transforms = torch.tensor(truth["rig_transforms"][:: config.every, order]).double()
    return Dressed(mesh, places, weights, transforms)


def _motion_error(dressed: Dressed, template: Template) -> tuple[float, float]:
    """Mean and 95th percentile of the distance over vertices and frames, mm."""
    ours = template.dense_weights()[:, : len(JOINTS)]
    posed = [
        dual_quaternion_blend(
            torch.tensor(dressed.mesh.vertices),
            torch.tensor(weights),
            dressed.transforms[..., :3, :3],
            dressed.transforms[..., :3, 3],
        )
        for weights in (ours, dressed.weights)
    ]
    error = 1e3 * (posed[0] - posed[1]).norm(dim=-1).numpy()
    return float(error.mean()), float(np.quantile(error, 0.95))


def _joint_error(
    template: Template, truth: dict[str, Floats], upright: Upright | None
) -> tuple[float, float, str]:
    """Mean and largest distance over the joints that are known, mm, and the worst joint."""
    assert upright is not None
    names = [name for name in template.bone_names if name in truth]
    places = np.stack([truth[name] for name in names])
    found = np.stack([template.bone_rest[template.bone(name), :3, 3] for name in names])
    error = 1e3 * np.linalg.norm(found - upright.apply(places), axis=1)
    return float(error.mean()), float(error.max()), names[int(error.argmax())]


def _with_detectors(
    config: Experiment, model: BodyModel, dressed: Dressed, upright: Upright | None
) -> Iterator[tuple[str, int, float, float, str]]:
    """Joints with a detector that knows them, with one that errs, and with the one shipped."""
    assert upright is not None
    places = upright.apply(np.stack([dressed.joints[name] for name in LANDMARKS]))
    detectors: dict[str, JointDetector] = {
        "exact": Knowing(places, 0.0, 0.0, 0.0),
        "erring": Knowing(places, config.noise, config.offset, config.wrong),
        "shipped": OnnxDetector(models_folder() / "detectors" / "rendered"),
    }
    for kind, detector in detectors.items():
        found, fit = auto_rig(dressed.mesh, model, detector=detector)
        assert fit.seen is not None
        yield kind, fit.seen.found, *_joint_error(found, dressed.joints, fit.upright)


def _bodies(config: Experiment, model: BodyModel) -> tuple[Table, Table]:
    people, means, worst, seconds, missed = People(config.seed), [], [], [], []
    for number in range(config.people):
        person = people.draw()
        start = time.perf_counter()
        mesh = BareMesh(person.vertices, person.faces, name=f"body {number}")
        template, fit = auto_rig(mesh, model)
        seconds.append(time.perf_counter() - start)
        mean, largest, _ = _joint_error(template, person.joints, fit.upright)
        means.append(mean)
        worst.append(largest)
        assert fit.measurements is not None
        true = astuple(true_measurements(person))
        missed.append(100 * np.abs(np.subtract(astuple(fit.measurements), true)))
    row = (config.people, np.mean(means), np.max(means), np.max(worst), np.mean(seconds))
    columns = ("bodies", "mean", "worst body", "worst joint", "seconds")
    values = (row[0], *(float(value) for value in row[1:]))
    joints = Table(
        "Joints found in random bodies, arms at 25 to 85 degrees, mm", columns, (values,)
    )
    names = tuple(field.name for field in fields(Measurements))
    errors = (config.people, *(float(value) for value in np.mean(missed, 0)))
    return joints, Table("their measurements, mean error, cm", ("bodies", *names), (errors,))


if __name__ == "__main__":
    report.main(run, Experiment, "auto_rig")
