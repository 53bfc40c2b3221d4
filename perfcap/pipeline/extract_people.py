"""Silhouettes of several people, found together in every frame and view (Liu 2013, Sec. 5)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.io.clip import FrameReader
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.evidence import RECORDS, Evidence, Mask, MaskRecord, encode_confidence
from perfcap.pipeline.extract_silhouettes import FEET, FrameBlock, SilhouetteSource
from perfcap.pipeline.pose_spread import parts_of_triangles
from perfcap.pipeline.sampled_poses import PoseSampler, PoseSpread, plain_factor
from perfcap.pipeline.sight import Sight, View
from perfcap.pipeline.surface import SurfaceFrames
from perfcap.pipeline.track_motion import Progress
from perfcap.segment import Segmentation, SequenceSettings, extract_contour, survey
from perfcap.segment.label_people import (
    PeopleLabels,
    PeopleSettings,
    Prior,
    label_people,
    near_each_other,
)
from perfcap.segment.part_colors import learn_part_colors
from perfcap.segment.person_layer import PersonLayer, Plane
from perfcap.segment.scene import Scene
from perfcap.segment.sequence import Footage, segment_block
from perfcap.segment.shape_samples import ShapeSamples
from perfcap.segment.silhouettes import encode_labels
from perfcap.segment.trimap import Box
from perfcap.segment.trust import boundary_trust
from perfcap.workers import ordered_map

_SHARE = 0.6  # of the deviations of single frames: what neighbours in time say is not in them
_OUTLINE = 0.005  # m, deviation of outlines that poses do not explain: clothes, templates
_NEAR = 0.05  # of their height in the image: people are near each other
_SETTLED = 0.5  # of all of these, of surfaces that were drawn onto silhouettes
_BESIDE = (1.5, 2.5)  # px outside of a boundary, where it is asked who is there


@dataclass(frozen=True)
class Seen:
    """One of several people who are to be found in images.

    Attributes:
        actor: the person.
        sight: cameras in the pixels of the images.
        motion: where the person is, (F,).
        deviations: of each body part, (F, P) m, see ``part_deviations``.
        heights: of the upright person in each view, (C,) px.
        surface: of every frame, where it is better known than as the motion skins it. It says who
            is where in a foreground.
        factors: of the covariance of each pose, (F, D, D), where poses are drawn about it; see
            ``pose_factors``.
    """

    actor: Actor
    sight: Sight
    motion: Motion
    deviations: Tensor
    heights: Tensor
    surface: SurfaceFrames | None = None
    factors: Tensor | None = None

    def look(self, view: int, frame: int, skinned: bool = False) -> View:
        """The surface in a frame and view, as it is known best, or as the motion skins it."""
        span = slice(frame, frame + 1)
        with torch.no_grad():
            if self.surface is None or skinned:
                vertices = self.actor.surface(self.motion[span])
            else:
                vertices = self.surface[span]
            return self.sight.look(vertices, span, (view,))[0][0]

    def spread(self, frame: int, settings: ShapeSamples) -> PoseSpread:
        """Where the person's pose may be in a frame, by a surface at rest that is known best."""
        here = self.motion[frame : frame + 1]
        actor, plain = self.actor, plain_factor(here, settings.spread)
        if self.surface is not None:
            surface = self.surface[frame : frame + 1].to(actor.vertices)
            actor = actor.with_vertices(actor.at_rest(here, surface)[0])
        if settings.center == "previous":
            first = max(frame - 1, 0)
            return PoseSpread(actor, self.motion[first : first + 1], plain)
        if self.factors is None:
            return PoseSpread(actor, here, plain)
        return PoseSpread(actor, here, self.known * _SHARE * self.factors[frame])

    @property
    def known(self) -> float:
        """Factor of all deviations."""
        return 1.0 if self.surface is None else _SETTLED


def extract_people(
    people: Sequence[Seen],
    reader: FrameReader,
    settings: SequenceSettings,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    name: str = "extract_silhouettes",
    labels: PeopleSettings | None = None,
    before: Sequence[Evidence] | None = None,
) -> tuple[Evidence, ...]:
    """Segment a clip, view after view, block after block; the evidence about each person.

    Args:
        people: K of them, in the same F frames and C views.
        reader: the frames.
        settings: of the foreground's segmentation.
        workers: threads; all cores when not given. The result does not depend on it.
        progress: called with (frames done, frames), summed over views.
        checkpoint: keeps finished blocks.
        name: under which it keeps them.
        labels: how people are told apart.
        before: what is known about each; it stays where no two of them are near each other.
    """
    source = PeopleSource(people, reader, settings, workers, labels)

    def records(block: FrameBlock) -> list[MaskRecord]:
        chosen = [f for f in block.wanted if before is None or _meet(before, f, block.view)]
        found, made = iter(source.label(block, chosen)), []
        for frame in block.wanted:
            if frame in chosen:
                labels = next(found)
                png = encode_labels(labels.labels)
                made += [record_of(labels, number, png) for number in range(len(people))]
            elif before is not None:
                made += [each.record(frame, block.view) for each in before]
        return made

    sight, motion = people[0].sight, people[0].motion
    total = motion.frames * sight.views
    views: list[list[MaskRecord]] = []
    for view in range(sight.views):
        done: list[MaskRecord] = []
        if before is not None and not any(_meet(before, f, view) for f in range(motion.frames)):
            rows = range(motion.frames)
            views.append([each.record(frame, view) for frame in rows for each in before])
            continue
        kept, count = checkpoint.kept(f"{name}_{view}"), source.block_count
        for part in kept.rest(RECORDS, records, partial(source.blocks, view), count, workers):
            done += part
            if progress is not None:
                progress(view * motion.frames + len(done) // len(people), total)
        views.append(done)
    return tuple(
        Evidence.collect([view[k :: len(people)] for view in views], each.heights, k + 1)
        for k, each in enumerate(people)
    )


class PeopleSource(SilhouetteSource):
    """Blocks of a clip, and what the models of everybody say about them."""

    def __init__(
        self,
        people: Sequence[Seen],
        reader: FrameReader,
        settings: SequenceSettings,
        workers: int | None = 1,
        labels: PeopleSettings | None = None,
    ) -> None:
        first = people[0]
        settings = _shared_out(settings, len(people))
        super().__init__(first.actor, first.sight, reader, first.motion, settings, workers)
        self.people, self.labels = people, labels or PeopleSettings()
        self.parts = [torch.from_numpy(parts_of_triangles(each.actor)) for each in people]
        samples = self.labels.samples
        actors = [each.actor for each in people]
        self.sampler = None if samples is None else PoseSampler(actors, self.parts, samples)

    def label(
        self, block: FrameBlock, frames: Sequence[int] | None = None
    ) -> Iterator[PeopleLabels]:
        """Who is where in the wanted frames of a block, or in some of them, increasing."""
        for frame, found, people in self.foregrounds(block, frames):
            prior = self.prior(block.view, frame)
            yield label_people(found, people, block.scene.colors, self.labels, prior)

    def foregrounds(
        self, block: FrameBlock, frames: Sequence[int] | None = None
    ) -> Iterator[tuple[int, Segmentation, Sequence[PersonLayer]]]:
        """Frames, where everybody is in them, and each as if alone."""
        frames = block.wanted if frames is None else frames
        layers = {frame: self.layers(block.view, frame) for frame in frames}
        drawn = {frame: self.models(block.view, frame, layers[frame]) for frame in frames}
        nobody = np.zeros((len(self.people), *self.sight.cameras.size[block.view]), np.bool_)
        models = [drawn.get(frame, nobody) for frame in block.shown]
        bones = self._bones(block.view, block.shown)
        footage = Footage(block.images, models, bones, FEET)
        chosen = [frame - block.shown.start for frame in frames]
        for index, found in zip(
            chosen, segment_block(footage, chosen, block.scene, self.settings), strict=True
        ):
            frame = block.shown.start + index
            yield frame, found, layers[frame]

    def prior(self, view: int, frame: int) -> Prior | None:
        """Of shapes, from samples of everybody's poses; None where it is the closed form."""
        return None if self.sampler is None else partial(self._prior, self.sampler, view, frame)

    def layers(self, view: int, frame: int) -> list[PersonLayer]:
        """Everybody as if they were alone in one frame and view."""
        return [self._layer(number, view, frame) for number in range(len(self.people))]

    def models(self, view: int, frame: int, layers: Sequence[PersonLayer]) -> Mask:
        """Silhouettes that tell everybody from the background, (K, H, W): of skinned surfaces.

        Refined ones were drawn onto masks of that foreground: they would repeat its mistakes.
        """
        return np.stack(
            [
                layer.mask if each.surface is None else each.look(view, frame, skinned=True).mask
                for each, layer in zip(self.people, layers, strict=True)
            ]
        )

    def _prior(
        self,
        sampler: PoseSampler,
        view: int,
        frame: int,
        box: Box,
        foreground: Mask,
        closed: Plane,
    ) -> Plane:
        people = [each.spread(frame, sampler.settings) for each in self.people]
        outline = _OUTLINE * max(each.known for each in self.people)
        camera = self.sight.cameras.frames(slice(frame, frame + 1)).select([view])
        return sampler.sample(people, camera, frame, outline).prior(box, foreground, closed)

    def _layer(self, number: int, view: int, frame: int) -> PersonLayer:
        person, span = self.people[number], slice(frame, frame + 1)
        drawn = person.look(view, frame)
        parts = drawn.labels.label(self.parts[number], -1).numpy()
        depth = drawn.labels.depth.numpy()
        inside = np.isfinite(depth)
        far = float(np.median(depth[inside])) if inside.any() else 1.0
        camera = person.sight.cameras.frames(span).select([view])
        focal = float(torch.linalg.det(camera.intrinsics[..., :2, :2]).abs().sqrt().mean())
        known = person.known
        unsure = _SHARE * person.deviations[frame].double().numpy(force=True)
        pixels = known * np.hypot(unsure, _OUTLINE) * focal / far
        doubt = known * float(np.hypot(unsure.mean(), 2 * _OUTLINE))
        where = drawn.labels.corner, drawn.size
        return PersonLayer.of(depth, parts, pixels.astype(np.float32), doubt, *where)

    def _survey(self, view: int, frames: list[int]) -> Scene:
        images = self._samples(view, frames)
        layers = list(ordered_map(partial(self.layers, view), frames, self.workers))
        plate, scene = self.settings.frame.plate, self.settings.scene
        models = [self.models(view, *each) for each in zip(frames, layers, strict=True)]
        found = survey(images, models, plate, scene, self.workers)
        samples = zip(images, layers, strict=True)
        return replace(found, colors=learn_part_colors(samples, self.labels.color))

    def _bones(self, view: int, frames: range) -> NDArray[np.float64]:
        """Lines of everybody's skeleton, (f, K, B, 2, 2) px; NaN behind the camera."""
        lines = [self._lines(each.actor, each.motion, view, frames) for each in self.people]
        return np.stack(lines, 1)


def _shared_out(settings: SequenceSettings, count: int) -> SequenceSettings:
    """As many pixels are looked at closely as of one person, whatever the number of people."""
    coarse = settings.frame.coarse
    if coarse is None:
        return settings
    return replace(settings, frame=replace(settings.frame, coarse=coarse / count**0.5))


def _meet(evidence: Sequence[Evidence], frame: int, view: int) -> bool:
    """Whether some of the people are near each other in a frame and view, as far as is known."""
    labels = replace(evidence[0].silhouettes, person=None).labels(frame, view)
    sizes = [each.heights[view] for each in evidence]
    there = [k for k, each in enumerate(evidence, 1) if each.reports[frame][view].person]
    return near_each_other(labels, there, _NEAR * max(sizes))


def record_of(found: PeopleLabels, number: int, png: bytes) -> MaskRecord:
    """What is kept of one of the people in a frame and view, with the PNG of everybody."""
    alone = found.people[number]

    def trust(points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
        own = boundary_trust(alone, points, normals)
        sides = [_sampled(found, number, points + side * normals) for side in _BESIDE]
        lowest: NDArray[np.float64] = own * np.min(sides, 0)
        return lowest

    contour = extract_contour(alone.mask, trust)
    return MaskRecord(png, encode_confidence(contour.confidence), alone.report)


def _sampled(found: PeopleLabels, number: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """How probably a person is nearer than who is seen at points (N, 2) px, (N,)."""
    plane = found.ahead[number]
    column, row = np.rint(points).astype(np.int64).T
    row, column = row - found.box[0].start, column - found.box[1].start
    inside = (row >= 0) & (row < plane.shape[0]) & (column >= 0) & (column < plane.shape[1])
    ahead = np.ones(len(points))
    ahead[inside] = plane[row[inside], column[inside]]
    return ahead
