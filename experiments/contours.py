"""Motion from raw images without background or masks: joints, silhouettes, time (Rhodin 2016)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from contour_pictures import save_pictures
from numpy.typing import NDArray
from recordings import Recording, rendered_views, stored_image
from report import Report, Table

from perfcap.actor.volume import GaussianCentres
from perfcap.actor.volume_fit import Silhouettes, VolumeFit, fit_volume
from perfcap.app.networks import find_edge_network
from perfcap.energy.density_contour import DensityContour
from perfcap.io.clip import Clip
from perfcap.metrics import mask_overlap
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.presets import PRESETS
from perfcap.pipeline.refine_contours import ContourSight
from perfcap.pipeline.stage import Stage
from perfcap.render import rasterize
from perfcap.segment.edge_network import EdgeNetwork
from perfcap.temporal.window import Window

VIEWS = {6: (0, 1, 2, 3, 4, 5), 4: (0, 1, 3, 4), 2: (0, 3)}
_EVERY = 6  # frames between those whose silhouettes are compared
_RUNS = 15  # of what is timed, the first of which compiles

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_views", "dev_duo/1", "dev_duo/2", "dev_dance")
    """Of ``rendered_multi``; a person of several by number."""
    views: tuple[int, ...] = (6, 4, 2)
    """Numbers of views; of sequences with one person all of these, of others the first."""
    masks: bool = False
    """Also capture with silhouettes and plates, for what they gain."""
    edges: str = "learned"
    """How edges are weighed: as by ``perfcap capture --edges``."""
    pictures: bool = False
    """Write volumes, contours and edges of a frame in every view beside the numbers."""


@dataclass(frozen=True)
class Seen:
    """A recording in some of its views, with images and label maps, which are for scoring alone."""

    recording: Recording
    images: Images
    labels: list[NDArray[np.uint8]]
    person: int

    def select(self, views: Sequence[int]) -> Seen:
        """Some of the views."""
        own, kept = self.recording, list(views)
        detections = own.detections.select(kept)
        recording = replace(own, rig=own.rig.select(kept), detections=detections)
        own_images = self.images
        images = replace(
            own_images,
            reader=_Views(own_images.reader, kept),
            cameras=own_images.cameras.select(kept),
        )
        return replace(
            self, recording=recording, images=images, labels=[self.labels[v] for v in kept]
        )


@dataclass(frozen=True)
class _Views:
    """Some views of a reader."""

    reader: object
    views: list[int]

    def __len__(self) -> int:
        return len(self.reader)  # type: ignore[arg-type]

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        found: NDArray[np.uint8] = self.reader.read_view(self.views[view], start, stop)  # type: ignore[attr-defined]
        return found


def run(config: Experiment) -> Report:
    """All tables."""
    joints, overlaps = [], []
    for name in config.sequences:
        seen = read(name, config.data, config.edges)
        several = "/" in name
        for count in config.views[: 1 if several else None]:
            some = seen.select(VIEWS[count])
            found = [captured(some, stage) for stage in (None, "rhodin2016")]
            found += [captured(some, "default")] if config.masks else []
            joints.append((name, count, *_joint_row(some, found)))
            overlaps.append((name, count, *overlap_row(some, found[:2])))
            if config.pictures:
                save_pictures(some, found[1], f"{name.replace('/', '_')}_{count}")
    columns = ("sequence", "views", *(f"{who} {what}" for who in ("joints alone:", "contours:")
               for what in ("mean", "median", "95 %")), *(("masks: mean", "share without")
               if config.masks else ()))  # fmt: skip
    shares = ("sequence", "views", "joints alone: precision", "recall", "contours: precision",
              "recall", "support before", "after", "stage, s")  # fmt: skip
    tables = (
        Table("distance of joints to the truth, mm", columns, tuple(joints)),
        Table("overlap of the skinned template with true silhouettes, %", shares, tuple(overlaps)),
        _volumes(config),
        _speed(config),
    )
    note = "Two of four views are 1 and 4; four of them 1, 2, 4 and 5. Tuned on contour_takes.py."
    return Report(tables, (note,))


def read(name: str, data: Path, edges: str = "learned") -> Seen:
    """A sequence, or one of its people as ``name/person``, and what weighs its edges."""
    folder, _, number = name.partition("/")
    person = int(number or 1)
    recording = rendered_views(data, folder, person)
    files = sorted((recording.folder / "views").glob("*.mp4"))
    clip = Clip.open([str(file) for file in files])
    frames, size = len(recording.truth), clip.sizes[0]
    maps = [stored_image(p).reshape(frames, *size)
            for p in sorted((recording.folder / "labels").glob("*.png"))]  # fmt: skip
    images = Images(clip, recording.cameras, edges=edge_network(edges))
    return Seen(recording, images, maps, person)


def edge_network(name: str = "learned") -> EdgeNetwork | None:
    """What weighs edges, as ``perfcap capture --edges`` names it."""
    weights = find_edge_network(name)
    return None if weights is None else EdgeNetwork.load(weights)


def captured(seen: Seen, preset: str | None) -> Performance:
    own = seen.recording
    given = own.actor, own.cameras, own.detections, own.rate
    if preset is None:
        return capture(*given)
    until = Stage.REFINE_POSE
    return capture(*given, PRESETS[preset], images=seen.images, until=until, workers=1)


def _joint_row(seen: Seen, found: Sequence[Performance]) -> Iterator[float]:
    errors = [1000 * (each.joints() - seen.recording.truth).norm(dim=-1) for each in found]
    for error in errors[:2]:
        yield from (float(error.mean()), float(error.median()), float(error.quantile(0.95)))
    if len(errors) > 2:
        start, ours, masks = (float(error.mean()) for error in errors)
        yield masks
        yield 100 * (start - ours) / (start - masks)


def overlap_row(seen: Seen, found: Sequence[Performance]) -> Iterator[float]:
    faces = torch.tensor(seen.recording.actor.template.faces)
    for performance in found:
        scores = []
        for frame in range(0, performance.frames, _EVERY):
            surface = performance.shown[frame : frame + 1]
            local = seen.images.cameras.to_camera(surface)[0]
            pixels = seen.images.cameras.project_camera(local)
            for view, labels in enumerate(seen.labels):
                size = seen.images.cameras.size[view]
                drawn = rasterize(pixels[view], local[view, :, 2], faces, size).mask.numpy()
                # what somebody else hides is nobody's mistake
                other = ~np.isin(labels[frame], (0, seen.person))
                overlap = mask_overlap(drawn & ~other, labels[frame] == seen.person)
                scores.append((overlap.precision, overlap.recall))
        yield from (100 * float(each) for each in np.mean(scores, 0))
    contours = found[1].contours
    assert contours is not None
    yield from (100 * float(contours.before.mean()), 100 * float(contours.after.mean()))
    yield next(stage.cpu for stage in found[1].stages if stage.name == "refine_contours")


def _volumes(config: Experiment) -> Table:
    rows = []
    for name in config.sequences:
        folder, _, number = name.partition("/")
        actor = rendered_views(config.data, folder, int(number or 1)).actor.double()
        for count in (91, 200):
            start = time.process_time()
            volume = fit_volume(actor, count)
            spent = time.process_time() - start
            sides = [replace(VolumeFit(height=400, views=6), poses=poses) for poses in (0, 4)]
            rest, posed = (
                Silhouettes(actor, each, np.random.default_rng(5)).overlap(volume) for each in sides
            )
            values = (100 * float(np.mean(rest)), 100 * min(rest), 100 * float(np.mean(posed[6:])))
            rows.append((name, count, *values, spent))
    columns = ("actor", "Gaussians", "six rest views", "least", "unseen poses", "CPU s")
    return Table("overlap of the volume with the mesh, %", columns, tuple(rows))


def _speed(config: Experiment) -> Table:
    """Value, slope and curvature of the energy, CPU milliseconds a view and frame."""
    seen = read(config.sequences[0], config.data).select(VIEWS[6])
    own = seen.recording
    found = capture(own.actor, own.cameras, own.detections, own.rate)
    settings = PRESETS["rhodin2016"].contours
    volume = fit_volume(found.actor)
    points = GaussianCentres(found.actor.skeleton, volume)
    window, rows = Window(0, 10), []
    centres = points(found.motion[window.index])
    tall = own.detections.person_height()
    for height in (settings.height, 480.0, 900.0):
        factor = float(height / tall.median())
        images = Images(_Enlarged(seen.images.reader, max(1.0, factor)), seen.images.cameras)
        cameras = images.cameras
        if factor > 1:
            size = tuple((round(h * factor), round(w * factor)) for h, w in cameras.size)
            lens = cameras.intrinsics * cameras.intrinsics.new_tensor([[factor], [factor], [1.0]])
            images = Images(images.reader, replace(cameras, intrinsics=lens, size=size))
        sight = ContourSight.of(
            images, tall * max(1.0, factor), replace(settings, height=height), tall
        )
        fields = sight.fields(centres, volume, window)
        energy = DensityContour(points, volume, sight.cameras, fields, 1.0, sight.unit)
        spent = []
        for _ in range(_RUNS):
            start = time.process_time()
            energy.expand(centres)
            spent.append(time.process_time() - start)
        shape = np.mean([each.flat.shape for row in fields for each in row], 0)
        each = 1000 * float(np.median(spent)) / 60
        rows.append((int(height), f"{shape[0]:.0f} x {shape[1]:.0f}", each))
    columns = ("person, px", "mean crop", "ms")
    return Table("energy, slope and curvature, CPU a view and frame", columns, tuple(rows), 2)


@dataclass(frozen=True)
class _Enlarged:
    """Larger images of a reader."""

    reader: object
    factor: float

    def __len__(self) -> int:
        return len(self.reader)  # type: ignore[arg-type]

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        images = self.reader.read_view(view, start, stop)  # type: ignore[attr-defined]
        if self.factor == 1:
            return images  # type: ignore[no-any-return]
        size = [round(side * self.factor) for side in images.shape[1:3]]
        return np.stack([cv2.resize(image, size[::-1]) for image in images])


if __name__ == "__main__":
    report.main(run, Experiment, "contours")
