"""What samples of poses, shapes and colours say about who is where (Liu et al. 2013, Fig. 13, 14).

The foreground is found once for each frame and view; what differs is how it is given to people.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
from numpy.typing import NDArray
from people_labels import CONTESTED, Take, score, seen_of, shares
from report import RESULTS, Report, Table

from perfcap.pipeline.extract_people import PeopleSource, Seen
from perfcap.pipeline.overlay import COLORS
from perfcap.pipeline.stage import Stage
from perfcap.segment import Segmentation, SequenceSettings
from perfcap.segment.label_people import PeopleSettings, Prior, label_people
from perfcap.segment.person_layer import PersonLayer, Plane
from perfcap.segment.shape_samples import ShapeSamples
from perfcap.segment.trimap import Box, Mask

_CLOSED, _COLORS = "closed form", "colours alone"


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins")
    """Of ``rendered_multi``."""
    counts: tuple[int, ...] = (25, 50, 100, 200, 300, 400)
    """Samples (LIU-E4)."""
    every: int = 6
    """Frames between those that are labelled, in all views."""
    parts: bool = True
    """Also compare weights, projections and meshes, and what shapes and colours say alone."""
    pictures: bool = False
    """Write the priors of one frame in all views beside the numbers."""


@dataclass(frozen=True)
class Method:
    """How a foreground is given to people."""

    name: str
    samples: ShapeSamples | None = None
    shape: bool = True
    colors: bool = True


def methods(config: Experiment) -> list[Method]:
    """By number of samples, then by what is asked."""
    best, paper = ShapeSamples(), ShapeSamples(center="previous")
    found = [Method(_CLOSED)]
    for count in config.counts:
        found.append(Method(f"solved pose, n = {count}", replace(best, count=count)))
        found.append(Method(f"previous pose, n = {count}", replace(paper, count=count)))
    if not config.parts:
        return found
    found.append(Method(_CLOSED + ", no colours", colors=False))
    found.append(Method(_COLORS, shape=False))
    for name, each in (("solved pose", best), ("previous pose", paper)):
        found.append(Method(f"{name}, no colours", each, colors=False))
        half = replace(each, effective=0.3)
        found.append(Method(f"{name}, weighed, 30 % effective", half))
        found.append(Method(f"{name}, weighed as published", replace(each, effective=0.0)))
        found.append(Method(f"{name}, one projection", replace(each, culled=False)))
    found.append(
        Method("solved pose, all of the mesh, n = 100", replace(best, cell=0.0, count=100))
    )
    return found


def run(config: Experiment) -> Report:
    """One table."""
    rows: list[tuple[object, ...]] = []
    for name in config.sequences:
        take = Take.read(config.data, name)
        plain = take.captured(Stage.TRACK_MOTION)
        seen = [seen_of(take, each) for each in plain]
        rows += [(name, *row) for row in _compared(take, seen, config)]
    columns = ("take", "prior", "right", "nothing given", "wrong person", "right of given",
               "contested", "contested, of given", "beyond", "CPU ms")  # fmt: skip
    return Report(
        (Table("labels, % of the true foreground", columns, tuple(rows), 2),),
        (
            f"First pass, every {config.every}th frame of all views. Contested: the {CONTESTED} px "
            "around where two people meet. CPU: a frame and view, without the foreground's.",
        ),
    )


def _compared(take: Take, seen: Sequence[Seen], config: Experiment) -> Iterator[tuple[object, ...]]:
    chosen = methods(config)
    sources = [
        PeopleSource(
            seen, take.images.reader, SequenceSettings(), 1, PeopleSettings(samples=m.samples)
        )
        for m in chosen
    ]
    scores, spent, count = [Counter[str]() for _ in chosen], np.zeros(len(chosen)), 0
    frames = seen[0].motion.frames
    tiles: list[list[NDArray[np.uint8]]] = []
    for view, truth in enumerate(take.truth):
        scene = sources[0].scene(view, range(frames))
        for frame in range(0, frames, config.every):
            block = sources[0].block(view, range(frame, frame + 1), scene)
            ((_, found, layers),) = sources[0].foregrounds(block)
            for number, (method, source) in enumerate(zip(chosen, sources, strict=True)):
                prior = source.prior(view, frame) if method.shape else _alike
                colors = scene.colors if method.colors else ()
                start = time.process_time()
                one = label_people(found, layers, colors, source.labels, prior)
                spent[number] += time.process_time() - start
                scores[number] += score(one.labels, truth[frame])
            count += 1
            if config.pictures and frame == config.every * (frames // config.every // 2):
                priors = [_CLOSED, "solved pose, n = 300", "previous pose, n = 300"]
                picked = [k for k, m in enumerate(chosen) if m.name in priors]
                drawn = [_drawn(found, layers, sources[k].prior(view, frame)) for k in picked]
                tiles.append([block.images[frame - block.shown.start], *drawn])
    for method, total, seconds in zip(chosen, scores, spent, strict=True):
        yield (method.name, *shares(total), 1000 * seconds / count)
    if tiles:
        RESULTS.mkdir(exist_ok=True)
        picture = np.vstack([np.hstack(row) for row in tiles])
        picture = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(RESULTS / f"people_prior_{take.name}.png"), picture)


def _alike(box: object, foreground: object, closed: NDArray[np.float32]) -> NDArray[np.float32]:
    """A prior that says nothing."""
    return np.full_like(closed, 1 / len(closed))


def _drawn(
    found: Segmentation, layers: Sequence[PersonLayer], prior: Prior | None
) -> NDArray[np.uint8]:
    """How probable everybody is where more than one person may be, as a mix of their colours."""
    picture = np.zeros((*found.mask.shape, 3), np.uint8)
    colors = np.array(COLORS[: len(layers)], np.float32)

    def kept(box: Box, foreground: Mask, closed: Plane) -> Plane:
        shapes = closed if prior is None else prior(box, foreground, closed)
        mixed = np.einsum("khw,kc->hwc", shapes, colors)
        picture[box] = np.where(foreground[..., None], mixed, 0)
        return shapes

    label_people(found, layers, (), prior=kept)
    return picture


if __name__ == "__main__":
    report.main(run, Experiment, "people_prior")
