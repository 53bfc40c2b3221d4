"""Silhouettes of the person in every frame and view, from the posed model (Xu 2018, Sec. 5.1)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import NEAR, Camera
from perfcap.io.clip import FrameReader
from perfcap.memory import give_back
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.evidence import RECORDS, Evidence, Mask, MaskRecord, encode_confidence
from perfcap.pipeline.images import KnownMasks
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.track_motion import Progress
from perfcap.segment import FrameReport, Scene, Segmentation, extract_contour, survey
from perfcap.segment.network_cue import CueTrust, PersonNetwork, learn_trust
from perfcap.segment.scene import sample_frames
from perfcap.segment.sequence import BLOCK, Footage, SequenceSettings, ask, segment_block
from perfcap.segment.silhouettes import encode_labels
from perfcap.segment.trust import boundary_trust
from perfcap.workers import ordered_map

Image = NDArray[np.uint8]

# the skeleton's lines in the image: limbs between landmarks, and the spine to the middle of the
# hips, which is their mean
_LIMBS = (
    ("head_top", "neck"), ("neck", "r_shoulder"), ("r_shoulder", "r_elbow"),
    ("r_elbow", "r_wrist"), ("neck", "l_shoulder"), ("l_shoulder", "l_elbow"),
    ("l_elbow", "l_wrist"), ("r_hip", "l_hip"), ("r_hip", "r_knee"), ("r_knee", "r_ankle"),
    ("r_ankle", "r_toe"), ("l_hip", "l_knee"), ("l_knee", "l_ankle"), ("l_ankle", "l_toe"),
)  # fmt: skip
FEET = tuple(i for i, (_, end) in enumerate(_LIMBS) if end in ("r_toe", "l_toe"))

_ASKED = 5  # frames of a stretch in which a network is compared with the other cues
_BESIDE = 0.3  # overlap with the captured body, below which a known mask is of something else


def extract_silhouettes(
    actor: Actor,
    sight: Sight,
    reader: FrameReader,
    motion: Motion,
    heights: Tensor,
    settings: SequenceSettings,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    name: str = "extract_silhouettes",
    network: PersonNetwork | None = None,
    known: KnownMasks | None = None,
) -> Evidence:
    """Segment a clip, view after view, block after block.

    Args:
        actor: the person.
        sight: cameras in the pixels of the images.
        reader: F frames of C views.
        motion: where the person is, (F,).
        heights: of the upright person in each view, (C,), px.
        settings: of the segmentation.
        workers: threads; all cores when not given. The result does not depend on it.
        progress: called with (frames done, frames), summed over views.
        checkpoint: keeps finished blocks.
        name: under which it keeps them.
        network: that finds person masks, as one more cue; none if not given.
        known: masks that are used as they are; the others are found.
    """
    source = SilhouetteSource(actor, sight, reader, motion, settings, workers, network, known)

    def records(block: FrameBlock) -> list[MaskRecord]:
        given = {} if known is None else _known(known, block)
        found = iter(source.segment(block, given))
        made = [
            given_record(given[f], source.draw(block.view, f))
            if f in given
            else _record(next(found))
            for f in block.wanted
        ]
        give_back()
        return made

    total = motion.frames * sight.views
    views: list[list[MaskRecord]] = []
    for view in range(sight.views):
        done: list[MaskRecord] = []
        kept, count = checkpoint.kept(f"{name}_{view}"), source.block_count
        parts = kept.rest(RECORDS, records, partial(source.blocks, view), count, workers)
        for part in parts:
            done += part
            if progress is not None:
                progress(view * motion.frames + len(done), total)
        views.append(done)
    return Evidence.collect(views, heights)


@dataclass(frozen=True)
class FrameBlock:
    """Frames of one view: those to segment, and those around them that help."""

    view: int
    wanted: range
    shown: range
    images: Sequence[Image]
    scene: Scene


class SilhouetteSource:
    """Blocks of a clip, and what the model says about them."""

    def __init__(
        self,
        actor: Actor,
        sight: Sight,
        reader: FrameReader,
        motion: Motion,
        settings: SequenceSettings,
        workers: int | None = 1,
        network: PersonNetwork | None = None,
        known: KnownMasks | None = None,
    ) -> None:
        self.actor, self.sight, self.reader, self.known = actor, sight, reader, known
        self.network = network if settings.frame.network > 0 else None
        self.motion, self.settings, self.workers = motion, settings, workers
        # of the stretch that is worked on, by view and frame: images where they are few, and drawn
        # models
        self._images: dict[tuple[int, int], Image] = {}
        self._drawn: dict[tuple[int, int], NDArray[np.uint8]] = {}

    @property
    def block_count(self) -> int:
        """Blocks of a view."""
        return sum(len(list(starts)) for _, starts in self._spans())

    def _spans(self) -> Iterator[tuple[range, range]]:
        """Frames that share a scene, and the first ones of their blocks."""
        frames, span = self.motion.frames, self.settings.scene.span
        for start in range(0, frames, span):
            stop = min(start + span, frames)
            yield range(start, stop), range(start, stop, BLOCK)

    def blocks(self, view: int, skipped: int = 0) -> Iterator[FrameBlock]:
        """Blocks of a view in order but the first ``skipped``, read as they are asked for."""
        for span, starts in self._spans():
            starts, skipped = starts[skipped:], max(0, skipped - len(starts))
            if not starts:
                continue
            start, stop = span.start, span.stop
            scene = self.scene(view, range(start, stop))
            give_back()  # what was the samples'
            last: FrameBlock | None = None
            for first in starts:
                last = self.block(view, range(first, min(first + BLOCK, stop)), scene, last)
                yield last

    def scene(self, view: int, span: range) -> Scene:
        """What frames of a stretch share, and how far a network is to be trusted in them."""
        self._images, self._drawn = {}, {}
        if self.known is not None and all(self.known.knows(view, frame) for frame in span):
            return Scene(None, float("nan"), 0)  # nobody will ask
        samples = sample_frames(span.start, span.stop, self.settings.scene.samples)
        scene = self._survey(view, samples)
        if self.network is None:
            return scene
        chosen = samples[:: -(-len(samples) // _ASKED)]
        return replace(scene, trust=self._learn_trust(view, chosen, scene))

    def block(
        self, view: int, wanted: range, scene: Scene, last: FrameBlock | None = None
    ) -> FrameBlock:
        """Frames of a view in a row, with those around them.

        Those that the ``last`` block has are not read again: a video would be decoded anew from
        its key frame on.
        """
        shown = range(max(wanted.start - 1, 0), min(wanted.stop + 1, self.motion.frames))
        known = {frame: self._images.get((view, frame)) for frame in shown}
        images = {frame: image for frame, image in known.items() if image is not None}
        if last is not None and not images:  # copies: a part of an array keeps all of it
            both = range(shown.start, last.shown.stop)
            images = {frame: last.images[frame - last.shown.start].copy() for frame in both}
        missing = [frame for frame in shown if frame not in images]
        if missing:
            first, stop = missing[0], missing[-1] + 1
            read = self.reader.read_view(view, first, stop)
            images.update(zip(range(first, stop), read, strict=True))
        return FrameBlock(view, wanted, shown, [images[frame] for frame in shown], scene)

    def segment(self, block: FrameBlock, known: Collection[int] = ()) -> list[Segmentation]:
        """The person in the wanted frames of a block, but in those that are known."""
        footage, wanted = self._footage(block)
        chosen = [i for i in wanted if block.shown.start + i not in known]
        return list(segment_block(footage, chosen, block.scene, self.settings, self.network))

    def _footage(self, block: FrameBlock) -> tuple[Footage, range]:
        """The frames of a block, and which of them are wanted."""
        models = [self._model(block.view, f, block) for f in block.shown]
        bones = self._bones(block.view, block.shown)
        footage = Footage(block.images, models, bones, FEET)
        first = block.wanted.start - block.shown.start
        return footage, range(first, first + len(block.wanted))

    def _learn_trust(self, view: int, frames: list[int], scene: Scene) -> CueTrust | None:
        """How far the network is to be trusted, from frames segmented without it."""
        network = self.network
        assert network is not None

        def sample(block: FrameBlock) -> tuple[NDArray[np.float32], Mask]:
            footage, (index,) = self._footage(block)
            (found,) = segment_block(footage, range(index, index + 1), scene, self.settings)
            band, box = found.trimap.band, found.trimap.box
            if not found.trimap.size:
                return np.zeros(0, np.float32), np.zeros(0, np.bool_)
            return ask(network, footage, index, found.trimap)[band], found.mask[box][band]

        # readers are no friends of threads: blocks are read here, as they are asked for
        blocks = (self.block(view, range(frame, frame + 1), scene) for frame in frames)
        pairs = ordered_map(sample, blocks, self.workers)
        return learn_trust(pairs, self.settings.frame.network)

    def _survey(self, view: int, frames: list[int]) -> Scene:
        images = self._samples(view, frames)
        models = list(ordered_map(partial(self.draw, view), frames, self.workers))
        self._drawn = {
            (view, frame): np.packbits(model) for frame, model in zip(frames, models, strict=True)
        }
        plate, scene = self.settings.frame.plate, self.settings.scene
        return survey(images, models, plate, scene, self.workers)

    def _samples(self, view: int, frames: list[int]) -> list[Image]:
        """Images of frames, increasing; blocks show them too where they are frames in a row."""
        if len(frames) < frames[-1] + 1 - frames[0]:
            return [self.reader.read_view(view, f, f + 1)[0] for f in frames]
        images = list(self.reader.read_view(view, frames[0], frames[-1] + 1))
        self._images = {(view, f): image for f, image in zip(frames, images, strict=True)}
        return images

    def _model(self, view: int, frame: int, block: FrameBlock) -> Mask:
        """The model's silhouette; that of frames around a block does not matter."""
        if frame in block.wanted:
            return self.draw(view, frame)
        return np.zeros(self.sight.cameras.size[view], np.bool_)

    def draw(self, view: int, frame: int) -> Mask:
        """The model's silhouette in a frame, (H, W)."""
        size, drawn = self.sight.cameras.size[view], self._drawn.get((view, frame))
        if drawn is not None:
            return np.unpackbits(drawn, count=size[0] * size[1]).reshape(size).view(np.bool_)
        span = slice(frame, frame + 1)
        with torch.no_grad():
            vertices = self.actor.surface(self.motion[span])
            (row,) = self.sight.outlines(vertices, span, (view,))
            return row[0].mask

    def _bones(self, view: int, frames: range) -> NDArray[np.float64]:
        """Lines of the skeleton, (f, B, 2, 2) px; NaN behind the camera."""
        return self._lines(self.actor, self.motion, view, frames)

    def _lines(self, actor: Actor, motion: Motion, view: int, frames: range) -> NDArray[np.float64]:
        span = slice(frames.start, frames.stop)
        with torch.no_grad():
            joints = actor.joints(motion[span])
            return project_bones(self.sight.cameras.frames(span).select([view]), joints)


def project_bones(camera: Camera, joints: Tensor) -> NDArray[np.float64]:
    """Lines (f, B, 2, 2) px of landmarks (f, 16, 3) m in one view; NaN behind the camera."""
    index = {name: i for i, name in enumerate(LANDMARKS)}
    hips = joints[:, [index["r_hip"], index["l_hip"]]].mean(1, keepdim=True)
    points = torch.cat((joints, hips), 1)
    local = camera.to_camera(points)[:, 0]
    pixels = camera.project_camera(local[:, None])[:, 0]
    pixels = pixels.where(local[..., 2:] > NEAR, torch.nan)
    pairs = [(index[a], index[b]) for a, b in _LIMBS] + [(index["neck"], len(LANDMARKS))]
    lines: NDArray[np.float64] = pixels[:, pairs].double().numpy(force=True)
    return lines


def _known(masks: KnownMasks, block: FrameBlock) -> dict[int, Mask]:
    """The known ones of the wanted frames of a block."""
    found = {frame: masks.mask(block.view, frame) for frame in block.wanted}
    return {frame: mask for frame, mask in found.items() if mask is not None}


def given_record(mask: Mask, model: Mask | None = None) -> MaskRecord:
    """Of a mask that nobody here has found: it is believed, unless it lies beside the model.

    Args:
        mask: (H, W).
        model: where the captured body is, likewise; None if nobody asks.
    """
    contour = extract_contour(mask)
    beside = model is not None and _lies_beside(mask, model)
    report = FrameReport(bool(mask.any()), given=True, beside=beside)
    confidence = np.zeros_like(contour.confidence) if beside else contour.confidence
    return MaskRecord(encode_labels(mask), encode_confidence(confidence), report)


def _lies_beside(mask: Mask, model: Mask) -> bool:
    both, either = np.count_nonzero(mask & model), np.count_nonzero(mask | model)
    return bool(mask.any() and model.any() and both < _BESIDE * either)


def _record(found: Segmentation) -> MaskRecord:
    contour = extract_contour(found.mask, partial(boundary_trust, found))
    return MaskRecord(
        encode_labels(found.mask), encode_confidence(contour.confidence), found.report
    )
