"""People followed from frame to frame by silhouettes (Liu et al. 2013, Algorithms 1 and 2).

Detections say where everybody is in the first frame. Poses do not look at them afterwards: a
frame's pixels are given to people by where their poses and surfaces were, then each is solved on
their own. The background and the colours of people are learnt once for a stretch of frames, where
the motion from detections has them; the paper has silhouettes given, and colours of two frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.io.journal import Record
from perfcap.memory import give_back
from perfcap.pipeline.checkpoint import Checkpoint, Codec
from perfcap.pipeline.evidence import RECORDS, Evidence, MaskRecord
from perfcap.pipeline.extract_people import PeopleSource, record_of
from perfcap.pipeline.extract_silhouettes import FrameBlock, given_record
from perfcap.pipeline.followed_person import (
    Follower,
    FramesConfig,
    PersonState,
    PersonView,
    Tracking,
)
from perfcap.pipeline.images import Images
from perfcap.pipeline.local_global import FramePose
from perfcap.pipeline.surface import StoredSurface
from perfcap.pipeline.track_motion import Progress
from perfcap.segment import Scene, SequenceSettings
from perfcap.segment.label_people import PeopleSettings
from perfcap.segment.silhouettes import decode_labels, encode_labels
from perfcap.workers import ordered_map

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Followed:
    """A person in all frames.

    Attributes:
        motion: (F,).
        surface: of every frame.
        evidence: silhouettes.
        tracking: how it went.
    """

    motion: Motion
    surface: StoredSurface
    evidence: Evidence
    tracking: Tracking


@dataclass(frozen=True, eq=False)
class _Frame:
    """What was found in one frame: of each of K people, and masks ``[view][person]`` in a row."""

    poses: Sequence[FramePose]
    surfaces: Sequence[Tensor]  # (V, 3) float32
    masks: Sequence[MaskRecord]


def follow(
    people: Sequence[Follower],
    images: Images,
    config: FramesConfig,
    silhouettes: SequenceSettings,
    refined: bool,
    workers: int | None,
    progress: Progress,
    checkpoint: Checkpoint,
    labels: PeopleSettings | None = None,
) -> tuple[Followed, ...]:
    """Follow everybody through a clip.

    Args:
        people: K of them.
        images: F frames and the cameras in their pixels.
        config: settings.
        silhouettes: of the foreground's segmentation.
        refined: whether surfaces are.
        workers: threads; all cores when not given. The result does not depend on it.
        progress: called with (frames done, frames).
        checkpoint: keeps finished frames.
        labels: how people are told apart.
    """
    frames = people[0].motion.frames
    walk = _Walk(people, images, config, silhouettes, refined, workers, labels)
    kept = checkpoint.kept("follow_frames")
    found: list[_Frame] = []
    kept_surfaces = [StoredSurface.empty(frames, len(each.actor.vertices)) for each in people]
    codec = _codec([each.motion for each in people])
    for result in kept.rest(codec, walk.frame, lambda done: range(done, frames), frames):
        walk.go_on(len(found), result)
        for whole, surface in zip(kept_surfaces, result.surfaces, strict=True):
            whole.write(len(found), surface[None])
        found.append(replace(result, surfaces=()))
        progress(len(found), frames)
        give_back()
    pairs = enumerate(kept_surfaces)
    return tuple(_collected(people, found, number, surface) for number, surface in pairs)


def _collected(
    people: Sequence[Follower], found: Sequence[_Frame], number: int, surface: StoredSurface
) -> Followed:
    person, count = people[number], len(people)
    views = [
        [frame.masks[view * count + number] for frame in found]
        for view in range(person.sight.views)
    ]
    poses = [frame.poses[number] for frame in found]
    motion = Motion.cat([pose.motion for pose in poses])
    evidence = Evidence.collect(views, person.heights, number + 1 if count > 1 else None)
    released = np.array([pose.released / pose.unknowns for pose in poses])
    errors = torch.stack([pose.errors for pose in poses]).double().numpy(force=True)
    return Followed(motion, surface, evidence, Tracking(errors, released))


class _Walk:
    """A clip that is walked through, and everybody as they were in the last frames."""

    def __init__(
        self,
        people: Sequence[Follower],
        images: Images,
        config: FramesConfig,
        silhouettes: SequenceSettings,
        refined: bool,
        workers: int | None,
        labels: PeopleSettings | None,
    ) -> None:
        self.images, self.config, self.workers = images, config, workers
        self.states = [PersonState(each, config, refined) for each in people]
        self.source = PeopleSource(
            [each.seen for each in self.states], images.reader, silhouettes, workers, labels
        )
        self.scenes: dict[int, Scene] = {}
        self.stretch = -1
        self.frames, self.span = people[0].motion.frames, silhouettes.scene.span

    def frame(self, frame: int) -> _Frame:
        """Everybody in the next frame."""
        self._survey(frame)
        predicted = [each.predicted() for each in self.states]
        for state, motion in zip(self.states, predicted, strict=True):
            state.place(frame, motion)
        self.source.people = [each.seen for each in self.states]
        views = self.source.sight.views
        blocks = (
            self.source.block(view, range(frame, frame + 1), self.scenes[view])
            for view in range(views)
        )
        looked = list(ordered_map(self._look, blocks, self.workers))
        pairs = list(enumerate(zip(self.states, predicted, strict=True)))

        def solved(task: tuple[int, tuple[PersonState, Motion]]) -> tuple[FramePose, Tensor]:
            number, (state, motion) = task
            seed = frame * len(self.states) + number
            return state.solve(frame, [view.of(number) for view in looked], motion, seed)

        results = list(ordered_map(solved, pairs, self.workers))
        masks = [record for view in looked for record in view.records]
        return _Frame([r[0] for r in results], [r[1] for r in results], masks)

    def go_on(self, frame: int, result: _Frame) -> None:
        """Begin the next frame where this one ended."""
        count = len(self.states)
        for number, state in enumerate(self.states):
            labels = [decode_labels(record.png) for record in result.masks[number::count]]
            state.go_on(
                frame, result.poses[number].motion, result.surfaces[number], labels, number + 1
            )

    def _survey(self, frame: int) -> None:
        """What stays the same over a stretch of frames, from where detections put everybody."""
        stretch = frame // self.span
        if stretch == self.stretch:
            return
        self.stretch = stretch
        self.source.people = [each.detected for each in self.states]
        start = stretch * self.span
        frames = range(start, min(start + self.span, self.frames))
        self.scenes = {
            view: self.source.scene(view, frames) for view in range(self.source.sight.views)
        }

    def _look(self, block: FrameBlock) -> _Looked:
        """One view of the next frame: who is where, and what moved since the last one."""
        (frame,) = block.wanted
        index = frame - block.shown.start
        known = self.images.masks.mask(block.view, frame) if self.images.masks else None
        if known is not None and len(self.states) == 1:
            records = [given_record(known, self.source.layers(block.view, frame)[0].mask)]
        else:
            (labels,) = self.source.label(block)
            png = encode_labels(labels.labels)
            records = [record_of(labels, number, png) for number in range(len(self.states))]
        image = block.images[index]
        before = block.images[index - 1] if index else None
        moved = [
            state.look(block.view, number + 1, records[number], image, before)
            for number, state in enumerate(self.states)
        ]
        return _Looked(records, moved)


@dataclass(frozen=True, eq=False)
class _Looked:
    """One view of a frame."""

    records: Sequence[MaskRecord]
    people: Sequence[PersonView]

    def of(self, number: int) -> PersonView:
        return self.people[number]


# --- Frames as records, to the last bit -----------------------------------------------------------


def _codec(people: Sequence[Motion]) -> Codec[_Frame]:
    """Of K people whose motions are of the type and on the device of others."""

    def pack(frame: _Frame) -> Record:
        record = dict(RECORDS.pack(list(frame.masks)))
        for k, (pose, surface) in enumerate(zip(frame.poses, frame.surfaces, strict=True)):
            parts = {name: getattr(pose.motion, name) for name in _POSE}
            parts |= {"errors": pose.errors, "surface": surface}
            record |= {f"{k}_{name}": value.numpy(force=True) for name, value in parts.items()}
            record[f"{k}_released"] = [pose.released, pose.unknowns]
        return record

    def unpack(record: dict[str, Any]) -> _Frame:
        poses, surfaces = [], []
        for k, like in enumerate(people):
            parts = {
                name: torch.from_numpy(record[f"{k}_{name}"]).to(like.angles) for name in _POSE
            }
            errors = torch.from_numpy(record[f"{k}_errors"]).to(like.angles)
            motion = Motion(parts["translation"], parts["rotation"], parts["angles"])
            poses.append(FramePose(motion, errors, *record[f"{k}_released"]))
            surfaces.append(torch.from_numpy(record[f"{k}_surface"]))
        masks = {name: record[name] for name in ("reports", "sizes", "masks", "confidence")}
        return _Frame(poses, surfaces, RECORDS.unpack(masks))

    return Codec(pack, unpack)


_POSE = ("translation", "rotation", "angles")
