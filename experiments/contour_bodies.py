"""Bodies from the edges of raw images: girths, and captures of people without a template.

Random adults of the `anny` package, painted with clutter before other clutter, in A-poses; expect
girths within 1.5 cm. Rendered people in several views, clothed; expect girths within 1.7 cm from
six views, joints, offsets of the first frame removed, within 15, 18, 28 mm from six, four, two.
A real man, overlap with outlines drawn by hand; expect a precision of 92, a recall of 88 %. Nothing
of these chose a setting but the number of frames (12, as for silhouettes).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np
import report
import torch
from anny_people import People, Person
from body_fit import Experiment as Ring
from body_fit import Take, film, rotation_about_y, true_measurements
from contours import Seen, captured, edge_network, overlap_row, read
from numpy.typing import NDArray
from real_silhouettes import labels_of
from recordings import balancing
from report import Report, Table
from surface_recordings import clip_of
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.body_model import BodyModel
from perfcap.actor.measurements import Measurements, measure
from perfcap.actor.shape_space import ShapeSpace
from perfcap.app.fit_views import ChosenFrames, fit_person
from perfcap.io.body_model import load_body_model
from perfcap.metrics import mask_overlap
from perfcap.pipeline.body_contours import BodyContours
from perfcap.pipeline.bone_lengths import spread_frames
from perfcap.pipeline.images import Images
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.prepare import prepare
from perfcap.render import ProjectedMesh, Texture, rasterize, render
from perfcap.rigging import PersonMasks, fit_body
from perfcap.train.backgrounds import Backgrounds

_VIEWS = {6: (0, 1, 2, 3, 4, 5), 4: (0, 1, 3, 4), 2: (0, 3)}
_FRAMES = 12  # that a body is fitted to
_PAINT = 512  # px

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    people: int = 8
    """Random adults; 0 to go without."""
    components: tuple[int, ...] = (5, 10, 20)
    """Of their shapes, that are fitted from three views."""
    sequences: tuple[str, ...] = ("dev_views",)
    """Of ``rendered_multi``."""
    real: bool = True
    """Also the real man."""
    seed: int = 17
    """Of people and clutter."""


def run(config: Experiment) -> Report:
    """All tables."""
    torch.set_num_threads(1)
    tables = _adults(config) if config.people else []
    rows = [row for name in config.sequences for row in _recorded(config, name)]
    columns = (
        "sequence", "views", "body from", "height, cm", "chest", "waist", "hip", "girths",
        "fit, CPU s", "joints, mm", "95 %", "with contours", "95 % ", "precision, %", "recall, %",
        "with contours ", "recall, % ",
    )  # fmt: skip
    tables.append(Table("clothed people without a template", columns, tuple(rows)))
    if config.real:
        measured = ("body from", "views", "height, cm", "precision %", "recall %", "IoU %")
        tables.append(Table("a real man, outlines by hand", measured, tuple(_real(config))))
    note = (
        "Errors of measurements: mean size of people, signed of single ones. Joints: as captured, "
    )
    return Report(tuple(tables), (note + "offset of each joint in the first frame removed.",))


# --- Random adults --------------------------------------------------------------------------------


def _adults(config: Experiment) -> list[Table]:
    people = People(config.seed)
    who = [people.shape() for _ in range(config.people)]
    poses = [[people.pose(one, (-35.0, 10.0)) for _ in range(6)] for one in who]
    rows, fewer = [], []
    for views in (2, 3, 6):
        kinds = ["joints", "contours", "masks"]
        kinds += [str(count) for count in config.components] if views == 3 else []
        errors: dict[str, list[NDArray[np.float64]]] = {kind: [] for kind in kinds}
        for number, frames in enumerate(poses):
            rng = np.random.default_rng([config.seed, number])
            true = np.array(astuple(true_measurements(frames[0])))
            take = film(frames, views, Ring(seed=config.seed + number))
            shown = _Painted(frames, take, rng)
            for kind, missed in errors.items():
                found = _fitted(take, shown, kind)
                missed.append(100 * (np.array(astuple(found)) - true))
        for kind, missed in errors.items():
            size = np.abs(missed)
            girths = size[:, 1:4].mean(1)
            row = (kind, *size.mean(0)[:4], girths.mean(), girths.std())
            if kind.isdecimal():
                fewer.append(row)
            else:
                rows.append((views, *row))
    names = ("height", "chest", "waist", "hip", "girths", "± people")
    errors_of = "mean absolute errors, cm"
    return [
        Table(f"random adults: {errors_of}", ("views", "fitted to", *names), tuple(rows), 2),
        Table(f"from contours, three views: {errors_of}", ("components", *names), tuple(fewer), 2),
    ]


class _Painted:
    """Images of a take: the person and the background are covered with clutter."""

    def __init__(self, frames: Sequence[Person], take: Take, rng: np.random.Generator) -> None:
        rest, faces = frames[0].rest, torch.from_numpy(frames[0].faces)
        flat = torch.from_numpy((rest[:, :2] - rest[:, :2].min(0)) / np.ptp(rest[:, 1])).float()
        paint = torch.from_numpy(Backgrounds().draw(_PAINT, rng))
        texture = Texture.from_image(paint, flat, faces)
        self.views: list[Picture] = []
        for view in range(take.cameras.views):
            camera = take.cameras.select([view])
            behind = torch.from_numpy(Backgrounds().draw(camera.size[0][0], rng))
            shots = []
            for number, person in enumerate(frames):
                turn = rotation_about_y(2 * np.pi * number / len(frames))
                middle = 0.5 * (person.joints["l_hip"] + person.joints["r_hip"])
                vertices = torch.from_numpy((person.vertices - middle) @ turn.T).float()
                mesh = ProjectedMesh.seen_by(camera, vertices, faces)
                drawn = render(mesh, texture, behind).image.reshape(behind.shape).numpy()
                noisy = drawn + rng.normal(0, 2, drawn.shape)
                shots.append(noisy.clip(0, 255).astype(np.uint8))
            self.views.append(np.stack(shots))

    def __len__(self) -> int:
        return len(self.views[0])

    def read_view(self, view: int, start: int, stop: int) -> Picture:
        """RGB frames of a view."""
        return self.views[view][start:stop]


def _fitted(take: Take, shown: _Painted, kind: str) -> Measurements:
    model, cameras, seen = load_body_model(), take.cameras, take.detections
    if kind.isdecimal():
        surface, bones = (
            ShapeSpace(space.mean, space.basis[: int(kind)])
            for space in (model.surface, model.bones)
        )
        model, kind = BodyModel(surface, bones, model.rig), "contours"
    actor = model.actor(torch.zeros(0))
    problem = replace(FrameProblem.of(actor, cameras, seen), pixel_unit=0.01 * seen.box_heights())
    initial, _ = initialize(prepare(problem))
    masks = PersonMasks(cameras, take.masks) if kind == "masks" else None
    edges = BodyContours(Images(shown, cameras), seen.box_heights()) if kind == "contours" else None
    with torch.no_grad():
        found = fit_body(model, cameras, seen, initial, masks, contours=edges)
    return found.measurements


# --- Rendered and real people ---------------------------------------------------------------------


def _recorded(config: Experiment, name: str) -> list[tuple[object, ...]]:
    whole = read(name, config.data)
    rows: list[tuple[object, ...]] = []
    truth = whole.recording.truth
    true = np.array(astuple(measure(whole.recording.actor.template)))
    for count, views in _VIEWS.items():
        seen = whole.select(views)
        for kind in ("joints", "contours", "exact masks"):
            actor, spent = _body(seen, kind)
            missed = 100 * (np.array(astuple(measure(actor.template))) - true)
            girths = float(np.abs(missed[1:4]).mean())
            own = replace(seen, recording=replace(seen.recording, actor=actor))
            alone, contours = captured(own, None), captured(own, "rhodin2016")
            overlaps = list(overlap_row(own, [alone, contours]))[:4]
            errors = [settled(each.joints(), truth) for each in (alone, contours)]
            cells = [f(e) for e in errors for f in (_mean, _most)]
            row = (*missed[:4], girths, spent, *cells, *overlaps)
            rows.append((name, count, kind, *(float(cell) for cell in row)))
    return rows


def _body(seen: Seen, kind: str) -> tuple[Actor, float]:
    """Somebody's body, and CPU seconds of the fit."""
    own = seen.recording
    frames = spread_frames(own.detections, _FRAMES)
    chosen = ChosenFrames(
        seen.images.reader,  # type: ignore[arg-type]
        tuple(frames.tolist()),
        seen.images.cameras.frames(frames),
        own.detections.frames(frames),
    )
    some, masks = _Spread(chosen), None
    if kind == "exact masks":
        index = frames.numpy()
        views = [torch.from_numpy(each[index] == seen.person) for each in seen.labels]
        masks, kind = PersonMasks.padded(some.cameras, views), "silhouettes"
    start = time.process_time()
    fit, _ = fit_person(load_body_model(), some, masks=masks, evidence=kind)  # type: ignore[arg-type]
    spent = time.process_time() - start
    return Actor(fit.template).to(torch.zeros((), dtype=torch.float64)), spent


class _Spread:
    """Chosen frames of any reader."""

    def __init__(self, chosen: ChosenFrames) -> None:
        self.frames, self.reader = chosen.frames, chosen.clip
        self.cameras, self.detections = chosen.cameras, chosen.detections

    def __len__(self) -> int:
        return len(self.frames)

    def read_view(self, view: int, start: int, stop: int) -> Picture:
        """RGB frames of a view."""
        shots = [self.reader.read_view(view, f, f + 1)[0] for f in self.frames[start:stop]]
        return np.stack(shots)


def settled(joints: Tensor, truth: Tensor) -> Tensor:
    """Distances (F, 16) mm without the offset of each joint in the first frame."""
    apart = joints - truth
    size: Tensor = 1000 * (apart - apart[:1]).norm(dim=-1)
    return size


def _mean(error: Tensor) -> float:
    return float(error.mean())


def _most(error: Tensor) -> float:
    return float(error.quantile(0.95))


def _real(config: Experiment) -> list[tuple[object, ...]]:
    real = balancing(config.data)
    rows: list[tuple[object, ...]] = []
    clip, pixel_map = clip_of(real)
    labels = labels_of(clip.sizes)
    cameras = pixel_map.cameras(real.cameras, clip.sizes)
    seen = replace(real.detections, joints2d=pixel_map.to_video(real.detections.joints2d))
    recording = replace(real, rig=replace(real.rig, cameras=cameras), detections=seen)
    none = [np.zeros(0, np.uint8)] * real.cameras.views  # outlines are of single frames
    whole = Seen(recording, Images(clip, cameras, edges=edge_network()), none, 1)
    for views in ((0, 1, 2, 3), (0, 1), (0, 2)):
        some = whole.select(views)
        for kind in ("joints", "contours"):
            actor, _ = _body(some, kind)
            own = replace(some, recording=replace(some.recording, actor=actor))
            found = captured(own, "rhodin2016")
            scores = _overlap(found, own.images, [labels[view] for view in views])
            tall = 100 * measure(actor.template).height
            names = " ".join(str(view + 1) for view in views)
            rows.append((kind, names, tall, *scores))
    return rows


def _overlap(
    found: Performance, images: Images, labels: list[dict[int, NDArray[np.bool_]]]
) -> list[float]:
    """Precision, recall and IoU with masks by hand, %."""
    faces, scores = torch.tensor(found.actor.template.faces), []
    for view, masks in enumerate(labels):
        for frame, mask in masks.items():
            local = images.cameras.to_camera(found.shown[frame : frame + 1])[0]
            pixels = images.cameras.project_camera(local)
            size = images.cameras.size[view]
            drawn = rasterize(pixels[view], local[view, :, 2], faces, size).mask.numpy()
            each = mask_overlap(drawn, mask > 0)
            scores.append((each.precision, each.recall, each.iou))
    return [100 * float(value) for value in np.mean(scores, 0)]


if __name__ == "__main__":
    report.main(run, Experiment, "contour_bodies")
