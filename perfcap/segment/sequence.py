"""The person, or everybody, in consecutive frames of one view.

Every frame is segmented on its own, from what its surroundings in time show: the result does not
depend on who works on which frames, nor on how many work at once. Colours can be carried from
frame to frame inside a block, which saves a third of the time; what they have learnt wrongly
stays, so that masks without a plate lose one percent of overlap and others nothing or little.
Blocks then matter: they are of ``BLOCK`` frames, counted from the first of the clip.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.segment.background import Plate
from perfcap.segment.evidence import ColorModels
from perfcap.segment.grabcut import Segmentation, segment
from perfcap.segment.motion_cue import CutSettings, find_cuts
from perfcap.segment.moving_scene import KeyFrame
from perfcap.segment.network_cue import PersonNetwork
from perfcap.segment.people_trimap import trimap_of
from perfcap.segment.scene import (
    Scene,
    SceneSettings,
    hide,
    key_frame,
    registered_neighbors,
    require_footage,
)
from perfcap.segment.settings import GrabCutSettings
from perfcap.segment.trimap import Mask, Trimap
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]

BLOCK = 10  # frames between fresh starts of the colour models


@dataclass(frozen=True)
class SequenceSettings(Settings):
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


@dataclass(frozen=True)
class Footage:
    """Consecutive frames of one view with what the model says about them.

    Attributes:
        images: (H, W, 3) RGB each.
        models: silhouettes (H, W) of the person's posed model, or (K, H, W) of everybody's.
        bones: (n, B, 2, 2) px, or (n, K, B, 2, 2); the last one of a person is the spine, from
            neck to hips.
        feet: which bones of a person lead from an ankle to the toes.
    """

    images: Sequence[Image]
    models: Sequence[Mask]
    bones: NDArray[np.floating]
    feet: Sequence[int] = ()

    def __post_init__(self) -> None:
        if not len(self.images) == len(self.models) == len(self.bones):
            raise InputError(
                f"footage: {len(self.images)} images, {len(self.models)} models and bones of "
                f"{len(self.bones)} frames; expected as many of each"
            )
        require_footage(self.images, self.models)
        if len(self.images):
            people = tuple(self.models[0].shape[:-2])
            wanted = (len(self.images), *people, None, 2, 2)
            require_shape(self.bones, "bones", wanted, "both ends of each bone, px, of each model")


def segment_block(
    footage: Footage,
    wanted: Sequence[int],
    scene: Scene,
    settings: SequenceSettings | None = None,
    network: PersonNetwork | None = None,
) -> Iterator[Segmentation]:
    """Segment some frames of a stretch, in order.

    Several models are found together, as one foreground: ``label_people`` says who is where in it.

    Args:
        footage: the frames, and one before and after for the motion cue, which need not be there.
            Of these, models are not looked at.
        wanted: indices of the frames within the footage, increasing.
        scene: from ``survey`` of the stretch.
        settings: of the segmentation.
        network: asked as far as ``scene.trust`` goes.
    """
    settings = settings or SequenceSettings()
    cuts = find_cuts(footage.images, settings.cut)
    trimaps = {
        index: trimap_of(
            footage.models[index], footage.bones[index], settings.frame.trimap, footage.feet
        )
        for index in wanted
    }
    surroundings = _Surroundings(footage, trimaps, cuts, scene, settings)
    warm: ColorModels | None = None
    for index in wanted:
        if index in cuts:
            warm = None
        plate, adjacent = surroundings.of(index)
        odds = None
        if network is not None and scene.trust is not None and trimaps[index].size:
            odds = ask(network, footage, index, trimaps[index])
        found = segment(
            footage.images[index],
            trimaps[index],
            settings.frame,
            adjacent=adjacent,
            plate=plate,
            network=None if odds is None or scene.trust is None else scene.trust(odds),
            warm=warm,
        )
        warm = found.models if settings.carry else None
        agreement = float("nan") if found.report.blank else _agreement(found, odds)
        report = replace(found.report, cut=index in cuts, agreement=agreement)
        yield replace(found, report=report)


def _agreement(found: Segmentation, odds: NDArray[np.float32] | None) -> float:
    """Intersection over union of a mask and even odds of a network."""
    if odds is None:
        return float("nan")
    mask, said = found.mask[found.trimap.box], odds > 0
    union = int((mask | said).sum())
    return float((mask & said).sum() / union) if union else float("nan")


def ask(
    network: PersonNetwork, footage: Footage, index: int, trimap: Trimap
) -> NDArray[np.float32]:
    """A network's log odds of the person in a frame, in the trimap's box (h, w)."""
    inside = footage.models[index][trimap.box]
    return network(footage.images[index], inside, footage.bones[index][-1], trimap.box)


class _Surroundings:
    """Background and adjacent frames of some frames of a block."""

    def __init__(
        self,
        footage: Footage,
        trimaps: Mapping[int, Trimap],
        cuts: set[int],
        scene: Scene,
        settings: SequenceSettings,
    ) -> None:
        self.images, self.models, self.cuts = footage.images, footage.models, cuts
        self.trimaps, self.scene, self.settings = trimaps, scene, settings
        self.keys: dict[int, KeyFrame | None] = {}

    def of(self, index: int) -> tuple[Plate | None, list[Image]]:
        """In the box around the person: the plate, and adjacent frames."""
        box = self.trimaps[index].box
        shot = _shot(index, len(self.images), self.cuts)
        if box[0].stop == box[0].start:
            return None, []
        if self.scene.plate is not None:
            near = [i for i in (index - 1, index + 1) if i in shot]
            return self.scene.plate[box], [self.images[i][box] for i in near]
        frames = self.images[shot.start : shot.stop]
        hidden, image = self._hidden(index), self.images[index]
        settings = self.settings.scene.registration
        adjacent = registered_neighbors(frames, hidden, index - shot.start, box, settings)
        key = self._key(shot) if self.settings.frame.use_plate else None
        return None if key is None else key.seen_from(image, hidden, box), adjacent

    def _hidden(self, index: int) -> Mask:
        return hide(self.models[index], self.settings.frame.plate.clearance)

    def _key(self, shot: range) -> KeyFrame | None:
        """The plate of the frames of a shot in this block."""
        if shot.start not in self.keys:
            chosen = [i for i in self.trimaps if i in shot]
            self.keys[shot.start] = key_frame(
                [self.images[i] for i in chosen],
                [self._hidden(i) for i in chosen],
                [self.trimaps[i].box for i in chosen],
                self.scene,
                self.settings.frame.plate,
            )
        return self.keys[shot.start]


def _shot(index: int, count: int, cuts: set[int]) -> range:
    """Frames of the same shot."""
    start = max((cut for cut in cuts if cut <= index), default=0)
    stop = min((cut for cut in cuts if cut > index), default=count)
    return range(start, stop)
