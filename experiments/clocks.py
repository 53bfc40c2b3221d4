"""Views that are half a frame apart, and cameras that are some pixels off: solved with the motion.

Clips of the CMU library on which no setting was chosen, seen by several views of a simulated
detector; every second frame of 60 Hz, so that half a frame is a recorded one. Clocks differ by a
whole number of frames and a half; cameras are turned and shifted at random until the joints are
off by the stated pixels. The actor has somebody else's bones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cmu
import numpy as np
import report
import torch
from fast_motion import HELD_OUT, active, around, observed
from report import Report, Table
from torch import Tensor
from window_problem import bare_actor

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.geometry.triangulation import triangulate
from perfcap.pipeline.view_errors import ViewErrors, solve_views

_RATE = 30.0


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    views: tuple[int, ...] = (2, 4)
    """Numbers of views."""
    clips: int = 8
    """Of the library, at most."""
    frames: int = 120
    """Of a clip, at most."""
    pixels: float = 5.0
    """Error of calibration."""
    seed: int = 0
    """Of cameras, errors and noise."""


@dataclass(frozen=True)
class Take:
    """Views whose clocks and cameras are not as stated."""

    name: str
    stated: Camera
    real: Camera
    detections: Detections
    clock: Tensor
    truth: Tensor


def run(config: Experiment) -> Report:
    """Tables of clocks and of cameras."""
    torch.set_num_threads(1)
    actor = bare_actor(cmu.skeleton(config.data / "mocap_cmu_library", "01_01"))
    clocks, cameras, together = [], [], []
    for views in config.views:
        errors, shares, before = [], [], []
        for take in takes(config, views, late=True, moved=False):
            found = solve_views(actor, take.stated, take.detections, _RATE)
            errors += _apart(found, take)
            shares += _share(found, take)
            before.append(_millimetres(take, ViewErrors(), take.stated))
            before.append(_millimetres(take, found, take.stated))
        clocks.append((views, *_spread(errors), _root(shares), *_pairs(before)))
        kept, pixels = [], []
        for take in takes(config, views, late=False, moved=True):
            found = solve_views(actor, take.stated, take.detections, _RATE, sync=False, refine=True)
            pixels += [_pixels(take, take.stated), _pixels(take, found.of_cameras(take.stated))]
            kept += [_millimetres(take, each, take.stated) for each in (ViewErrors(), found)]
        cameras.append((views, *_pairs(pixels), *_pairs(kept)))
        both = []
        for take in takes(config, views, late=True, moved=True):
            found = solve_views(actor, take.stated, take.detections, _RATE, refine=True)
            both += _apart(found, take)
        together.append((views, *_spread(both)))
    about = ("error, median", "90 %", "largest")
    joints = ("joints as stated, mm", "as solved")
    return Report(
        (
            Table("clocks, frames", ("views", *about, "over stated", *joints), tuple(clocks), 3),
            Table("cameras", ("views", "as stated, px", "as solved ", *joints), tuple(cameras), 2),
            Table("clocks with wrong cameras, frames", ("views", *about), tuple(together), 3),
        ),
        (
            "Over stated: root mean square of error over deviation. Pixels: mean distance of true "
            "joints seen by the real and by the stated or solved cameras, after both were brought "
            "together. Joints: robust triangulation against the truth, about their middles.",
        ),
    )


def takes(config: Experiment, views: int, *, late: bool, moved: bool) -> Iterator[Take]:
    """Takes with clocks off by half a frame and more, cameras off by some pixels, or both."""
    root = report.data_folder(config.data, "mocap_cmu_library")
    for number, name in enumerate(HELD_OUT[: config.clips]):
        points = cmu.landmarks(root, name, 1)
        rng = np.random.default_rng([config.seed, number, views])
        halves = rng.choice([-5, -3, -1, 1, 3, 5], views) if late else np.zeros(views, int)
        halves[0] = 0
        count = (len(points) - 12) // 2
        each = [points[6 + h : 6 + h + 2 * count : 2] for h in halves]
        start = _start(each[0], config.frames)
        each = [part[start : start + config.frames] for part in each]
        real = around(each[0], views, rng)
        parts = [observed(part, real.select([view]), rng, None) for view, part in enumerate(each)]
        pixels = torch.cat([part.joints2d for part in parts], 1)
        sure = torch.cat([part.confidence2d for part in parts], 1)
        stated = _moved(real, each[0], config.pixels, rng) if moved else real
        # a view that shows what comes h half frames later shows frame f at f - h / 2
        clock = -torch.tensor(halves / 2)
        yield Take(name, stated, real, Detections.from_joints(pixels, sure), clock, each[0])


def _start(points: Tensor, frames: int) -> int:
    """First frame of the most active stretch."""
    stretch = active(points, frames)
    return int((points[:, 0] == stretch[0, 0]).all(-1).nonzero()[0])


def _moved(cameras: Camera, truth: Tensor, pixels: float, rng: np.random.Generator) -> Camera:
    """Cameras turned and shifted so that joints are off by so many pixels in the mean."""
    turn, shift = (torch.tensor(rng.normal(size=(cameras.views, 3))) for _ in range(2))

    def at(size: float) -> Camera:
        matrix = rotvec_to_matrix(0.002 * size * turn)
        place = (matrix @ cameras.translation[..., None])[..., 0] + 0.006 * size * shift
        return replace(cameras, rotation=matrix @ cameras.rotation, translation=place)

    apart = (at(1.0).project(truth) - cameras.project(truth)).norm(dim=-1).mean()
    return at(pixels / float(apart))


def _apart(found: ViewErrors, take: Take) -> list[float]:
    assert found.clock is not None
    return (found.clock - take.clock)[1:].abs().tolist()


def _share(found: ViewErrors, take: Take) -> list[float]:
    assert found.clock is not None and found.clock_deviation is not None
    return ((found.clock - take.clock) / found.clock_deviation.clamp(min=1e-9))[1:].tolist()


def _pixels(take: Take, cameras: Camera) -> float:
    """How far apart true joints lie in real and other cameras, which may lie elsewhere as one."""
    seen = take.real.project(take.truth)
    sure = torch.ones(seen.shape[:-1]).to(seen)
    points, _ = triangulate(cameras, cameras.to_plane(seen), sure)
    return float((cameras.project(points) - seen).norm(dim=-1).nanmean())


def _millimetres(take: Take, found: ViewErrors, stated: Camera) -> float:
    cameras, detections = found.of_cameras(stated), found.of_detections(take.detections)
    plane = cameras.to_plane(detections.joints2d)
    points, _ = triangulate(cameras, plane, detections.confidence2d)
    points, truth = points[5:-5], take.truth[5:-5]
    known = points.isfinite().all(-1).all(-1)
    middle, true = points[known].mean((0, 1)), truth[known].mean((0, 1))
    return 1000 * float((points[known] - middle - truth[known] + true).norm(dim=-1).mean())


def _spread(errors: list[float]) -> tuple[float, float, float]:
    found = np.abs(errors)
    return float(np.median(found)), float(np.quantile(found, 0.9)), float(found.max())


def _root(shares: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(shares))))


def _pairs(values: list[float]) -> tuple[float, float]:
    """Medians of the even and of the odd ones."""
    return float(np.median(values[::2])), float(np.median(values[1::2]))


if __name__ == "__main__":
    report.main(run, Experiment, "clocks")
