"""The person in consecutive frames of one view.

Every frame is segmented on its own, from what its surroundings in time show: the result does not
depend on who works on which frames, nor on how many work at once. Colours can be carried from
frame to frame inside a block, which saves a third of the time; what they have learnt wrongly
stays, so that masks without a plate lose one percent of overlap and others nothing or little.
Blocks then matter: they are of ``BLOCK`` frames, counted from the first of the clip.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.segment.background import Plate
from perfcap.segment.evidence import ColorModels
from perfcap.segment.grabcut import Segmentation, segment
from perfcap.segment.motion_cue import CutSettings, is_cut
from perfcap.segment.scene import Scene, SceneSettings, follow, hide
from perfcap.segment.settings import GrabCutSettings
from perfcap.segment.trimap import Box, Mask, build_trimap

Image = NDArray[np.uint8]

BLOCK = 10  # frames between fresh starts of the colour models


@dataclass(frozen=True)
class SequenceSettings:
    """Settings of a clip's segmentation.

    Attributes:
        frame: of each frame.
        scene: of what stays the same.
        cut: of scene changes.
        carry: whether colours are carried from frame to frame.
    """

    frame: GrabCutSettings = field(default_factory=GrabCutSettings)
    scene: SceneSettings = field(default_factory=SceneSettings)
    cut: CutSettings = field(default_factory=CutSettings)
    carry: bool = False

    @property
    def reach(self) -> int:
        """Frames before and after a block that help, if the camera moves; else one."""
        return max(1, *(abs(offset) for offset in self.scene.offsets))


@dataclass(frozen=True)
class Footage:
    """Consecutive frames of one view with what the model says about them.

    Attributes:
        images: (H, W, 3) RGB each.
        models: silhouettes (H, W) of the person's posed model.
        bones: (n, B, 2, 2) px.
    """

    images: Sequence[Image]
    models: Sequence[Mask]
    bones: NDArray[np.floating]

    def __post_init__(self) -> None:
        if not len(self.images) == len(self.models) == len(self.bones):
            raise InputError(
                f"footage: {len(self.images)} images, {len(self.models)} models and bones of "
                f"{len(self.bones)} frames; expected as many of each"
            )


def segment_block(
    footage: Footage,
    wanted: range,
    scene: Scene,
    settings: SequenceSettings | None = None,
) -> Iterator[Segmentation]:
    """Segment some frames of a stretch, in order.

    Args:
        footage: the frames, and those around them: one before and after for the motion cue,
            ``settings.reach`` where the camera moves. None need be there.
        wanted: indices of the frames within the footage.
        scene: from ``survey`` of the stretch.
        settings: of the segmentation.
    """
    settings = settings or SequenceSettings()
    cuts = _cuts(footage.images, settings.cut)
    moving = scene.plate is None
    hidden = (
        [hide(model, settings.frame.plate.clearance) for model in footage.models] if moving else []
    )
    warm: ColorModels | None = None
    for index in wanted:
        if index in cuts:
            warm = None
        shot = _shot(index, len(footage.images), cuts)
        trimap = build_trimap(footage.models[index], footage.bones[index], settings.frame.trimap)
        plate, adjacent = _context(footage, hidden, index, shot, trimap.box, scene, settings)
        found = segment(
            footage.images[index],
            trimap,
            settings.frame,
            adjacent=adjacent,
            plate=plate,
            warm=warm,
        )
        warm = found.models if settings.carry else None
        yield replace(found, report=replace(found.report, cut=index in cuts))


def _context(
    footage: Footage,
    hidden: Sequence[Mask],
    index: int,
    shot: range,
    box: Box,
    scene: Scene,
    settings: SequenceSettings,
) -> tuple[Plate | None, list[Image]]:
    """Background and adjacent frames in the box around the person."""
    if box[0].stop == box[0].start:
        return None, []
    if scene.plate is not None:
        near = [i for i in (index - 1, index + 1) if i in shot]
        return scene.plate[box], [footage.images[i][box] for i in near]
    context = follow(
        footage.images[shot.start : shot.stop],
        hidden[shot.start : shot.stop],
        index - shot.start,
        box,
        settings.frame.plate,
        settings.scene,
    )
    return context.plate, context.adjacent


def _cuts(images: Sequence[Image], settings: CutSettings) -> set[int]:
    """Frames that begin a new shot."""
    return {i for i in range(1, len(images)) if is_cut(images[i - 1], images[i], settings)}


def _shot(index: int, count: int, cuts: set[int]) -> range:
    """Frames of the same shot."""
    start = max((cut for cut in cuts if cut <= index), default=0)
    stop = min((cut for cut in cuts if cut > index), default=count)
    return range(start, stop)
