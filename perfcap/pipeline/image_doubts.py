"""Whether images, and masks of them, show the person whose joints are given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.doctor import Finding, Severity
from perfcap.io.doctor.fields import examine_fields
from perfcap.io.doctor.footage import examine_blank, examine_footage
from perfcap.io.doctor.given_way import examine_way
from perfcap.io.doctor.halts import examine_halts
from perfcap.io.doctor.looked import examine_looks
from perfcap.io.doctor.mask_outlines import MaskedFrames, mask_doubts
from perfcap.io.doctor.masks import examine_masks, partly_masked
from perfcap.io.doctor.shots import examine_standing
from perfcap.pipeline.bone_lengths import spread_frames
from perfcap.pipeline.images import Frames, Images, KnownMasks
from perfcap.pipeline.people import Scene

Kind = TypeVar("Kind", Camera, Detections)

_MASKS = 12  # frames whose masks are looked at
_REMEDY = "give the frames that were detected in, or end at Stage.TRACK_MOTION"


def image_doubts(
    images: Images, scene: Scene, detections: Detections, looked_at: bool
) -> list[Finding]:
    """Findings of images that show little, or something else.

    Args:
        images: as they are given to a capture.
        scene: with C views in pixels of the detections, and everybody in it.
        detections: of the person, (F, C), of the same frames.
        looked_at: whether a stage looks at the images.

    Raises:
        InputError: most images of a view are of one color, and a stage looks at them.
    """
    names = [f"images of view {view}" for view in range(detections.views)]
    halts = examine_halts(images.reader, names)  # what wraps videos does not know their repeats
    images, detections = images.checked(), _plain(detections)
    found = examine_blank(images.reader, names) if looked_at else []
    for finding in found:
        if finding.severity is Severity.ERROR:
            raise InputError(f"{finding.subject}: {finding.what}; {_REMEDY}")
    given, shown = _plain(scene.cameras), _plain(images.cameras)
    pixels = _shown_at(given, shown, detections)
    seen, crowd, everybody = (pixels.numpy(), detections.confidence2d.numpy()), None, None
    if len(scene.people) > 1:
        people = [_plain(each.detections.finite()) for each in scene.people]
        everybody = (
            torch.stack([_shown_at(given, shown, each) for each in people]),
            torch.stack([each.confidence2d for each in people]),
        )
        crowd = everybody[0].numpy(), everybody[1].numpy()
    found += [*halts, *examine_fields(images.reader, names)]
    take = images.reader, names
    late: list[Finding] = []
    if shown.moving:
        found += examine_way(*take, shown, scene.rate, crowd or seen)
    elif not given.moving:
        moved = examine_standing(*take, scene.rate, *seen, everybody=crowd)
        late = [] if moved else examine_footage(images.reader, shown.size, detections, pixels)
        found += moved
    looks = images.reader, detections.confidence2d, pixels, names
    found += late or examine_looks(*looks, everybody=everybody)
    return found


def _shown_at(given: Camera, shown: Camera, detections: Detections) -> Tensor:
    """Joints (F, C, 16, 2) in the pixels of the images."""
    rays = torch.nn.functional.pad(given.to_plane(detections.joints2d), (0, 1), value=1.0)
    return shown.project_camera(rays)


def mask_sentences(images: Images, scene: Scene, detections: Detections) -> Iterator[str]:
    """What is wrong with masks that are given for images, a sentence each.

    Args:
        images: as they are given to a capture.
        scene: with C views in pixels of the detections, and one person in it.
        detections: of the person, (F, C), of the same frames.
    """
    images, detections = images.checked(), _plain(detections)
    if images.masks is None:
        return
    pixels = _shown_at(_plain(scene.cameras), _plain(images.cameras), detections)
    detections = replace(detections, joints2d=pixels)
    count = min(len(images.reader), detections.frame_count)
    for view in range(detections.views):
        name = images.names[view] if images.names else f"view {view}"
        there = [frame for frame in range(count) if _has_image(images, view, frame)]
        known = [frame for frame in there if images.masks.knows(view, frame)]
        yield from partly_masked(name, known, there)
        joints = pixels[:, view].numpy(), detections.confidence2d[:, view].numpy()
        for found in examine_masks(name, partial(images.masks.mask, view), *joints):
            yield f"{found.subject}: {found.what}; {found.remedy}"
        if known:
            yield from mask_doubts(_masked(images, images.masks, name, view, known, detections))


def _has_image(images: Images, view: int, frame: int) -> bool:
    """Whether a view has an image of a frame; of one that is late, the first ones are missing."""
    return images.lag is None or bool(images.lag[frame, view].isfinite())


def _masked(
    images: Images,
    masks: KnownMasks,
    name: str,
    view: int,
    known: list[int],
    detections: Detections,
) -> MaskedFrames:
    """Some frames of one view that have masks, spread over those in which the person is seen."""
    own = detections.frames(torch.tensor(known)).select([view])
    some = spread_frames(own, _MASKS)
    chosen = [known[place] for place in some.tolist()]
    found = [masks.mask(view, frame) for frame in chosen]
    inside = torch.from_numpy(np.stack([mask for mask in found if mask is not None]))
    return MaskedFrames((name,), _Chosen(images, view, chosen), own.frames(some), inside[:, None])


@dataclass(frozen=True)
class _Chosen:
    """Frames of one view that were chosen, as those of a clip of one view."""

    images: Images
    view: int
    frames: list[int]

    def __len__(self) -> int:
        return len(self.frames)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        reader, chosen = self.images.reader, self.frames[start:stop]
        return np.concatenate([reader.read_view(self.view, f, f + 1) for f in chosen])


def _plain(value: Kind) -> Kind:
    """The same in double precision, without gradients, on the processor."""
    plain: Kind = value.map(Tensor.detach).to(torch.zeros((), dtype=torch.float64))
    return plain
