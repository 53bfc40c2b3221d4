"""Which pixel shows whom, and what images add to several people (Liu et al. 2013, Sec. 5)."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from numpy.typing import NDArray
from people_takes import people_of, shuffled
from recordings import Recording, stored_image
from report import RESULTS, Report, Table
from surface_recordings import images_of

from perfcap.app.match_people import match_actors
from perfcap.detect.association import associate
from perfcap.metrics import surface_error
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.extract_people import PeopleSource, Seen
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.overlay import COLORS
from perfcap.pipeline.people import Person, Scene
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.pose_spread import part_deviations, pose_factors
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.stage import Stage
from perfcap.segment import SequenceSettings
from perfcap.segment.person_layer import PersonLayer

Labels = NDArray[np.uint8]

CONTESTED = 8  # px of both people
_METHODS = ("nearest projected model", "shape alone", "shape and colours")
_PASSES = "extract_silhouettes"  # how the names of stages begin that find labels


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins")
    """Of ``rendered_multi``."""
    surface: tuple[str, ...] = ("dev_duo", "dev_trio", "dev_twins")
    """Those whose surfaces are refined, and labels found again from them: minutes."""
    every: int = 6
    """Frames between those in which methods are compared; results are scored in all."""
    pictures: bool = False
    """Write label maps and outlines of some frames in all views beside the numbers."""


@dataclass(frozen=True)
class Take:
    """A sequence, its people in the order of their numbers, and true labels, for scoring alone."""

    name: str
    people: list[Recording]
    cast: tuple[Person, ...]
    images: Images
    truth: list[Labels]

    @classmethod
    def read(cls, data: Path, name: str) -> Take:
        """Who is who is found in shuffled detections."""
        people = people_of(data, name)
        crowd = shuffled(people)
        found = associate(crowd.cameras, crowd.candidates, crowd.rate)
        actors = [each.actor for each in people]
        tracks = match_actors(actors, found, [each.name for each in people]).tracks
        cast = tuple(Person(a, found.people[k]) for a, k in zip(actors, tracks, strict=True))
        images = images_of(people[0])
        paths = sorted((people[0].folder / "labels").glob("*.png"))
        truth = [
            stored_image(path).reshape(-1, *size)
            for path, size in zip(paths, images.cameras.size, strict=True)
        ]
        return cls(name, people, cast, images, truth)

    def captured(self, until: Stage) -> tuple[Performance, ...]:
        """Everybody."""
        first = self.people[0]
        images = self.images if until.needs_images else None
        return capture(Scene(first.cameras, self.cast, first.rate, images), until=until, workers=1)


def run(config: Experiment) -> Report:
    """All tables."""
    labels, joints = [], []
    for name in config.sequences:
        take = Take.read(config.data, name)
        plain = take.captured(Stage.TRACK_MOTION)
        until = Stage.REFINE_SURFACE if name in config.surface else Stage.REFINE_POSE
        found = take.captured(until)
        labels += [(name, *row) for row in _compared(take, plain, config.every)]
        labels.append((name, "result", *_result(take, found)))
        pairs = zip(take.people, plain, found, strict=True)
        joints += [(name, k, *_joints(*row)) for k, row in enumerate(pairs, 1)]
        if config.pictures:
            _pictures(take, found)
    columns = ("take", "labels", "right", "nothing given", "wrong person", "right of given",
               "contested", "contested, of given", "beyond", "CPU ms")  # fmt: skip
    titles = ("take", "person", "joints alone", "95 %", "with images", "95 %", "surface of joints",
              "refined pose", "refined surface", "vertices", "CPU s")  # fmt: skip
    return Report(
        (
            Table("labels, % of the true foreground", columns, tuple(labels)),
            Table("joints, and distance of surfaces to the truth, mm", titles, tuple(joints)),
        ),
        (
            f"Contested: the {CONTESTED} px around where two people meet, % of it. Beyond: true "
            "background given to somebody. CPU: a frame and view; of a result, of all its passes.",
            "Joints of shuffled detections. CPU s: of everybody, all stages.",
        ),
    )


def _compared(take: Take, found: Sequence[Performance], every: int) -> Iterator[tuple[object, ...]]:
    """Labels about the motion of joints alone, by method."""
    source = PeopleSource(
        [seen_of(take, each) for each in found], take.images.reader, SequenceSettings(), 1
    )
    scores = {method: Counter[str]() for method in _METHODS}
    spent, count, frames = dict.fromkeys(_METHODS, 0.0), 0, found[0].frames
    for view, truth in enumerate(take.truth):
        scene = source.scene(view, range(frames))
        for frame in range(0, frames, every):
            block = source.block(view, range(frame, frame + 1), scene)
            colorless = replace(block, scene=replace(scene, colors=()))
            for method, chosen in zip(_METHODS, (None, colorless, block), strict=True):
                start = time.process_time()
                if chosen is None:
                    labels = _nearest(source.layers(view, frame))
                else:
                    (one,) = source.label(chosen)
                    labels = one.labels
                spent[method] += time.process_time() - start
                scores[method] += score(labels, truth[frame])
            count += 1
    for method in _METHODS:
        yield (method, *shares(scores[method]), 1000 * spent[method] / count)


def seen_of(take: Take, found: Performance) -> Seen:
    cameras = take.images.cameras.to(found.motion.angles)
    template = found.actor.template
    sight = Sight(cameras, torch.as_tensor(template.faces.copy()), template.weld()[0])
    assert isinstance(found.config, CaptureConfig)
    given = found.actor, found.cameras, found.detections, found.config.pose
    problem = ClipProblem.of(FrameProblem.of(*given), found.rate)
    deviations = part_deviations(problem, found.motion)
    factors = pose_factors(problem, found.motion)
    return Seen(
        found.actor, sight, found.motion, deviations, 100 * problem.pixel_unit, factors=factors
    )


def _nearest(layers: Sequence[PersonLayer]) -> Labels:
    """Whose model is nearest, without looking at the image."""
    depth = np.full(layers[0].shape, np.inf)
    labels = np.zeros(layers[0].shape, np.uint8)
    for number, layer in enumerate(layers, 1):
        part, ahead = labels[layer.box], layer.depth < depth[layer.box]
        part[ahead] = number
        depth[layer.box][ahead] = layer.depth[ahead]
    return labels


def score(labels: Labels, truth: Labels) -> Counter[str]:
    """Pixels of a frame by what became of them."""
    there, people = truth > 0, range(1, int(truth.max()) + 1)
    near = [
        cv2.distanceTransform((truth != k).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
        <= CONTESTED
        for k in people
        if (truth == k).any()
    ]
    contested = there & (np.sum(near, 0) > 1) if near else there
    right, given = labels == truth, labels > 0
    sets = {
        "there": there, "right": there & right, "none": there & ~given,
        "wrong": there & given & ~right, "contested": contested,
        "contested right": contested & right, "contested given": contested & given,
        "beyond": given & ~there,
    }  # fmt: skip
    return Counter({name: int(pixels.sum()) for name, pixels in sets.items()})


def shares(found: Counter[str]) -> Iterator[float]:
    there, contested = max(found["there"], 1), max(found["contested"], 1)
    yield from (100 * found[name] / there for name in ("right", "none", "wrong"))
    yield 100 * found["right"] / max(found["right"] + found["wrong"], 1)
    yield 100 * found["contested right"] / contested
    yield 100 * found["contested right"] / max(found["contested given"], 1)
    yield 100 * found["beyond"] / there


def _labels_of(found: Sequence[Performance], frame: int, view: int) -> Labels:
    refinement = found[0].refinement
    assert refinement is not None
    return replace(refinement.evidence.silhouettes, person=None).labels(frame, view)


def _result(take: Take, found: Sequence[Performance]) -> Iterator[float]:
    """Of the labels that a capture ends with."""
    total = Counter[str]()
    for view, truth in enumerate(take.truth):
        for frame in range(found[0].frames):
            total += score(_labels_of(found, frame, view), truth[frame])
    yield from shares(total)
    stages = [stage for each in found for stage in each.stages if stage.name.startswith(_PASSES)]
    yield 1000 * sum(stage.cpu for stage in stages) / (found[0].frames * len(take.truth))


def _joints(person: Recording, plain: Performance, found: Performance) -> Iterator[float]:
    for each in (plain, found):
        error = 1000 * (each.joints() - person.truth).norm(dim=-1)
        yield from (float(error.mean()), float(error.quantile(0.95)))
    assert person.sequence is not None and person.sequence.surface is not None
    known = person.sequence.surface()
    skinned = [each.actor.surface(each.motion) for each in (plain, found)]
    deformed = found.shown[0 : found.frames]
    sums = np.zeros((3, 2))
    frames = range(0, found.frames, 3)
    for frame in frames:
        for k, surface in enumerate((*skinned, deformed)):
            vertices = surface[frame].double().numpy(force=True)[known.order]
            given = known.vertices[frame], known.faces, np.random.default_rng(0)
            error = surface_error(vertices, *given, translated=False)
            sums[k] += error.surface, error.vertex
    yield from (float(value) for value in sums[:, 0] / len(frames))
    yield float(sums[2, 1] / len(frames))
    yield sum(stage.cpu for stage in found.stages)


def _pictures(take: Take, found: Sequence[Performance]) -> None:
    """Images with outlines of labels, and labels, of three frames in all views."""
    colors = np.array([(0, 0, 0), *COLORS], np.uint8)
    rows = []
    for view in range(len(take.truth)):
        tiles = []
        for frame in np.linspace(4, found[0].frames - 5, 3).astype(int):
            image = take.images.reader.read_view(view, frame, frame + 1)[0].copy()
            labels = _labels_of(found, frame, view)
            for number in range(1, len(found) + 1):
                mask = (labels == number).astype(np.uint8)
                lines, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
                cv2.drawContours(image, lines, -1, colors[number].tolist(), 1)
            tiles += [image, colors[labels]]
        rows.append(np.hstack(tiles))
    RESULTS.mkdir(exist_ok=True)
    picture = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(RESULTS / f"people_labels_{take.name}.png"), picture)


if __name__ == "__main__":
    report.main(run, Experiment, "people_labels")
