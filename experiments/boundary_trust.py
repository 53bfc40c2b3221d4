"""Is the confidence in boundaries of masks right? And its weights, fitted anew.

A boundary point is right where the true boundary is within half a percent of the person's size.
The weights of ``TrustSettings`` come from here: from the demo clip, which is ours with its truth;
from the same clip with noise in place of its pictures, which show nothing; and from masks of the
real man that were drawn by hand. What the rendered sequences say is printed beside, as a test.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import report
import torch
from numpy.typing import NDArray
from real_silhouettes import labels_of
from recordings import Recording, balancing, demo, demo_motion, rendered
from report import Report, Table
from scipy import ndimage, optimize, special
from surface_recordings import images_of, true_mask

from perfcap.actor.actor import Actor
from perfcap.pipeline.extract_silhouettes import SilhouetteSource
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.sight import Mask, Sight
from perfcap.pipeline.stage import Stage
from perfcap.segment import Segmentation, extract_contour
from perfcap.segment.trust import TrustSettings, boundary_clues, boundary_trust

_RIGHT = 0.005  # of the person's size
_BINS = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    every: int = 6
    """Look at every n-th frame of a rendered clip."""
    tests: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Rendered sequences that are only looked at."""


@dataclass(frozen=True)
class _Points:
    """Boundary points (N,): their clues (N, 4), trust, and whether they are right."""

    clues: Floats
    trust: Floats
    right: NDArray[np.bool_]

    @classmethod
    def join(cls, parts: list[_Points]) -> _Points:
        return cls(*(np.concatenate(p) for p in zip(*map(astuple, parts), strict=True)))


@dataclass(frozen=True)
class _Noise:
    """As many pictures as another reader has, which show nothing."""

    images: Images

    def __len__(self) -> int:
        return len(self.images.reader)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        size = self.images.cameras.size[view]
        frames = [np.random.default_rng([view, f]) for f in range(start, stop)]
        return np.stack([rng.integers(0, 256, (*size, 3), np.uint8) for rng in frames])


def run(config: Experiment) -> Report:
    """Fit the weights, and count how often boundaries of each confidence are right."""
    clip, real = demo(), balancing(config.data)
    shown, truth = images_of(clip), _drawn(clip)
    blank = Images(_Noise(shown), shown.cameras)
    frames = {0: range(0, clip.detections.frame_count, config.every)}
    labels = dict(enumerate(labels_of(images_of(real).cameras.size)))
    sources = {
        "demo": _points(clip, shown, frames, lambda _, f: truth(f)),
        "demo, noise for pictures": _points(clip, blank, frames, lambda _, f: truth(f)),
        "real man": _points(real, images_of(real), labels, lambda v, f: labels[v][f]),
    }
    fitted = _fit(list(sources.values()))
    for name in config.tests:
        test = rendered(config.data, name)
        every = {0: range(0, test.detections.frame_count, config.every)}
        sources[name] = _points(test, images_of(test), every, partial(_true, test))
    return Report((_reliability(sources), _weights(fitted)))


def _true(recording: Recording, view: int, frame: int) -> Mask:
    return true_mask(recording, frame)


def _points(
    recording: Recording,
    images: Images,
    frames: Mapping[int, Iterable[int]],
    truth: Callable[[int, int], Mask],
) -> _Points:
    """Boundary points of some frames of every view, from the motion before and after refinement."""
    silhouettes = CaptureConfig().silhouettes
    found = capture(
        recording.actor,
        recording.cameras,
        recording.detections,
        recording.rate,
        solve_bones=recording.cameras.views > 1,
    )
    passes = [(found.motion, silhouettes.first)]
    if recording.cameras.views == 1:  # the second pass, of one view for the sake of time
        refined = capture(
            recording.actor,
            recording.cameras,
            recording.detections,
            recording.rate,
            images=images,
            until=Stage.REFINE_POSE,
        )
        passes.append((refined.motion, silhouettes.again))
    sight = _sight(found.actor, images)
    parts = []
    for motion, settings in passes:
        source = SilhouetteSource(found.actor, sight, images.reader, motion, settings)
        for view, wanted in frames.items():
            chosen = set(wanted)
            for frame, segmentation in _segmentations(source, view, chosen):
                parts.append(_judge(segmentation, truth(view, frame)))
    return _Points.join(parts)


def _segmentations(
    source: SilhouetteSource, view: int, chosen: set[int]
) -> Iterator[tuple[int, Segmentation]]:
    """Of the chosen frames alone; blocks without one are not looked at."""
    with torch.no_grad():
        for block in source.blocks(view):
            if chosen.isdisjoint(block.wanted):
                continue
            for frame, found in zip(block.wanted, source.segment(block), strict=True):
                if frame in chosen:
                    yield frame, found


def _judge(found: Segmentation, truth: Mask) -> _Points:
    """What is known about the boundary of a mask, and where it is right."""
    line = extract_contour(found.mask)
    if not len(line.points):
        return _Points(np.zeros((0, 4)), np.zeros(0), np.zeros(0, np.bool_))
    edge = truth ^ ndimage.binary_erosion(truth)
    distance = ndimage.distance_transform_edt(~edge)
    columns, rows = np.rint(line.points).astype(int).T
    return _Points(
        boundary_clues(found, line.points, line.normals),
        boundary_trust(found, line.points, line.normals),
        distance[rows, columns] <= max(1.0, _RIGHT * found.trimap.size),
    )


def _drawn(recording: Recording) -> Callable[[int], Mask]:
    """Silhouettes of the demo's true motion."""
    images, motion = images_of(recording), demo_motion()
    sight = _sight(recording.actor, images)

    def mask(frame: int) -> Mask:
        span = slice(frame, frame + 1)
        return sight.look(recording.actor.surface(motion[span]), span)[0][0].mask

    return mask


def _sight(actor: Actor, images: Images) -> Sight:
    return Sight(
        images.cameras, torch.as_tensor(actor.template.faces.copy()), actor.template.weld()[0]
    )


def _fit(sources: list[_Points]) -> TrustSettings:
    """Logistic regression; every source counts as much as every other."""
    clues = np.concatenate([np.c_[p.clues, np.ones(len(p.right))] for p in sources])
    right = np.concatenate([p.right for p in sources])
    share = np.concatenate([np.full(len(p.right), 1 / len(p.right)) for p in sources])

    def loss(weights: Floats) -> tuple[float, Floats]:
        score = clues @ weights
        chance = special.expit(score)
        value = float(share @ (np.logaddexp(0, score) - right * score))
        return value, clues.T @ (share * (chance - right))

    weights = optimize.minimize(loss, np.zeros(5), jac=True, method="BFGS").x
    inside, outside, contrast, departure, offset = weights.tolist()
    return TrustSettings(inside, outside, contrast, departure, offset)


def _reliability(sources: Mapping[str, _Points]) -> Table:
    rows = []
    for name, points in sources.items():
        which = np.digitize(points.trust, _BINS[1:-1])
        cells = []
        for index in range(len(_BINS) - 1):
            hit = points.right[which == index]
            cells.append(
                f"{100 * hit.mean():.0f} ({100 * len(hit) / len(which):.0f})" if len(hit) else "-"
            )
        rows.append((name, *cells))
    columns = tuple(f"{a:g} to {b:g}" for a, b in itertools.pairwise(_BINS))
    title = "Boundary points that are right, % (and how many there are, %), by confidence"
    return Table(title, ("clip", *columns), tuple(rows))


def _weights(fitted: TrustSettings) -> Table:
    names = ("inside", "outside", "contrast", "departure", "offset")
    rows = (("fitted", *astuple(fitted)), ("shipped", *astuple(TrustSettings())))
    return Table("Weights", ("", *names), rows, digits=3)


if __name__ == "__main__":
    report.main(run, Experiment, "boundary_trust")
