"""The body of a real man in four views: height, bones, and what silhouettes say of his height.

His recording's configuration says 1.72 m, a default that nobody checked. Bones are compared with
those triangulated from the same joints. For each height that is assumed, the body is fitted anew
to masks drawn by hand (of joints alone and of the segmentation with ``perfcap actor fit``).
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
import report
import torch
from real_silhouettes import labels_of
from recordings import Recording, balancing
from report import Report, Table
from surface_recordings import clip_of

from perfcap.actor.body_model import BodyModel
from perfcap.actor.shaped_points import ShapedPoints
from perfcap.app.fit_views import ChosenFrames, fit_person
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.body_model import load_body_model
from perfcap.metrics import mask_overlap
from perfcap.render.projected_mesh import ProjectedMesh
from perfcap.rigging import BodyFit, PersonMasks

BONES = {
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
    "humerus": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}


@dataclass(frozen=True)
class Experiment:
    """What to fit."""

    data: Path = report.DATA
    """Folder of the recordings."""
    heights: tuple[float, ...] = (1.72, 1.75, 1.78, 1.81)
    """Assumed, metres."""
    every: int = 2
    """Of the twelve frames whose masks were drawn."""
    thirds: bool = True
    """Also from each third of the clip alone."""


def run(config: Experiment) -> Report:
    """Fit with every height."""
    real, model = balancing(config.data), load_body_model()
    chosen, masks = _drawn(real, config.every)
    joints, _ = fit_person(model, chosen, evidence="joints")
    found = {"joints": joints, "joints and masks": fit_person(model, chosen, None, masks)[0]}
    rows = [(name, *_sizes(fit)) for name, fit in found.items()]
    overlap = [("none", *_overlap(model, found["joints and masks"], chosen, masks))]
    for height in config.heights:
        fit, _ = fit_person(model, chosen, height, masks)
        overlap.append((f"{height:.2f} m", *_overlap(model, fit, chosen, masks)))
    bones = [(name, *_bones(real, fit)) for name, fit in found.items()]
    views = ("height given", *real.rig.names, "mean")
    sizes = ("fitted to", "height", "±", "chest", "waist", "hip", "inseam")
    return Report(
        (
            Table("measurements, cm", sizes, tuple(rows)),
            Table(
                "bones less the triangulated, left / right, cm", ("fitted to", *BONES), tuple(bones)
            ),
            Table("IoU with masks drawn by hand, %", views, tuple(overlap), digits=2),
            *([_thirds(real, model)] if config.thirds else []),
        )
    )


def _thirds(real: Recording, model: BodyModel) -> Table:
    """The same man from disjoint thirds of the clip, ten frames each."""
    clip, pixel_map = clip_of(real)
    cameras, rows = pixel_map.cameras(real.cameras, clip.sizes), []
    third = real.detections.frame_count // 3
    for kind in ("joints", "contours", "silhouettes"):
        found = []
        for start in range(0, 3 * third, third):
            frames = torch.arange(start, start + third, 2)
            some = real.detections.frames(frames)
            pixels = pixel_map.to_video(some.joints2d)
            detections = Detections.from_joints(pixels, some.confidence2d)
            chosen = ChosenFrames(clip, tuple(frames.tolist()), cameras.frames(frames), detections)
            fit, _ = fit_person(model, chosen, evidence=kind)
            found.append([100 * value for value in astuple(fit.measurements)])
            known = [100 * value for value in astuple(fit.deviations)]
        rows.append((kind, *np.ptp(found, 0).tolist(), *known[:2]))
    names = ("height", "chest", "waist", "hip", "inseam")
    columns = ("fitted to", *names, "stated ± of height", "of chest")
    return Table("largest difference between thirds of the clip, cm", columns, tuple(rows))


def _drawn(real: Recording, every: int) -> tuple[ChosenFrames, PersonMasks]:
    """The frames whose masks were drawn by hand, in pixels of the videos."""
    clip, pixel_map = clip_of(real)
    labels = labels_of(clip.sizes)
    frames = sorted(labels[0])[::every]
    cameras = pixel_map.cameras(real.cameras, clip.sizes)
    some = real.detections.frames(torch.tensor(frames))
    pixels = pixel_map.to_video(some.joints2d)
    detections = Detections.from_joints(pixels, some.confidence2d)
    views = [torch.from_numpy(np.stack([view[f] for f in frames])) for view in labels]
    chosen = ChosenFrames(clip, tuple(frames), cameras, detections)
    return chosen, PersonMasks.padded(cameras, views)


def _sizes(fit: BodyFit) -> tuple[float, ...]:
    height, *girths = (100 * value for value in astuple(fit.measurements))
    return height, 100 * fit.deviations.height, *girths


def _bones(real: Recording, fit: BodyFit) -> tuple[str, ...]:
    place = {
        n: fit.template.bone_rest[fit.template.bone(n), :3, 3] for n in fit.template.bone_names
    }
    cells = []
    for ends in BONES.values():
        missed = []
        for side in "lr":
            a, b = (f"{side}_{end}" for end in ends)
            seen = real.truth[:, LANDMARKS.index(a)] - real.truth[:, LANDMARKS.index(b)]
            length = float(seen.norm(dim=-1).nanmedian())
            missed.append(100 * (float(np.linalg.norm(place[a] - place[b])) - length))
        cells.append(f"{missed[0]:+.1f} / {missed[1]:+.1f}")
    return tuple(cells)


def _overlap(
    model: BodyModel, fit: BodyFit, chosen: ChosenFrames, masks: PersonMasks
) -> tuple[float, ...]:
    surface = ShapedPoints.of_surface(model, model.actor(torch.zeros(0)))
    faces = torch.from_numpy(model.rig.faces)
    bodies = surface(fit.motion)
    means = []
    for view in range(chosen.cameras.views):
        camera, iou = masks.cameras.select([view]), []
        for vertices, mask in zip(bodies, masks.inside[:, view].numpy(), strict=True):
            drawn = ProjectedMesh.seen_by(camera, vertices, faces).rasterize().mask.numpy()
            iou.append(100 * mask_overlap(drawn, mask).iou)
        means.append(float(np.mean(iou)))
    return (*means, float(np.mean(means)))


if __name__ == "__main__":
    report.main(run, Experiment, "real_body")
